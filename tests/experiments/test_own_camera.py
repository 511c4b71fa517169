"""A lab's camera class in `rig track` and `rig calibrate`: what it prints, and how it ends."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from experiments import own_camera
from rig.foreign_trial import Here, Tells
from tests.support import ROOT
from vision.sources.source_errors import UserCameraError

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="no copy of the program there")

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


def run(folder: Path, *words: str) -> subprocess.CompletedProcess:
    """`rig WORDS` in a folder."""
    command = [sys.executable, "-m", "experiments.cli", *words]
    path = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(
        command, cwd=folder, env=path, capture_output=True, text=True, timeout=280, check=False
    )


def rig(folder: Path, end: str, *words: str) -> subprocess.CompletedProcess:
    """`rig WORDS` in a folder with the camera, which ends as said."""
    (folder / "mine.py").write_text(CAMERA.format(end=end))
    return run(folder, *words)


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
    with own_camera.opened(f"{tmp_path}/slow.py:Mine", Here(lambda told: None)) as source:
        assert next(source).image.shape == (60, 80, 3)
    assert "slow.py:Mine: waiting for its first frame\n" in capfd.readouterr().err


def test_a_camera_that_hangs_as_it_opens_is_ended(tmp_path, monkeypatch):
    """Even in compiled code, which no thread of the program could leave."""
    (tmp_path / "stuck.py").write_text(
        CAMERA.format(end="return None").replace("self.k = 0", "ctypes.CDLL(None).pause()")
    )
    monkeypatch.setattr(own_camera, "OPEN_S", 0.5)
    address = f"{tmp_path}/stuck.py:Mine"

    with pytest.raises(UserCameraError, match="opening it did not return"):
        own_camera.with_camera(address, lambda tells: _frames(address, tells))


def test_a_camera_may_set_handlers_of_signals_and_asks_nobody(tmp_path):
    """It opens in the main thread; an end of input is read where it asks."""
    (tmp_path / "asks.py").write_text(
        CAMERA.format(end="return None").replace(
            "self.k = 0",
            "self.k = 0; import signal; signal.signal(signal.SIGUSR1, print); input('ready?')",
        )
    )
    done = run(tmp_path, "track", "asks.py:Mine", "--out", "out")
    assert done.returncode == 1, done.stdout + done.stderr
    assert "EOFError" in done.stderr.splitlines()[-1]


def _frames(address: str, tells: Tells) -> int:
    with own_camera.opened(address, tells) as source:
        return len(list(source))


SHEETS = """
import time
from calibration.camera.sheet import Sheet
from experiments.calibrate.camera import _virtual_shots
from rig.parameters import Rig

class Mine:
    def open(self):
        self.shots = iter(_virtual_shots(Rig(), Sheet(), 0))
    def read(self):
        time.sleep(0.01)
        image = next(self.shots, None)
        return None if image is None else (image, time.monotonic())
    def close(self):
        pass
"""


def test_a_lens_is_calibrated_with_a_camera_of_a_labs_own(tmp_path):
    (tmp_path / "sheets.py").write_text(SHEETS)
    done = run(tmp_path, "calibrate", "camera", "sheets.py:Mine", "--out", "out")
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "out" / "calibration.json").is_file()
