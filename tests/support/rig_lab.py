"""A laboratory for `rig home` and `rig run` as programs: a table served by another process, and a
rig file that names it; with a camera over it where asked."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Self

import numpy as np

from experiments.records.recording import read_run
from experiments.runs.assemble import load_rig
from experiments.runs.runs import calibrate_camera
from rig.hardware.board.link import LinkLost
from tests.support import ROOT

KNOWN = "[servo]\ngain_rad_s_V = 1.735\ntime_constant_s = 0.046\n"
PROTOCOL = """title = "short"
duration_s = {seconds}
[start]
x_m = -0.1
y_m = 0.1
hold_s = 0.5
"""
HOMINGS = 3  # chosen: three lost links in a row are the table's own doing
# A busy machine's doing: a process that had no turn in time is a lost table or camera.
LOST = (
    "silent for", "heard nothing", "round trip", "no new frame for", "no frame for",
    "no first frame",
)  # fmt: skip


def _before_others() -> None:
    """As on a machine of its own, where that is allowed: real time is not for a busy one."""
    with suppress(PermissionError):
        os.nice(-15)


def _as_from_a_terminal() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    _before_others()


class Lab:
    """Context: a served table and a rig file that names it, in a folder of memory: a disk that is
    busy would halt the plant."""

    def __init__(self, *, film: bool = False, program: str = "served_table") -> None:
        memory = Path("/dev/shm")
        place = memory if memory.is_dir() else None
        self._folder = tempfile.TemporaryDirectory(prefix="rig_lab_", dir=place)
        folder = Path(self._folder.name)
        self.folder, self.out = folder, folder / "out"
        words = ["film"] if film else []
        self.process = self._serve(program, *words)
        self.camera: subprocess.Popen | None = None
        self.rig = folder / "lab.toml"
        text = f"{KNOWN}[table]\n{self._told('port')}\n"
        if film:
            self.camera = self._serve("virtual_film")
            made = calibrate_camera(load_rig(None), folder, 1)  # the table is real here
            made.write_text(made.read_text().replace('"simulated"', '"measured"'))
            text += f'camera = "{self._told("film")}"\ncalibration = "calibration.json"\n'
        self.rig.write_text(text)

    def _serve(self, program: str, *words: str) -> subprocess.Popen:
        command = [sys.executable, "-m", f"tests.support.{program}", str(self.folder), *words]
        return subprocess.Popen(
            command, cwd=ROOT, stdout=subprocess.DEVNULL, preexec_fn=_before_others
        )

    def _told(self, name: str) -> str:
        """What a process says in a file once it serves."""
        deadline = time.monotonic() + 120
        while not (self.folder / name).exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        return (self.folder / name).read_text()

    def protocol(self, seconds: float) -> str:
        path = self.folder / "short.toml"
        path.write_text(PROTOCOL.format(seconds=seconds))
        return str(path)

    def start(self, *arguments: str) -> subprocess.Popen:
        return subprocess.Popen(
            [sys.executable, "-m", "tests.support.patient_rig", *arguments, "--rig", str(self.rig)],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, stdin=subprocess.DEVNULL,
            cwd=ROOT,
            preexec_fn=_as_from_a_terminal,
        )  # fmt: skip

    def call(self, *arguments: str) -> tuple[int, str, str]:
        child = self.start(*arguments)
        out, error = child.communicate(timeout=180)
        return child.returncode, out, error

    def home(self) -> str:
        """Home the table, once more where the link was lost, and return what was printed.

        LinkLost: it was lost each time; AssertionError: homing ended otherwise. Both say how.
        """
        for _ in range(HOMINGS):
            code, out, error = self.call("home", "--yes")
            if code == 0:
                return out
            assert any(word in error for word in LOST), error
        raise LinkLost(error)

    def volts(self) -> np.ndarray:
        """(n, 3): time and volts at the plant whenever they changed."""
        rows = (self.folder / "volts").read_text().split("\n")[:-1]
        return np.array([[float(v) for v in row.split()] for row in rows])

    def folders(self) -> list[Path]:
        """Of the runs that have begun to be recorded, oldest first."""
        begun = sorted((self.out / "runs").glob("*/samples.mcap"))
        return [path.parent for path in begun if (path.parent / "run.json").is_file()]

    def runs(self) -> list:
        """As they can be read now."""
        return [read_run(folder) for folder in self.folders()]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *what: object) -> None:
        for process in (self.process, self.camera):
            if process is not None:
                process.kill()
                process.wait()
        self._folder.cleanup()
