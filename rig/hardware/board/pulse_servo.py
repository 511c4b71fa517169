"""A hobby (RC) servo's pulse and its angle, and what a board is told of them."""

from dataclasses import dataclass
from math import pi

SHORTEST_US, LONGEST_US = 500.0, 2500.0  # of every board: further, a servo stands at its stop
LEAST_RATE_RAD_S, MOST_RATE_RAD_S = 0.1, 65.0  # of every board
STEPS_RAD, STEPS_US = 1e4, 2.0  # the cable's: 0.1 mrad, half us


@dataclass(frozen=True)
class PulseServo:
    """How the angle of a hobby servo stands to its pulse: level_us + us_per_rad angle.

    us_per_rad: negative where a longer pulse lowers the angle; lowest_us, highest_us: what the
    servo takes without running into its stop. ValueError: a servo that no board drives.
    """

    level_us: float = 1500.0
    us_per_rad: float = 2000.0 / pi  # 90 degrees for 1 ms, as most are made
    lowest_us: float = 1000.0
    highest_us: float = 2000.0

    def __post_init__(self) -> None:
        if not SHORTEST_US <= self.lowest_us < self.highest_us <= LONGEST_US:
            raise ValueError(
                f"pulses from {self.lowest_us:g} to {self.highest_us:g} us: a servo's lie between "
                f"{SHORTEST_US:g} and {LONGEST_US:g} us, the lowest below the highest"
            )
        if not (10.0 <= abs(self.us_per_rad) <= 3000.0):
            raise ValueError(
                f"us_per_rad = {self.us_per_rad:g}: a servo's is 10 to 3000 us/rad to either side, "
                "mostly 400 to 700"
            )

    def pulse_us(self, angle_rad: float) -> float:
        """Pulse [us] of an angle [rad]."""
        return self.level_us + self.us_per_rad * angle_rad

    def angle_rad(self, pulse_us: float) -> float:
        """Angle [rad] of a pulse [us]: the inverse of `pulse_us`."""
        return (pulse_us - self.level_us) / self.us_per_rad

    def fields(self, limit_rad: float, rate_rad_s: float) -> tuple[int, ...]:
        """What the board is told of it, in the cable's units. ValueError: an angle up to the limit
        has no pulse in range, or the rate is out of the board's bounds.
        """
        ends = sorted((self.pulse_us(-limit_rad), self.pulse_us(limit_rad)))
        if not (self.lowest_us <= ends[0] and ends[1] <= self.highest_us):
            raise ValueError(
                f"an angle of {limit_rad:.3f} rad to each side takes pulses from {ends[0]:.0f} to "
                f"{ends[1]:.0f} us, the servo {self.lowest_us:g} to {self.highest_us:g} us: lower "
                "servo.angle_limit_rad, or correct the pulses"
            )
        if not LEAST_RATE_RAD_S <= rate_rad_s <= MOST_RATE_RAD_S:
            raise ValueError(
                f"servo.rate_limit_rad_s = {rate_rad_s:g}: a board takes {LEAST_RATE_RAD_S:g} to "
                f"{MOST_RATE_RAD_S:g} rad/s"
            )
        level, lowest, highest = (
            round(STEPS_US * us) for us in (self.level_us, self.lowest_us, self.highest_us)
        )
        slope, limit = round(10 * self.us_per_rad), int(STEPS_RAD * limit_rad)
        return level, slope, lowest, highest, limit, round(1000 * rate_rad_s)
