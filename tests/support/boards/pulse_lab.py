"""`rig home` and `rig run` as typed, on hobby servos behind a pulse board, in its time."""

from collections.abc import Callable
from pathlib import Path

import pytest

from rig.hardware.board import open_pulses
from rig.hardware.board.pulse_servo import PulseServo
from rig.hardware.board.serial_link import SerialLink
from rig.rigfile import read_rig
from tests.support import ROOT
from tests.support.boards.angle_lab import AngleLab
from tests.support.boards.commands import AWAY_M
from tests.support.boards.host import HostPulseBoard
from tests.support.boards.pty import SteppedLink
from tests.support.boards.world import PulseWorld

SHIPPED = "hobby-two-servos.toml"


class PulseLab(AngleLab):
    """A plate on two hobby servos (x, y), as they really are, and its rig file.

    swap: channel 0 of the board drives y; keys: more of [table].
    """

    def __init__(
        self, servos: tuple[PulseServo, PulseServo], folder: Path, patch: pytest.MonkeyPatch,
        capsys, *, swap: bool = False, markers: bool = True, keys: str = "",
    ) -> None:  # fmt: skip
        self.known = read_rig(ROOT / "experiments/rigs" / SHIPPED)
        self._open = open_pulses.open_pulse_board
        world = PulseWorld(HostPulseBoard(), self.known, servos, swap=swap, start_m=AWAY_M)
        super().__init__(
            world, SHIPPED, f'kind = "pulses"\n{keys}', folder, patch, capsys, markers=markers
        )

    def _driver(self) -> dict[str, Callable]:
        def serial(port: str, baud: int, what: str) -> SteppedLink:
            return SteppedLink(self.pty, SerialLink(port, baud, what))

        def opened(*arguments, **named):
            return self._open(*arguments, **named, clock=self.clock)

        return {
            "rig.hardware.board.serial_link.SerialLink": serial,
            "rig.hardware.board.open_pulses.open_pulse_board": opened,
        }
