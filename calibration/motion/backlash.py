"""How much play there is, and where, from signals that a real rig has.

*Gear, with tachometer*: the integrated tachometer minus the encoder is o + s alpha + e theta + b t
in steady sweeps, s = +-1 the driving side, e and b the tachometer's scale error and offset.
*Gear, without*: from rest a strike of V volts takes the motor through the gap in the time t by

    gap = K (V - F) (t - tau (1 - exp(-t/tau))),

with one friction F for strikes of many sizes. *Joint*: the ball's run behind the play operator
(`rolling.py`). *Motor side alone* (volts and tachometer): in the gap the motor does not feel what
rubs behind it, so V - (w + tau w')/K over its way since a reversal steps up at the end of the whole
play, gear and joint together.

What is measured is lost motion: play plus the shafts' wind-up against friction. The wind-up follows
from the rig file's stiffness and friction and is known to about 0.3 of itself; that is in every
interval.
"""

from dataclasses import dataclass
from math import hypot, nan

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import savgol_filter
from scipy.stats import t as student

from calibration.play_moves import SPEED_RAD_S, Motion
from calibration.records import PlayAxis, Value
from calibration.rolling import RollingFit
from calibration.sheet import CalibrationError
from rig.parameters import GEARS_INERTIA_HIGH_KG_M2, Rig

WINDUP_UNSURE = 0.3  # share of the assumed wind-up, one standard deviation
STRIKE_UNSURE = 0.031  # share: K (3.2 %) over tau (4.3 %, both half ranges) of a unit, source D
FRICTION_V = (0.05, 0.08)  # of the motor alone: what is believed beforehand, and how unsurely
SKIP_RAD, SMOOTH_TICKS = 0.04, 9


@dataclass(frozen=True)
class Play:
    """A play's full width and its middle (from where the gear rested at the start; NaN: not seen),
    each with its standard deviation, and the freedom of what the data gave [rad]."""

    width_rad: float
    width_std: float
    freedom: float
    middle_rad: float = nan
    middle_std: float = nan

    @property
    def interval_rad(self) -> tuple[float, float]:
        """95 % interval of the width; no play is below zero."""
        wide = _wide(self.freedom) * self.width_std
        return max(self.width_rad - wide, 0.0), max(self.width_rad + wide, 0.0)

    def record(self) -> PlayAxis:
        """The same as a calibration file holds it."""
        low, high = self.interval_rad
        middle = None
        if np.isfinite(self.middle_std):
            wide = _wide(self.freedom) * self.middle_std
            middle = Value(
                value=self.middle_rad, low=self.middle_rad - wide, high=self.middle_rad + wide
            )
        width = Value(value=max(self.width_rad, 0.0), low=low, high=high)
        return PlayAxis(width_rad=width, middle_rad=middle, symmetric=self.symmetric)

    @property
    def symmetric(self) -> bool | None:
        """Whether the middle's interval holds zero; None where the middle is not seen."""
        if not np.isfinite(self.middle_std):
            return None
        return bool(abs(self.middle_rad) <= _wide(self.freedom) * self.middle_std)


def _wide(freedom: float) -> float:
    return float(student.ppf(0.975, max(freedom, 1.0)))


def _gear_windup(rig: Rig) -> float:
    load = rig.drive.arm_friction_nm + rig.drive.joint_friction_nm
    return 2 * load / rig.drive.gear_stiffness_nm_rad


def _joint_windup(rig: Rig) -> float:
    return 2 * rig.drive.joint_friction_nm / rig.drive.joint_stiffness_nm_rad


def gear_by_tachometer(motion: Motion, axis: int, rig: Rig) -> Play:
    """The gear's play from sweeps with encoder and tachometer."""
    theta, speed, label = (x[:, axis] for x in (motion.theta_rad, motion.speed_rad_s, motion.label))
    period, step = float(np.median(np.diff(motion.t_s))), rig.servo.encoder_step_rad
    motor = theta[0] + np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * period)))
    rows, sides, groups = [], [], []
    for number in range(1, int(label.max(initial=0)) + 1):
        way = 1.0 if number % 2 else -1.0
        at = np.flatnonzero((label == number) & (np.diff(theta, prepend=theta[0]) * way > 0))
        if not len(at):
            continue
        near, far = theta[at[0]], theta[at[-1]]
        steady = (np.abs(theta[at] - near) > SKIP_RAD) & (np.abs(theta[at] - far) > 0.5 * SKIP_RAD)
        at = at[steady]
        behind = np.maximum(0.5 * (step - np.abs(speed[at]) * period), 0.0)
        for k, late in zip(at, behind, strict=True):
            rows.append((1.0, way, theta[k], motion.t_s[k]))
            sides.append(motor[k] - (theta[k] - way * late))
            groups.append(number)
    if len(set(groups)) < 6:
        raise CalibrationError(
            f"axis {'xy'[axis]}: {len(set(groups))} steady sweeps, 6 are needed: does it move?"
        )
    found, cov = _clustered(np.array(rows), np.array(sides), np.array(groups))
    windup, freedom = _gear_windup(rig), len(set(groups)) - 4
    width = 2 * found[1] - windup
    std = hypot(2 * cov[1, 1] ** 0.5, WINDUP_UNSURE * windup, _encoder_std(rig))
    return Play(width, std, freedom, float(found[0]), hypot(cov[0, 0] ** 0.5, 0.5 * step))


def _encoder_std(rig: Rig) -> float:
    """What half counts and their corrections leave, of a full width [rad]."""
    return rig.servo.encoder_step_rad / 6


def _clustered(rows: np.ndarray, sides: np.ndarray, groups: np.ndarray):
    """Least squares with a covariance from the scatter of whole sweeps, (p,) and (p, p)."""
    inverse = np.linalg.pinv(rows.T @ rows)
    found = inverse @ rows.T @ sides
    left, meat = sides - rows @ found, np.zeros_like(inverse)
    names = np.unique(groups)
    for name in names:
        g = rows[groups == name].T @ left[groups == name]
        meat += np.outer(g, g)
    n = len(names)
    return found, inverse @ meat @ inverse * n / max(n - rows.shape[1], 1)


def offset_V(motion: Motion, axis: int) -> float:
    """The volts at which the motor feels none: the middle of those of sweeps up and down."""
    label, volts = motion.label[:, axis], motion.volts[:, axis]
    last = int(label.max(initial=0))
    means = [np.median(volts[label == number]) for number in range(1, last + 1)]
    if len(means) < 2:
        raise CalibrationError(f"axis {'xy'[axis]}: no sweeps to and fro: does it move?")
    return float(0.5 * (np.mean(means[0::2]) + np.mean(means[1::2])))


def _struck(motion: Motion, axis: int, bias_V: float, step_rad: float) -> np.ndarray:
    """Of every strike that moved the arm: volts, time to its second count [s], direction; (n, 3).

    An arm that rests at a count's edge shows the first one as soon as its shaft unwinds.
    """
    theta, label = motion.theta_rad[:, axis], motion.label[:, axis]
    period, found = float(np.median(np.diff(motion.t_s))), []
    for number in range(1, int(label.max(initial=0)) + 1):
        at = np.flatnonzero(label == number)
        way = 1.0 if number % 2 else -1.0
        if not len(at):
            continue
        moved = np.flatnonzero((theta[at[0] :] - theta[at[0]]) * way > 1.5 * step_rad)
        if len(moved):
            volts = abs(float(np.median(motion.volts[at, axis])) - bias_V)
            found.append((volts, (moved[0] - 0.5) * period, way))
    return np.array(found).reshape(-1, 3)


def gear_by_strikes(motion: Motion, axis: int, rig: Rig, bias_V: float) -> Play:
    """The gear's play from strikes, encoder and volts alone. `CalibrationError` where up and down
    disagree: then the motor crept through the gap while it should have rested."""
    step = rig.servo.encoder_step_rad
    volts, times, ways = _struck(motion, axis, bias_V, step).T
    if min(np.sum(ways > 0), np.sum(ways < 0)) < 4:
        raise CalibrationError(f"axis {'xy'[axis]}: {len(ways)} strikes moved it, 8 are needed")
    gain, lag = rig.servo.gain_rad_s_V, _lag_alone_s(rig)
    shape = times - lag * (1 - np.exp(-times / lag))
    speed = gain * volts * (1 - np.exp(-times / lag))
    period = float(np.median(np.diff(motion.t_s)))
    noise = np.hypot(0.3 * step, speed * period / 12**0.5)

    def left(p: np.ndarray) -> np.ndarray:
        gap = np.where(ways > 0, p[0], p[1])
        return np.append(
            (gain * (volts - p[2]) * shape - gap) / noise, (p[2] - FRICTION_V[0]) / FRICTION_V[1]
        )

    fit = least_squares(left, (0.01, 0.01, 0.08), x_scale=(0.01, 0.01, 0.05), loss="soft_l1")
    n, up, down = len(volts), float(fit.x[0]), float(fit.x[1])
    cov = np.linalg.pinv(fit.jac.T @ fit.jac) * max(2 * fit.cost / (n - 2), 1.0)
    mean, apart = 0.5 * (up + down), abs(up - down)
    loose = np.array((1.0, -1.0, 0.0))
    if apart > 0.2 * mean + 4 * float(loose @ cov @ loose) ** 0.5:
        raise CalibrationError(
            f"axis {'xy'[axis]}: strikes up and down find {up:.4f} and {down:.4f} rad: the motor "
            "creeps in its rests; measure with the tachometer, or calibrate the servo's offset"
        )
    half = np.array((0.5, 0.5, 0.0))
    windup = 0.5 * _gear_windup(rig)  # of one side: at rest the other has unwound
    std = hypot(float(half @ cov @ half) ** 0.5, 0.5 * apart, STRIKE_UNSURE * mean,
                WINDUP_UNSURE * windup)  # fmt: skip
    # Once the teeth meet the motor turns arm and plate too: slower by its share of the inertia.
    counts = 1.5 * step * rig.servo.time_constant_s / lag
    return Play(mean - counts - windup, std, n - 3)


def _lag_alone_s(rig: Rig) -> float:
    """The motor's time constant in the gap, where it turns neither arm nor plate."""
    load = GEARS_INERTIA_HIGH_KG_M2 + rig.drive.plate_inertia_kg_m2
    return rig.servo.time_constant_s * (1 - load / rig.servo.inertia_kg_m2)


def joint_by_ball(fit: RollingFit, rig: Rig) -> Play:
    """The joint's play from the ball's run; its middle is a level error's twin and not seen."""
    windup = _joint_windup(rig)
    width, std = fit.play_rad
    return Play(width - windup, hypot(std, WINDUP_UNSURE * windup), fit.windows - 4)


def whole_by_motor(motion: Motion, axis: int, rig: Rig) -> Play:
    """Gear and joint play together from volts and tachometer alone."""
    speed, volts, label = (x[:, axis] for x in (motion.speed_rad_s, motion.volts, motion.label))
    period = float(np.median(np.diff(motion.t_s)))
    smooth = np.asarray(savgol_filter(speed, SMOOTH_TICKS, 2))
    pace = np.asarray(savgol_filter(speed, SMOOTH_TICKS, 2, deriv=1, delta=period))
    gain, lag = rig.servo.gain_rad_s_V, rig.servo.time_constant_s
    felt = volts - (smooth + lag * pace) / gain  # friction and offset, in volts
    motor = np.cumsum(speed) * period
    ways, curves = [], []
    for number in range(2, int(label.max(initial=0)) + 1):
        at, way = np.flatnonzero(label == number), 1.0 if number % 2 else -1.0
        turned = at[smooth[at] * way > 0.02]
        if len(turned) < 50:
            continue
        part = np.arange(turned[0], at[-1] + 1)
        ways.append(way * (motor[part] - motor[part[0]]))
        curves.append(way * felt[part])
    if len(ways) < 6:
        raise CalibrationError(f"axis {'xy'[axis]}: {len(ways)} reversals, 6 are needed")
    ends = np.array([_step_at(x, y) for x, y in zip(ways, curves, strict=True)])
    up, down = ends[0::2], ends[1::2]
    good = np.concatenate((up[np.isfinite(up)], down[np.isfinite(down)]))
    if len(good) < 6:
        raise CalibrationError(f"axis {'xy'[axis]}: too little friction behind the play to see it")
    windup = _gear_windup(rig) + _joint_windup(rig)
    # The shafts unwind while the motor is still turning back: its way begins where they are slack.
    lag_rad = 0.5 * SPEED_RAD_S * period
    width = float(np.median(good)) + lag_rad
    spread = 1.2533 * 1.4826 * float(np.median(np.abs(good - np.median(good))))
    std = hypot(spread / len(good) ** 0.5, WINDUP_UNSURE * windup, 2 * lag_rad)
    return Play(width, std, len(good) - 1)


def _step_at(way: np.ndarray, felt: np.ndarray, longest: float = 0.2) -> float:
    """Where the curve steps up: the split whose two levels fit best; NaN where it does not."""
    use = way < longest
    x, y = way[use], felt[use]
    if len(x) < 40:
        return nan
    count = np.arange(1, len(y))
    total, squares = np.cumsum(y), np.cumsum(y * y)
    low, high = total[:-1] / count, (total[-1] - total[:-1]) / (len(y) - count)
    cost = squares[-1] - count * low**2 - (len(y) - count) * high**2
    cost[:3] = cost[-10:] = np.inf
    k = int(np.argmin(np.where(high > low, cost, np.inf)))
    left = np.sqrt(cost[k] / len(y))
    return float(x[k]) if high[k] - low[k] > 2 * left else nan
