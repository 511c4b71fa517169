"""`rig home` and `rig run` as typed, on bus servos behind a real serial device, in their time."""

from collections.abc import Callable
from pathlib import Path

import pytest

from rig.hardware.board.serial_link import SerialLink
from rig.hardware.bus.bus import BusTable
from rig.hardware.wiring import Wiring
from rig.rigfile import read_rig
from tests.support import ROOT
from tests.support.boards.angle_lab import AngleLab
from tests.support.boards.bus_world import LEVEL, BusWorld, bus_of
from tests.support.boards.commands import AWAY_M
from tests.support.boards.pty import SteppedLink

SHIPPED = "bus-servos.toml"


class BusLab(AngleLab):
    """A plate on bus servos, plugged in by their adapter, and its rig file.

    counts: where the shafts are at first; wiring: how they really stand to the axes; keys: more of
    [table].
    """

    def __init__(
        self, kind: str, folder: Path, patch: pytest.MonkeyPatch, capsys, *,
        wiring: Wiring = LEVEL, counts=(2048, 2048), markers: bool = True, keys: str = "",
        shipped: str = SHIPPED, rate_hz: float = 250.0,
    ) -> None:  # fmt: skip
        self.known = read_rig(ROOT / "experiments/rigs" / shipped)
        world = BusWorld(bus_of(kind, counts), self.known, start_m=AWAY_M, wiring=wiring)
        table, rate = f'kind = "{kind}"\nbaud = 1000000\n{keys}', f"control_rate_hz = {rate_hz}"
        super().__init__(world, shipped, table, folder, patch, capsys, first=rate, markers=markers)

    def _driver(self) -> dict[str, Callable]:
        def serial(port: str, baud: int, what: str) -> SteppedLink:
            return SteppedLink(self.pty, SerialLink(port, baud, what))

        def table(*arguments, **named) -> BusTable:
            return BusTable(*arguments, **named, clock=self.clock, sleep_until=self._sleep_until)

        return {
            "rig.hardware.board.serial_link.SerialLink": serial,
            "rig.hardware.bus.bus.BusTable": table,
        }

    def _sleep_until(self, due_s: float) -> None:
        """The adapter goes on while the host sleeps."""
        while self.world.now_s < due_s - 1e-9:
            self.pty.step()
