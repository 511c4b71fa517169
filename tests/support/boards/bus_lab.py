"""`rig home` and `rig run` as typed, on bus servos behind a real serial device, in their time."""

from contextlib import contextmanager
from pathlib import Path

import pytest

from rig.hardware.board.serial_link import SerialLink
from rig.hardware.bus.bus import BusTable
from rig.hardware.wiring import Wiring
from rig.parameters import Rig
from rig.rigfile import read_rig
from tests.support import ROOT
from tests.support.boards.bus_world import LEVEL, BusWorld, bus_of
from tests.support.boards.commands import AWAY_M, Lab, LoopHere, WorldsEye
from tests.support.boards.pty import PtyBoard, SteppedLink

SHIPPED = ROOT / "experiments/rigs/bus-servos.toml"


class BusLab(Lab):
    """A plate on two bus servos, plugged in by their adapter, and its rig file.

    counts: where the shafts are at first; wiring: how they really stand to the axes; keys: more of
    [table].
    """

    def __init__(
        self, kind: str, folder: Path, patch: pytest.MonkeyPatch, capsys, *,
        wiring: Wiring = LEVEL, counts=(2048, 2048), markers: bool = True, keys: str = "",
    ) -> None:  # fmt: skip
        self.known = read_rig(SHIPPED)
        self.world = BusWorld(bus_of(kind, counts), self.known, start_m=AWAY_M, wiring=wiring)
        self.folder, self.rig_file, self._capsys = folder, folder / "lab.toml", capsys
        self._patch, self.markers, self._next_s = patch, markers, 0.0
        self.most_V, self.then = 0.0, lambda run_s: None
        self._begun_s = None
        self.start_m = (-0.05, 0.05)
        self.world.watch = self._watch
        self.pty = PtyBoard(self.world, thread=False)
        table = f'[table]\nkind = "{kind}"\nport = "{self.pty.port}"\nbaud = 1000000\n{keys}\n'
        eye = 'camera = "the world\'s"\ncalibration = "none.json"\n'
        text = SHIPPED.read_text(encoding="utf-8")
        self.rig_file.write_text(f"control_rate_hz = 250.0\n{text}\n{table}{eye}")
        self._stand_in()

    def _stand_in(self) -> None:
        def serial(port: str, baud: int, what: str) -> SteppedLink:
            return SteppedLink(self.pty, SerialLink(port, baud, what))

        def table(*arguments, **named) -> BusTable:
            return BusTable(*arguments, **named, clock=self.clock, sleep_until=self._sleep_until)

        @contextmanager
        def seeing(rig: Rig, recipe):
            yield WorldsEye(self.world)

        @contextmanager
        def tilt(rig: Rig):
            yield self._tilt

        for name, stand_in in {
            "rig.hardware.board.serial_link.SerialLink": serial,
            "rig.hardware.bus.bus.BusTable": table,
            "experiments.runs.hardware.plate_tilt": tilt,
            "experiments.runs.hardware.go_realtime": dict,
            "experiments.runs.hardware_run.watching": seeing,
            "experiments.runs.live_run.LoopProcess": LoopHere,
        }.items():
            self._patch.setattr(name, stand_in)

    def _sleep_until(self, due_s: float) -> None:
        """The adapter goes on while the host sleeps."""
        while self.world.now_s < due_s - 1e-9:
            self.pty.step()

    def run_on(self, seconds: float) -> None:
        """Nobody is at the bus; what is on its way arrives."""
        for _ in range(round(1e3 * seconds)):
            self.pty.step()

    def close(self) -> None:
        self.pty.close()
