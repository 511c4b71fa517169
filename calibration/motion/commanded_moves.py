"""What servos that take an angle are told so that lag, limits, dead band and play show; no ball.

One axis after the other is told

* steps of many sizes to and fro, held for times of which no two are alike, so that neither the
  servo's period nor the tick is met in the same phase twice: lag, dead time, rate and acceleration;
* a slow triangle: dead band and play, which hold the angle back after a reversal;
* a staircase of steps about as small as a servo's dead band.
"""

from dataclasses import dataclass, replace

import numpy as np

from calibration.camera.sheet import CalibrationError
from rig.safety.limits import limit_angle
from rig.table import Table

REACH = 0.8  # share of the angle limit; chosen, since nothing is known of the servo yet
GOLDEN = 0.618034  # multiples of it, modulo 1, leave no gap and repeat nowhere
HOLD_S = (0.35, 0.65)  # chosen: 5 lags of a slow servo and more
CYCLES = 3
# Shares of the reach, each step to the other side of level than the one before.
STEPS = (1.0, 0.25, 0.6, 0.12, 0.85, 0.4)
TRIANGLE, TRIANGLE_S = 0.35, 6.0  # share of the reach; for a rise and a fall
STAIR_RAD, STAIRS, STAIR_S = 0.004, 8, 0.25
MOVED = 0.3  # share of what it is told; chosen: a servo that moves less does not follow


@dataclass(frozen=True, eq=False)
class Followed:
    """What the servos were told and where they were seen.

    t_s (n,), told_rad (n, 2): angles told from each tick to the next; seen_s (m,), seen_rad (m, 2):
    angles seen and when, NaN where an axis was not; in_phase: servos that take a command once a
    period take it at multiples of that, as simulated ones do, else nobody knows when.
    """

    t_s: np.ndarray
    told_rad: np.ndarray
    seen_s: np.ndarray
    seen_rad: np.ndarray
    in_phase: bool = True

    def while_told(self, axes: tuple[int, ...]) -> "Followed":
        """The part from the first to the last change of what `axes` are told, and a second more."""
        changed = np.flatnonzero(np.any(np.diff(self.told_rad[:, list(axes)], axis=0) != 0, axis=1))
        if not len(changed):
            return self
        begin, end = self.t_s[changed[0]] - 0.1, self.t_s[changed[-1]] + 1.0
        rows = (self.t_s >= begin) & (self.t_s <= end)
        seen = (self.seen_s >= begin) & (self.seen_s <= end)
        return replace(
            self,
            t_s=self.t_s[rows],
            told_rad=self.told_rad[rows],
            seen_s=self.seen_s[seen],
            seen_rad=self.seen_rad[seen],
        )


def moves(period_s: float, reach_rad: float, cycles: int = CYCLES) -> np.ndarray:
    """Angles (n,) [rad] for one axis, a tick of period_s each, within +-reach_rad, ending at 0."""
    parts, number = [np.zeros(round(0.2 / period_s))], 0
    for cycle in range(cycles):
        way = 1.0 if cycle % 2 == 0 else -1.0
        for share in STEPS:
            number += 1
            hold = HOLD_S[0] + (HOLD_S[1] - HOLD_S[0]) * (GOLDEN * number % 1.0)
            parts.append(np.full(round(hold / period_s), way * share * reach_rad))
            way = -way
        quarter = round(TRIANGLE_S / 4 / period_s)
        up = np.linspace(0.0, TRIANGLE * reach_rad, quarter)
        parts += [way * part for part in (up, up[::-1], -up, -up[::-1])]
        parts += _stairs(period_s, way * min(STAIR_RAD, 0.05 * reach_rad), number)
    return np.concatenate([*parts, np.zeros(round(0.5 / period_s))])


def _stairs(period_s: float, step_rad: float, number: int) -> list[np.ndarray]:
    places = [*range(STAIRS), *range(STAIRS, -1, -1)]
    holds = [STAIR_S * (0.7 + 0.6 * (GOLDEN * (number + k) % 1.0)) for k in range(len(places))]
    return [
        np.full(round(hold / period_s), step_rad * place)
        for place, hold in zip(places, holds, strict=True)
    ]


def moves_in_turn(period_s: float, angle_limit_rad: float, cycles: int = CYCLES) -> np.ndarray:
    """Angles (n, 2) [rad] for both axes: `moves` of one after the other, within the limit."""
    one = moves(period_s, REACH * angle_limit_rad, cycles)
    still = np.zeros_like(one)
    return np.concatenate((np.column_stack((one, still)), np.column_stack((still, one))))


def waves(period_s: float, seconds: float, hertz: tuple[float, ...], most_rad: float) -> np.ndarray:
    """Angles (n, 2) [rad] for `seconds`: sums of sines of the frequencies `hertz` [Hz] that come
    from level, amplitudes that sum to `most_rad`."""
    t = period_s * np.arange(round(seconds / period_s))
    one = sum(np.sin(2 * np.pi * f * t + i) for i, f in enumerate(hertz))
    one = most_rad / max(len(hertz), 1) * np.minimum(t / 0.5, 1.0) * one
    return np.column_stack((one, one))


def tell(table: Table, rows: np.ndarray, angle_limit_rad: float) -> Followed:
    """Tell both axes the angles `rows` (n, 2) [rad], a tick each; return what followed, NaN where
    nobody measures.

    What is told is bounded by `rig.safety.limits.limit_angle`; the table is told 0 at the end.
    """
    times, seen, told = [], [], []
    last = [0.0, 0.0]
    try:
        for row in rows:
            reading = table.read()
            last = [float(limit_angle(row[a], last[a], angle_limit_rad, 0.0)) for a in range(2)]
            table.drive((last[0], last[1]))
            times.append(reading.t_s)
            seen.append(reading.theta_rad)
            told.append(last)
    finally:
        table.drive((0.0, 0.0))
    return Followed(np.array(times), np.array(told), np.array(times), np.array(seen))


def check_directions(followed: Followed) -> None:
    """CalibrationError: an axis does not move, moves the wrong way, or moves the other's angle."""
    told = np.column_stack(
        [np.interp(followed.seen_s, followed.t_s, column) for column in followed.told_rad.T]
    )
    seen = followed.seen_rad
    good = np.isfinite(seen).all(axis=1)
    told, seen = told[good] - told[good].mean(axis=0), seen[good] - seen[good].mean(axis=0)
    gains = (told.T @ seen) / np.maximum(np.sum(told**2, axis=0), 1e-12)[:, None]  # told, seen
    for a, name in enumerate("xy"):
        own, other = gains[a, a], gains[a, 1 - a]
        if abs(other) > max(abs(own), MOVED):
            raise CalibrationError(
                f"direction signs: what servo {name} is told turns {'yx'[a]}: swap their plugs or "
                "their numbers"
            )
        if own < -MOVED:
            raise CalibrationError(
                f"direction signs: a positive command lowers the angle of servo {name}: turn its "
                "sign in the driver"
            )
        if own < MOVED:
            raise CalibrationError(
                f"servo {name} does not follow its commands (it moved by {own:.2f} of what it was "
                "told): is it powered, is its angle read back?"
            )
