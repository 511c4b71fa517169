"""What the browser tests share: the program, the browser, and eyes for its pictures."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np

from tests.support import ROOT

FLAGS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
PATIENCE_S = float(os.environ.get("RIG_BROWSER_PATIENCE_S", "240"))
RIG = (sys.executable, "-m", "experiments.cli")


class Program:
    """`rig dashboard` in a process of its own; `link` is what it printed."""

    def __init__(self, out: Path, *, port: int = 0, rig: Path | None = None) -> None:
        self.log = (out / "program.log").open("a")
        command = [*RIG, "dashboard", "--port", str(port), "--out", str(out)]
        command += [] if rig is None else ["--rig", str(rig)]
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
        self._process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=self.log,
            text=True,
            env=environment,
            start_new_session=True,  # its own share of a busy machine
        )
        assert self._process.stdout is not None
        self.link = self._process.stdout.readline().strip()
        found = re.fullmatch(r"http://127\.0\.0\.1:(\d+)/\?token=\S{32,}", self.link)
        assert found, f"printed {self.link!r}; see {out / 'program.log'}"
        self.port = int(found[1])

    @property
    def pid(self) -> int:
        return self._process.pid

    def kill(self) -> None:
        """As a crash would: no goodbye."""
        self._process.kill()
        self._process.wait()
        self._close()

    def _close(self) -> None:
        self.log.close()
        if self._process.stdout is not None:
            self._process.stdout.close()

    def end(self) -> int:
        """In order; its exit code."""
        self._process.send_signal(signal.SIGTERM)
        try:
            return self._process.wait(30)
        finally:
            self.kill()


def pixels(png: bytes) -> np.ndarray:
    """A screenshot as BGR (h, w, 3)."""
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return image


def sees_table(image: np.ndarray) -> tuple[float, int, int]:
    """Standard deviation, ball-coloured pixels and plate-coloured pixels of the 3-D view."""
    blue, green, red = (image[..., i].astype(int) for i in range(3))
    ball = (red > 150) & (red - blue > 70) & (green > 40) & (green < red - 25)
    plate = (abs(red - blue) < 14) & (red > 190) & (red < 246)
    return float(image.std()), int(ball.sum()), int(plate.sum())
