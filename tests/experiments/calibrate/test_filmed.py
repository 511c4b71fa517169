"""Frames of a recorded motion, of a camera class of a lab's own."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.motion.timing import Wiggle
from experiments.calibrate import filmed
from experiments.calibrate.folder import CalibrationFolder
from rig.parameters import Rig
from vision.sources.source_errors import UserCameraError

CAMERA = """
import os, time
import numpy as np

class Mine:
    k = 0
    def read(self):
        self.k += 1
        if self.k > 3:
            {end}
        return np.full((60, 80, 3), 7, np.uint8), time.monotonic()
"""


class Counting:
    """Stands in for a recorder of tilts."""

    def __init__(self) -> None:
        self.levels: list[int] = []

    def add(self, frame: SimpleNamespace) -> None:
        self.levels.append(int(frame.image[0, 0, 0]))

    def wiggle(self, t_s: np.ndarray, angle_rad: np.ndarray) -> Wiggle:
        seen = np.array(self.levels, float)
        return Wiggle(t_s, angle_rad, seen, np.zeros((len(seen), 2)))


def motion(folder: Path, end: str, monkeypatch: pytest.MonkeyPatch) -> Wiggle:
    (folder / "mine.py").write_text(CAMERA.format(end=end))
    monkeypatch.setattr(filmed, "tilt_recorder", lambda of: Counting())
    kept = CalibrationFolder(folder / "out", "measured", Rig())
    return filmed.filmed_motion(f"{folder}/mine.py:Mine", kept, np.arange(4.0), np.zeros((4, 2)))


def test_frames_of_a_lab_s_own_camera_are_a_motion_s(tmp_path, monkeypatch):
    seen = motion(tmp_path, "return None", monkeypatch)
    assert set(seen.stamp_s) == {7.0}
    assert list(seen.t_s) == [0, 1, 2, 3]


@pytest.mark.skipif(sys.platform != "linux", reason="no copy of the program there")
def test_a_camera_that_leaves_the_program_is_named(tmp_path, monkeypatch):
    with pytest.raises(UserCameraError, match=r"mine\.py:Mine.* left the program \(exit code 0\)"):
        motion(tmp_path, "os._exit(0)", monkeypatch)


def test_a_camera_is_no_file_whose_fingerprint_is_kept(tmp_path, monkeypatch):
    """What /dev/video0 streams was to be read to its end; a folder 0 stood for camera 0."""
    film = tmp_path / "film.mp4"
    film.touch()
    assert filmed.files_of(str(film)) == [film]
    assert filmed.files_of(f"{tmp_path}/mine.py:Mine") == filmed.files_of(None) == []
    monkeypatch.chdir(tmp_path)
    (tmp_path / "0").mkdir()
    for camera in ("0", "/dev/video0", "rtsp://table"):
        assert filmed.recorded(camera) is None
        assert filmed.files_of(camera) == []
    assert filmed.files_of("./0") == [Path("0")]
