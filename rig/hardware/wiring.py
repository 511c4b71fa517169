"""Which cable goes where: board channels and counts to axes and angles, volts to channels."""

from dataclasses import dataclass
from math import pi

Pair = tuple[float, float]


@dataclass(frozen=True)
class Wiring:
    """How a board's two channels are wired to the table's axes; found by homing.

    swap: channel 0 is axis y, channel 1 axis x (motor and encoder alike). Everything else is by
    axis (x, y): sign_volts -1 where a positive board voltage lowers the angle of a table wired
    right, sign_angle -1 where counts fall when the angle rises, zero_counts where the plate is
    level. crossed: besides, the two motor plugs are exchanged against the encoders.
    """

    swap: bool = False
    sign_volts: tuple[int, int] = (1, 1)
    sign_angle: tuple[int, int] = (1, 1)
    zero_counts: tuple[int, int] = (0, 0)
    counts_per_rev: int = 4096
    crossed: bool = False

    def __post_init__(self) -> None:
        if not {*self.sign_volts, *self.sign_angle} <= {-1, 1}:
            raise ValueError(
                f"wiring: signs must be -1 or 1, got {self.sign_volts} and {self.sign_angle}"
            )
        if not 16 <= self.counts_per_rev <= 65535:
            raise ValueError(
                f"wiring.counts_per_rev = {self.counts_per_rev}: must be from 16 to 65535, "
                "counted after quadrature at the load shaft"
            )

    @property
    def step_rad(self) -> float:
        """Angle of one count [rad]."""
        return 2 * pi / self.counts_per_rev

    def angles(self, counts: tuple[int, int]) -> Pair:
        """Servo angles (x, y) [rad] of the board's counts (channel 0, channel 1)."""
        x, y = counts[::-1] if self.swap else counts
        return (
            self.sign_angle[0] * (x - self.zero_counts[0]) * self.step_rad,
            self.sign_angle[1] * (y - self.zero_counts[1]) * self.step_rad,
        )

    def to_board(self, volts: Pair) -> Pair:
        """Volts of the board's motor channels (0, 1) for volts wished at the axes (x, y)."""
        x, y = self.sign_volts[0] * volts[0], self.sign_volts[1] * volts[1]
        return (y, x) if self.swap != self.crossed else (x, y)

    def from_board(self, volts: Pair) -> Pair:
        """Volts at the axes (x, y) of volts at the motor channels: the inverse of `to_board`."""
        x, y = volts[::-1] if self.swap != self.crossed else volts
        return self.sign_volts[0] * x, self.sign_volts[1] * y

    def channel_zeros(self) -> tuple[int, int]:
        """Counts of encoder channels (0, 1) where the plate is level."""
        x, y = self.zero_counts
        return (y, x) if self.swap else (x, y)

    def polarities(self) -> tuple[int, int]:
        """By encoder channel: 1 where a positive voltage of its motor raises its counts, or -1."""
        x, y = (v * a for v, a in zip(self.sign_volts, self.sign_angle, strict=True))
        return (y, x) if self.swap else (x, y)
