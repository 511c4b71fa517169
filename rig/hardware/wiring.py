"""How a board's channels and counts stand to the table's axes: signs, swap, zero."""

from dataclasses import dataclass
from math import pi

Pair = tuple[float, float]


@dataclass(frozen=True)
class Wiring:
    """How a board's channels and counts stand to the table's axes: channel 0 is x, unless `swap`.

    sign_volts, sign_angle: by channel, 1 or -1; zero_counts: the encoders' counts where the plate
    is level, by channel; counts_per_rev: after quadrature at the load shaft; crossed: motor channel
    0 turns the arm that encoder channel 1 counts, and motor channel 1 that of encoder channel 0.
    ValueError: a sign that is none, or counts_per_rev that no board can take.
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
        if not 64 <= self.counts_per_rev <= 65535:
            raise ValueError(
                f"wiring.counts_per_rev = {self.counts_per_rev}: must be from 64 to 65535, "
                "counted after quadrature at the load shaft"
            )

    @property
    def step_rad(self) -> float:
        """Angle of one count [rad]."""
        return 2 * pi / self.counts_per_rev

    def angles(self, counts: tuple[int, int]) -> Pair:
        """Servo angles (x, y) [rad] of the encoders' counts (channel 0, channel 1)."""
        a, b = (
            sign * (count - zero) * self.step_rad
            for sign, count, zero in zip(self.sign_angle, counts, self.zero_counts, strict=True)
        )
        return (b, a) if self.swap else (a, b)

    def to_board(self, volts: Pair) -> Pair:
        """Volts by motor channel (0, 1) of the volts (x, y)."""
        a, b = volts[::-1] if self.swap != self.crossed else volts
        return self.sign_volts[0] * a, self.sign_volts[1] * b

    def from_board(self, volts: Pair) -> Pair:
        """Volts (x, y) of volts by motor channel (0, 1): the inverse of `to_board`."""
        a, b = self.sign_volts[0] * volts[0], self.sign_volts[1] * volts[1]
        return (b, a) if self.swap != self.crossed else (a, b)

    def counts(self, angles: Pair) -> tuple[int, int]:
        """Counts (channel 0, channel 1) nearest to servo angles (x, y) [rad]: the inverse of
        `angles`.
        """
        a, b = angles[::-1] if self.swap else angles
        steps = (round(a / self.step_rad), round(b / self.step_rad))
        return (
            self.sign_angle[0] * steps[0] + self.zero_counts[0],
            self.sign_angle[1] * steps[1] + self.zero_counts[1],
        )

    def polarities(self) -> tuple[int, int]:
        """By encoder channel: 1 where a positive voltage of the arm's motor raises its counts,
        else -1.
        """
        a, b = self.sign_volts[::-1] if self.crossed else self.sign_volts
        return self.sign_angle[0] * a, self.sign_angle[1] * b
