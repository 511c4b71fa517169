"""How a board's channels and counts stand to the table's servos: order, signs, zero."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi
from typing import Any, ClassVar

from rig.parameters import ANGLE_KINDS, BUS_KINDS, Rig

Pair = tuple[float, float]


@dataclass(frozen=True)
class Wiring:
    """How a board's channels and counts stand to the table's servos: those of x and y, or of three
    arms.

    order: by channel, the servo that it counts; sign_volts, sign_angle: by channel, 1 or -1;
    zero_counts: the encoders' counts where the plate is level, by channel; counts_per_rev: after
    quadrature at the load shaft; crossed: motor channel 0 turns the arm that encoder channel 1
    counts, and motor channel 1 that of encoder channel 0. ValueError: an order that names a servo
    twice or none, a sign that is none or too many or few, zero_counts that no counter shows, or
    counts_per_rev that no board can take.
    """

    # A file of another version, with other keys, is no wiring.
    __pydantic_config__: ClassVar[Any] = {"extra": "forbid"}
    order: tuple[int, ...] = (0, 1)
    sign_volts: tuple[int, ...] = (1, 1)
    sign_angle: tuple[int, ...] = (1, 1)
    zero_counts: tuple[int, ...] = (0, 0)
    counts_per_rev: int = 4096
    crossed: bool = False

    def __post_init__(self) -> None:
        if sorted(self.order) != list(range(len(self.zero_counts))):
            raise ValueError(
                f"wiring.order = {list(self.order)}: must name each of {len(self.zero_counts)} "
                "servos once"
            )
        if not len(self.order) == len(self.sign_volts) == len(self.sign_angle):
            raise ValueError(
                f"wiring: {len(self.order)} servos have as many signs each, got {self.sign_volts} "
                f"and {self.sign_angle}"
            )
        if not {*self.sign_volts, *self.sign_angle} <= {-1, 1}:
            raise ValueError(
                f"wiring: signs must be -1 or 1, got {self.sign_volts} and {self.sign_angle}"
            )
        if not all(-(1 << 31) <= zero < 1 << 31 for zero in self.zero_counts):
            raise ValueError(f"wiring.zero_counts = {list(self.zero_counts)}: no counter shows it")
        if not 64 <= self.counts_per_rev <= 65535:
            raise ValueError(
                f"wiring.counts_per_rev = {self.counts_per_rev}: must be from 64 to 65535, "
                "counted after quadrature at the load shaft"
            )

    @property
    def step_rad(self) -> float:
        """Angle of one count [rad]."""
        return 2 * pi / self.counts_per_rev

    @property
    def swap(self) -> bool:
        """Whether channel 0 is y and channel 1 is x."""
        return self.order == (1, 0)

    def by_channel(self, by_servo: Sequence[Any]) -> tuple[Any, ...]:
        """Values by channel of values by servo."""
        return tuple(by_servo[servo] for servo in self.order)

    def by_servo(self, by_channel: Sequence[Any]) -> tuple[Any, ...]:
        """Values by servo of values by channel: the inverse of `by_channel`."""
        return tuple(by_channel[self.order.index(servo)] for servo in range(len(self.order)))

    def angles(self, counts: Sequence[float]) -> tuple[float, ...]:
        """Servos' angles [rad], x and y or of the arms, of the encoders' counts by channel."""
        turned = zip(self.sign_angle, counts, self.zero_counts, strict=True)
        return self.by_servo(
            [sign * (count - zero) * self.step_rad for sign, count, zero in turned]
        )

    def to_board(self, volts: Pair) -> Pair:
        """Volts by motor channel (0, 1) of the volts (x, y)."""
        a, b = volts[::-1] if self.swap != self.crossed else volts
        return self.sign_volts[0] * a, self.sign_volts[1] * b

    def from_board(self, volts: Pair) -> Pair:
        """Volts (x, y) of volts by motor channel (0, 1): the inverse of `to_board`."""
        a, b = self.sign_volts[0] * volts[0], self.sign_volts[1] * volts[1]
        return (b, a) if self.swap != self.crossed else (a, b)

    def counts(self, angles: Sequence[float]) -> tuple[int, ...]:
        """Counts by channel nearest to servos' angles [rad]: the inverse of `angles`."""
        steps = [round(angle / self.step_rad) for angle in self.by_channel(angles)]
        turned = zip(self.sign_angle, steps, self.zero_counts, strict=True)
        return tuple(sign * step + zero for sign, step, zero in turned)

    def polarities(self) -> tuple[int, int]:
        """By encoder channel: 1 where a positive voltage of the arm's motor raises its counts,
        else -1.
        """
        a, b = self.sign_volts[::-1] if self.crossed else self.sign_volts
        return self.sign_angle[0] * a, self.sign_angle[1] * b


def raw_wiring(rig: Rig) -> Wiring:
    """Return the wiring of channels as they are, for homing, which finds out what they mean."""
    servos = rig.linkage.servos
    return Wiring(
        tuple(range(servos)),
        (1,) * servos,
        (1,) * servos,
        level_counts(rig),
        rig.servo.encoder_counts_per_rev,
    )


def level_counts(rig: Rig) -> tuple[int, ...]:
    """Return the counts, by channel, at which the rig file says that the plate is level: the middle
    of a bus servo's turn, or 0 of one on pulses, and its trim; 0 where encoders count from where
    they wake up.
    """
    servos = rig.linkage.servos
    if rig.table.kind not in ANGLE_KINDS:
        return (0,) * servos
    turn = rig.servo.encoder_counts_per_rev
    middle = turn // 2 if rig.table.kind in BUS_KINDS else 0
    trims = rig.table.by_channel("trim_rad", servos)
    return tuple(middle + round(trim * turn / (2 * pi)) for trim in trims)


def file_wiring(rig: Rig) -> Wiring:
    """Return the wiring that the rig file tells, level at `level_counts`.

    ValueError: as `Wiring` raises it.
    """
    table, raw = rig.table, raw_wiring(rig)
    return replace(
        raw,
        order=raw.order[:: -1 if table.swap else 1],
        crossed=table.crossed,
        sign_volts=table.by_channel("sign_volts", len(raw.order)),
        sign_angle=table.by_channel("sign_angle", len(raw.order)),
    )
