"""The folder of `--out` is one program's until its end."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from experiments.cli.out_folder import out_folder

fcntl = pytest.importorskip("fcntl")
KEEPS = (
    "import sys; from pathlib import Path; from experiments.cli.out_folder import out_folder; "
    "how = {'shared': 'shared' in sys.argv}; out_folder(Path(sys.argv[1]), **how); "
    "out_folder(Path(sys.argv[1]), **how); print('kept', flush=True); "
    "sys.stdin.read()"
)


def test_a_folder_is_refused_as_long_as_another_program_writes_in_it(tmp_path: Path):
    other = subprocess.Popen(
        [sys.executable, "-c", KEEPS, tmp_path], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    with other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"kept\n"
        with pytest.raises(ValueError, match="another program is writing"):
            out_folder(tmp_path)
        other.communicate()
    assert out_folder(tmp_path) == out_folder(tmp_path) == tmp_path
    handle = os.open(tmp_path, os.O_RDONLY)
    with pytest.raises(BlockingIOError):
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    os.close(handle)


def test_runs_share_a_folder_with_each_other_and_with_nothing_else(tmp_path: Path):
    """`rig run --out out` beside `rig reproduce --out out`: the later one's results.json stood
    beside the other one's report."""
    command = [sys.executable, "-c", KEEPS, tmp_path, "shared"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"kept\n"
        with pytest.raises(ValueError, match="another program is writing"):
            out_folder(tmp_path)
        assert out_folder(tmp_path, shared=True) == tmp_path
        other.communicate()
    with subprocess.Popen([*command[:-1]], stdin=subprocess.PIPE, stderr=subprocess.PIPE) as other:
        assert b"another program is writing" in other.communicate()[1]
