"""Where compiled kernels are kept: in a folder of the user's, else in one of this program."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support import ROOT
from vision.compiled import is_compiled

PROGRAM = """
import os, sys
from vision.compiled import CACHE_NOTE, kernel
import numba
@kernel
def twice(x):
    return 2 * x
folder = os.environ["NUMBA_CACHE_DIR"]
print(twice(21), folder, numba.config.CACHE_DIR == folder, os.access(folder, os.W_OK))
print(CACHE_NOTE)
"""


def run(
    tmp_path: Path, before: Callable[[], object] | None = None, /, **environment: str
) -> list[str]:
    file = tmp_path / "program.py"
    file.write_text(PROGRAM)
    kept = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    told = subprocess.run(
        [sys.executable, str(file)],
        capture_output=True,
        text=True,
        check=True,
        env=kept | {"PYTHONPATH": str(ROOT)} | environment,
        preexec_fn=before,
    )
    return told.stdout.splitlines()


@pytest.mark.slow
def test_the_users_folder_is_taken_where_it_can_be_written(tmp_path):
    line, note = run(tmp_path, XDG_CACHE_HOME=str(tmp_path / "cache"))
    assert line.startswith(f"42 {tmp_path}/cache/balancing-table-rig/")
    assert line.endswith("True True")
    assert note == ""


def test_a_package_counts_as_compiled_once_its_kernels_are_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    assert not is_compiled(tmp_path.name)
    run(tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    assert is_compiled(tmp_path.name)
    assert not is_compiled("detection")


@pytest.mark.parametrize(
    "name", ["XDG_CACHE_HOME", pytest.param("NUMBA_CACHE_DIR", marks=pytest.mark.slow)]
)
def test_where_none_can_be_written_the_program_has_its_own_and_leaves_nothing(tmp_path, name):
    """Machine code beside the sources would outlive a change of what it calls."""
    line, note = run(tmp_path, **{name: "/dev/null/cache"})
    number, folder, *yes = line.split()
    assert (number, yes) == ("42", ["True", "True"])
    assert not folder.startswith("/dev/null")
    assert not Path(folder).exists()
    assert not list(tmp_path.rglob("*.nbi"))
    assert "/dev/null/cache" in note
    assert "XDG_CACHE_HOME" in note


@pytest.mark.skipif(os.name == "nt", reason="rights of files are Unix's")
@pytest.mark.parametrize("mode", [0o777, 0o770, 0o702])
def test_a_folder_into_which_others_may_write_is_not_executed(tmp_path: Path, mode: int):
    """An index of the cache is a pickle: whoever puts it there has it run as the user."""
    cache = tmp_path / "cache"
    cache.mkdir()
    cache.chmod(mode)
    line, note = run(tmp_path, NUMBA_CACHE_DIR=str(cache))
    assert line.split()[0] == "42"
    assert not list(cache.rglob("*"))
    assert "others can write to it" in note


@pytest.mark.skipif(getattr(os, "geteuid", lambda: 1)() != 0, reason="only root gives files away")
def test_a_folder_of_somebody_else_is_not_executed(tmp_path: Path):
    cache = tmp_path / "cache"
    cache.mkdir(mode=0o700)
    os.chown(cache, 65534, 65534)
    assert "others can write to it" in run(tmp_path, NUMBA_CACHE_DIR=str(cache))[1]
    assert not list(cache.rglob("*"))


def test_a_new_folder_is_for_its_user_alone(tmp_path: Path):
    run(tmp_path, lambda: os.umask(0o002), XDG_CACHE_HOME=str(tmp_path / "cache"))
    (made,) = (tmp_path / "cache/balancing-table-rig").iterdir()
    assert os.name == "nt" or made.stat().st_mode & 0o077 == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "left"),
    [("*.nbc", b""), ("*.nbi", b"garbage\n"), ("*.nbc", None)],
    ids=["no code", "garbage for the index", "half of the code"],
)
def test_what_a_power_cut_left_is_compiled_anew(tmp_path, kind: str, left: bytes | None):
    run(tmp_path, XDG_CACHE_HOME=str(tmp_path / "cache"))
    (file,) = (tmp_path / "cache").rglob(kind)
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2] if left is None else left)
    for _ in range(2):
        line, note = run(tmp_path, XDG_CACHE_HOME=str(tmp_path / "cache"))
        assert line.startswith("42 ")
        assert note == ""
    (mended,) = (tmp_path / "cache").rglob(kind)
    assert len(mended.read_bytes()) > len(whole) // 2  # the next program has it


@pytest.mark.skipif(sys.platform == "win32", reason="file size limits are POSIX")
@pytest.mark.parametrize("room", [0, 1000])
def test_where_a_full_disk_keeps_nothing_the_program_works_all_the_same(tmp_path, room: int):
    import resource

    def full() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))

    cache = tmp_path / "cache"
    line, _ = run(tmp_path, full, XDG_CACHE_HOME=str(cache), PYTHONDONTWRITEBYTECODE="1")
    assert line.startswith("42 ")
    assert not list(cache.rglob("*.nbc"))
