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
    """A plate on hobby servos (x and y, or the arms), as they really are, and its rig file.

    order: by channel of the board, the servo on it; keys: more of [table]; shipped: the rig file
    that it extends.
    """

    def __init__(
        self, servos: tuple[PulseServo, ...], folder: Path, patch: pytest.MonkeyPatch, capsys, *,
        order: tuple[int, ...] | None = None, markers: bool = True, keys: str = "",
        shipped: str = SHIPPED,
    ) -> None:  # fmt: skip
        self.known = read_rig(ROOT / "experiments/rigs" / shipped)
        self._open = open_pulses.open_pulse_board
        board = HostPulseBoard(servos=len(servos))
        world = PulseWorld(board, self.known, servos, order=order, start_m=AWAY_M)
        super().__init__(
            world, shipped, f'kind = "pulses"\n{keys}', folder, patch, capsys, markers=markers
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
