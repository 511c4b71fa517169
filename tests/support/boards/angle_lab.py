"""`rig home` and `rig run` as typed, on servos that take an angle behind a real serial device."""

from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from rig.parameters import Rig
from rig.rigfile import read_rig
from tests.support import ROOT
from tests.support.boards.commands import Lab, LoopHere, WorldsEye, worlds_eye
from tests.support.boards.pty import PtyBoard


class AngleLab(Lab):
    """A plate on two or three servos, plugged in, in their own time, and its rig file.

    shipped: the rig file that it extends; table: lines of [table] but for the port; first: lines
    before the first section.
    """

    def __init__(
        self, world: Any, shipped: str, table: str, folder: Path, patch: pytest.MonkeyPatch, capsys,
        *, first: str = "", markers: bool = True,
    ) -> None:  # fmt: skip
        self.world, self.folder, self.rig_file = world, folder, folder / "lab.toml"
        self._patch, self._capsys, self.markers, self._next_s = patch, capsys, markers, 0.0
        self.most_V, self.then = 0.0, lambda run_s: None
        self._begun_s, self.start_m = None, (-0.05, 0.05)
        self.world.watch = self._watch
        self.pty = PtyBoard(self.world, thread=False)
        known = ROOT / "experiments/rigs" / shipped
        eye = worlds_eye(folder, read_rig(known).ball)
        port = f'[table]\nport = "{self.pty.port}"\n{table}\n{eye}'
        text = known.read_text(encoding="utf-8")
        self.rig_file.write_text(f"{first}\n{text}\n{port}")
        self._stand_in()

    def _driver(self) -> dict[str, Callable]:
        """What stands in for parts of the driver, by name: the world's time."""
        raise NotImplementedError

    def _stand_in(self) -> None:
        @contextmanager
        def seeing(rig: Rig, recipe):
            yield WorldsEye(self.world)

        @contextmanager
        def tilt(rig: Rig):
            yield self._tilt

        for name, stand_in in self._driver().items():
            self._patch.setattr(name, stand_in)
        for name, stand_in in {
            "experiments.runs.hardware.plate_tilt": tilt,
            "experiments.runs.hardware.go_realtime": dict,
            "experiments.runs.hardware_run.watching": seeing,
            "experiments.runs.live_run.LoopProcess": LoopHere,
        }.items():
            self._patch.setattr(name, stand_in)

    def run_on(self, seconds: float) -> None:
        """Nobody is at the cable; what is on its way arrives."""
        for _ in range(round(1e3 * seconds)):
            self.pty.step()

    def close(self) -> None:
        self.pty.close()
