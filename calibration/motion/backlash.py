"""Backlash of gear and joint from signals that a real table has: tachometer, encoder, volts, ball.

*Gear, with tachometer* (`gear_by_tachometer`): in steady sweeps the integrated tachometer minus the
encoder is o + s alpha + e theta + b t, with s = +-1 the side on which the teeth drive, 2 alpha the
full width, e and b the tachometer's scale error and offset; linear least squares.

*Gear, without tachometer* (`gear_by_strikes`): from rest V volts take the motor (gain K, time
constant tau, friction F) through the gap in the time t,

    gap = K (V - F) (t - tau (1 - exp(-t/tau))),

fitted to strikes of many sizes with one F.

*Joint* (`joint_by_ball`): the ball's motion behind the joint's backlash (`rolling.py`).

*Gear and joint together* (`whole_by_motor`), from volts and tachometer: in the gap the motor does
not feel the friction behind it, so V - (w + tau w')/K steps up where the way since a reversal has
passed both widths.

All measure lost motion: backlash plus the shafts' wind-up against friction. The wind-up
follows from the rig file's stiffness and friction; its uncertainty (WINDUP_UNSURE) is in every
interval.
"""

from dataclasses import dataclass
from math import hypot, nan

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import savgol_filter

from calibration.camera.sheet import CalibrationError
from calibration.motion.manoeuvres import SWEEP_RAD_S, Trace
from calibration.motion.rolling import RollingFit
from calibration.records import BacklashAxis, Value
from calibration.statistics import clustered_covariance, student_quantile
from rig.parameters import GEARS_INERTIA_HIGH_KG_M2, Rig

WINDUP_UNSURE = 0.3  # share of the assumed wind-up, one standard deviation; chosen
LOAD_UNSURE = 0.3  # share, where the ball's weight against an assumed friction decides; simulated
STRIKE_UNSURE = 0.031  # share: K (3.2 %) over tau (4.3 %, both half ranges) of a unit, source D
FRICTION_V = (0.05, 0.08)  # of the motor alone: mean and standard deviation known beforehand
SKIP_RAD, SMOOTH_TICKS = 0.04, 9  # chosen: past the acceleration; 18 ms


@dataclass(frozen=True)
class BacklashEstimate:
    """Full width of a backlash and its middle, relative to where the gear rested at the start (NaN:
    not seen), each with its standard deviation [rad]; `freedom`: degrees of freedom of the
    scatter."""

    width_rad: float
    width_std: float
    freedom: float
    middle_rad: float = nan
    middle_std: float = nan

    @property
    def interval_rad(self) -> tuple[float, float]:
        """95 % interval (low, high) of the width [rad], cut off at zero."""
        half = student_quantile(self.freedom) * self.width_std
        return max(self.width_rad - half, 0.0), max(self.width_rad + half, 0.0)

    def record(self) -> BacklashAxis:
        """The estimate as a calibration file holds it, with 95 % intervals; a negative width
        becomes 0."""
        low, high = self.interval_rad
        middle = None
        if np.isfinite(self.middle_std):
            half = student_quantile(self.freedom) * self.middle_std
            middle = Value.around(self.middle_rad, half)
        width = Value(value=max(self.width_rad, 0.0), low=low, high=high)
        return BacklashAxis(width_rad=width, middle_rad=middle, symmetric=self.symmetric)

    @property
    def symmetric(self) -> bool | None:
        """Whether the middle's 95 % interval holds zero; None where the middle is not seen."""
        if not np.isfinite(self.middle_std):
            return None
        return bool(abs(self.middle_rad) <= student_quantile(self.freedom) * self.middle_std)


def _gear_windup(rig: Rig) -> float:
    load = rig.drive.arm_friction_nm + rig.drive.joint_friction_nm
    return 2 * load / rig.drive.gear_stiffness_nm_rad


def _joint_windup(rig: Rig) -> float:
    return 2 * rig.drive.joint_friction_nm / rig.drive.joint_stiffness_nm_rad


def gear_by_tachometer(trace: Trace, axis: int, rig: Rig) -> BacklashEstimate:
    """The gear's backlash from a trace of `sweeps` with encoder and tachometer: the module's first
    method, linear least squares with clustered standard deviations.

    `axis`: 0 x, 1 y; `rig` gives the encoder's step and the shafts' wind-up, which is subtracted.
    `CalibrationError`: under 6 steady sweeps.
    """
    theta, speed, label = (x[:, axis] for x in (trace.theta_rad, trace.speed_rad_s, trace.move))
    period, step = float(np.median(np.diff(trace.t_s))), rig.servo.encoder_step_rad
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
            rows.append((1.0, way, theta[k], trace.t_s[k]))
            sides.append(motor[k] - (theta[k] - way * late))
            groups.append(number)
    if len(set(groups)) < 6:
        raise CalibrationError(
            f"axis {'xy'[axis]}: {len(set(groups))} steady sweeps, 6 are needed: does it move?"
        )
    columns, left_side = np.array(rows), np.array(sides)
    found = np.linalg.pinv(columns.T @ columns) @ columns.T @ left_side
    cov = clustered_covariance(columns, left_side - columns @ found, np.array(groups))
    windup, freedom = _gear_windup(rig), len(set(groups)) - 4
    width = 2 * found[1] - windup
    std = hypot(2 * cov[1, 1] ** 0.5, WINDUP_UNSURE * windup, _encoder_std(rig))
    return BacklashEstimate(
        width, std, freedom, float(found[0]), hypot(cov[0, 0] ** 0.5, 0.5 * step)
    )


def _encoder_std(rig: Rig) -> float:
    """What half counts and their corrections leave, of a full width [rad]."""
    return rig.servo.encoder_step_rad / 6


def offset_V(trace: Trace, axis: int) -> float:
    """The volts [V] at which the motor feels no torque: the mean of the median volts of `sweeps` up
    and of those down. `axis`: 0 x, 1 y.

    `CalibrationError`: under 2 sweeps.
    """
    label, volts = trace.move[:, axis], trace.volts[:, axis]
    last = int(label.max(initial=0))
    means = [np.median(volts[label == number]) for number in range(1, last + 1)]
    if len(means) < 2:
        raise CalibrationError(f"axis {'xy'[axis]}: no sweeps to and fro: does it move?")
    return float(0.5 * (np.mean(means[0::2]) + np.mean(means[1::2])))


def _strikes_that_moved(trace: Trace, axis: int, bias_V: float, step_rad: float) -> np.ndarray:
    """Of every strike that moved the arm: volts, time to its second count [s], direction; (n, 3).

    An arm that rests at a count's edge shows the first one as soon as its shaft unwinds.
    """
    theta, label = trace.theta_rad[:, axis], trace.move[:, axis]
    period, found = float(np.median(np.diff(trace.t_s))), []
    for number in range(1, int(label.max(initial=0)) + 1):
        at = np.flatnonzero(label == number)
        way = 1.0 if number % 2 else -1.0
        if not len(at):
            continue
        moved = np.flatnonzero((theta[at[0] :] - theta[at[0]]) * way > 1.5 * step_rad)
        if len(moved):
            volts = abs(float(np.median(trace.volts[at, axis])) - bias_V)
            found.append((volts, (moved[0] - 0.5) * period, way))
    return np.array(found).reshape(-1, 3)


def gear_by_strikes(trace: Trace, axis: int, rig: Rig, bias_V: float) -> BacklashEstimate:
    """The gear's backlash from a trace of `strikes` about `bias_V`, by encoder and volts alone: the
    module's second method, robust nonlinear least squares. `axis`: 0 x, 1 y.

    `CalibrationError`: under 4 strikes in a direction that moved the arm, or strikes up and down
    disagree: then the motor crept through the gap while it should have rested.
    """
    step = rig.servo.encoder_step_rad
    volts, times, ways = _strikes_that_moved(trace, axis, bias_V, step).T
    if min(np.sum(ways > 0), np.sum(ways < 0)) < 4:
        raise CalibrationError(f"axis {'xy'[axis]}: {len(ways)} strikes moved it, 8 are needed")
    gain, lag = rig.servo.gain_rad_s_V, _lag_alone_s(rig)
    shape = times - lag * (1 - np.exp(-times / lag))
    speed = gain * volts * (1 - np.exp(-times / lag))
    period = float(np.median(np.diff(trace.t_s)))
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
    fitted_std = float(half @ cov @ half) ** 0.5
    std = hypot(fitted_std, 0.5 * apart, STRIKE_UNSURE * mean, WINDUP_UNSURE * windup)
    # Once the teeth meet the motor turns arm and plate too: slower by its share of the inertia.
    counts = 1.5 * step * rig.servo.time_constant_s / lag
    return BacklashEstimate(mean - counts - windup, std, n - 3)


def _lag_alone_s(rig: Rig) -> float:
    """The motor's time constant in the gap, where it turns neither arm nor plate."""
    load = GEARS_INERTIA_HIGH_KG_M2 + rig.drive.plate_inertia_kg_m2
    return rig.servo.time_constant_s * (1 - load / rig.servo.inertia_kg_m2)


def joint_by_ball(fit: RollingFit, rig: Rig) -> BacklashEstimate:
    """The joint's backlash from the ball's motion, less the shaft's wind-up. The middle stays
    unknown (NaN): it cannot be told from a level error."""
    windup = _joint_windup(rig)
    width, std = fit.backlash_rad
    friction = LOAD_UNSURE * width if fit.loaded else 0.0
    return BacklashEstimate(
        width - windup, hypot(std, WINDUP_UNSURE * windup, friction), fit.freedom
    )


def whole_by_motor(trace: Trace, axis: int, rig: Rig) -> BacklashEstimate:
    """Gear and joint backlash together from a trace of `sweeps` with volts and tachometer alone:
    the median way of the motor from a reversal to the step of the friction (the module's last
    method).

    `axis`: 0 x, 1 y. `CalibrationError`: under 6 reversals, or too little friction behind the
    backlash to see the step.
    """
    speed, volts, label = (x[:, axis] for x in (trace.speed_rad_s, trace.volts, trace.move))
    period = float(np.median(np.diff(trace.t_s)))
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
    lag_rad = 0.5 * SWEEP_RAD_S * period
    width = float(np.median(good)) + lag_rad
    spread = 1.2533 * 1.4826 * float(np.median(np.abs(good - np.median(good))))
    std = hypot(spread / len(good) ** 0.5, WINDUP_UNSURE * windup, 2 * lag_rad)
    return BacklashEstimate(width, std, len(good) - 1)


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
