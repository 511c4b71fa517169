"""A lab's camera class in `rig track` and `rig calibrate`: what it prints, and how it ends."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from experiments import own_camera
from tests.support import ROOT

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="no copy of a process there")

CAMERA = """
import ctypes, os, sys, time
import numpy as np

class Mine:
    def open(self):
        print("loud: opened")
        os.write(1, b"loud: as a maker's library does\\n")
        self.k = 0
    def read(self):
        time.sleep(0.01)
        print("loud: read")
        self.k += 1
        if self.k > 5:
            {end}
        return np.full((60, 80, 3), 10 * self.k, np.uint8), time.monotonic()
    def close(self):
        print("loud: closed")
"""


def rig(folder: Path, end: str, *words: str) -> subprocess.CompletedProcess:
    """`rig WORDS` in a folder with the camera, which ends as said."""
    (folder / "mine.py").write_text(CAMERA.format(end=end))
    command = [sys.executable, "-m", "experiments.cli", *words]
    path = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(
        command, cwd=folder, env=path, capture_output=True, text=True, timeout=280, check=False
    )


def test_what_a_camera_prints_is_not_on_the_commands_own_output(tmp_path):
    done = rig(tmp_path, "return None", "track", "mine.py:Mine", "--out", "out")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("mine.py:Mine: ")
    assert "loud" not in done.stdout
    for what in ("opened", "as a maker's library does", "read", "closed"):
        assert f"loud: {what}" in done.stderr


@pytest.mark.parametrize(
    ("end", "words"),
    [
        ("os._exit(0)", "mine.py:Mine left the program (exit code 0)"),
        ("ctypes.string_at(0)", "mine.py:Mine crashed the program (signal 11)"),
    ],
)
@pytest.mark.parametrize("command", ["track mine.py:Mine", "calibrate camera mine.py:Mine"])
def test_a_camera_that_leaves_or_crashes_the_program_is_an_error(tmp_path, command, end, words):
    done = rig(tmp_path, end, *command.split(), "--out", "out")
    assert done.returncode == 1, done.stdout + done.stderr
    assert done.stderr.splitlines()[-1] == f"rig: {words}"
    assert done.stdout == ""
    assert not (tmp_path / "out" / "results.json").exists()


def test_what_takes_long_to_open_is_told(tmp_path, monkeypatch, capfd):
    (tmp_path / "slow.py").write_text(
        CAMERA.format(end="return None").replace("self.k = 0", "self.k = 0; time.sleep(0.5)")
    )
    monkeypatch.setattr(own_camera, "SAY_S", 0.05)
    with own_camera.opened(f"{tmp_path}/slow.py:Mine") as source:
        assert next(source).image.shape == (60, 80, 3)
    assert "slow.py:Mine: waiting for its first frame\n" in capfd.readouterr().err
