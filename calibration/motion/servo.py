"""The servos from ramps and pulses: breakaway volts, gain K, time constant tau, moving friction.

The motor obeys tau w' + w = K (V + V0 - F sgn w), with V0 the offset and F the friction; it stays
at rest while |V + V0| < F_static. From rest a ramp of r volts a second therefore moves it by

    theta(s) = K r (s^2/2 - tau s + tau^2 (1 - exp(-s/tau))),   s = t - t_breakaway,

and a pulse V of length T by the usual exponentials, up to the moment in which it stops again.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from calibration.camera.sheet import CalibrationError
from calibration.motion.manoeuvres import Trace, perform, probe, pulses, ramps
from calibration.records import ServoAxis, ServoRecord, Value
from calibration.statistics import jackknife_std, mean_with_half_width, student_quantile
from rig.table import Table

_MIN_MOVES = 3
_SHORTEST = 5  # ticks; chosen: what ends sooner is noise of the encoder
_TAU_S = 0.035  # about any such servo's, for the rough first ramps alone
# Error of a rigid motor as the model of a drive with shafts and backlash, from simulated tables; it
# is alike in all moves, so the jackknife does not see it. Shares of K, tau; volts of the others.
_MODEL = np.array((0.015, 0.025, 0.002, 0.01))
_STAND_S, _COUNT_RAD = 0.15, 0.0016


@dataclass(frozen=True, eq=False)
class Move:
    """One move from rest: `t_s` (n,) from the moment at which the volts began, applied volts (n,),
    angle (n,) relative to its value at rest; the first `driven` ticks are the move, the others the
    rest after it."""

    t_s: np.ndarray
    volts: np.ndarray
    theta_rad: np.ndarray
    driven: int

    @property
    def sign(self) -> float:
        """Direction of the move, 1.0 up or -1.0 down."""
        return float(np.sign(self.volts[self.driven - 1] - self.volts[-1]))


def calibrate_servos(table: Table) -> tuple[ServoRecord, Trace, Trace]:
    """Measure both servos of a table without a ball: the record, then the traces of ramps and of
    pulses.

    A few ramps first find roughly the volts at which each motor feels no torque; all other moves
    start from there, so that no arm creeps back through its backlash at rest. `CalibrationError`:
    wrong signs or axes, a motor that does not turn, or too few moves that can be used.
    """
    probe(table)
    period = table.period_s
    rough = perform(table, (ramps(period, 0.0, 3), ramps(period, 0.0, 3)))
    bias = [_middle_V(moves(rough, a)) for a in range(2)]
    ramped = perform(table, (ramps(period, bias[0], 6), ramps(period, bias[1], 6)))
    pulsed = perform(table, (pulses(period, bias[0]), pulses(period, bias[1])))
    return servo_record(ramped, pulsed), ramped, pulsed


def _middle_V(ramped: list[Move]) -> float:
    """The middle of the breakaway volts up and down."""
    both = [[breakaway_V(m, _TAU_S) for m in ramped if m.sign == sign] for sign in (1.0, -1.0)]
    return 0.5 * (mean_value(both[0], 2).value + mean_value(both[1], 2).value)


def servo_record(ramped: Trace, pulsed: Trace) -> ServoRecord:
    """Fit both servos to the traces of `ramps` and of `pulses`, with 95 % intervals.
    `CalibrationError`: too few ramps or pulses in a direction that can be used."""
    axes = []
    for a in range(2):
        gain, lag, offset, friction = fit_pulses(moves(pulsed, a))
        up, down = (
            [breakaway_V(move, lag.value) for move in moves(ramped, a) if move.sign == sign]
            for sign in (1.0, -1.0)
        )
        axes.append(
            ServoAxis(
                breakaway_positive_V=mean_value(up),
                breakaway_negative_V=mean_value(down),
                gain_rad_s_V=gain,
                time_constant_s=lag,
                offset_V=offset,
                friction_V=friction,
                sign=1,
            )
        )
    return ServoRecord(x=axes[0], y=axes[1])


def moves(trace: Trace, axis: int) -> list[Move]:
    """The moves from rest of one axis (0 x, 1 y), without the first in each direction, which takes
    up the backlash, and without those of under 5 driven ticks."""
    numbers, used, last_sign = trace.move[:, axis], [], 0.0
    for number in range(1, int(numbers.max(initial=0)) + 1):
        rows = np.flatnonzero(np.abs(numbers) == number)
        driven = int(np.sum(numbers == number))
        if driven < _SHORTEST:
            continue
        # The angle read at a tick is that before its volts act.
        t, theta = trace.t_s[rows], trace.theta_rad[rows, axis]
        volts = trace.volts[rows, axis]
        move = Move(t - t[0], volts, theta - theta[0], driven)
        if move.sign == last_sign:
            used.append(move)
        last_sign = move.sign
    return used


def breakaway_V(move: Move, tau_s: float) -> float:
    """Volts [V] at which a ramp moved its servo for good: the ramp's start in the module's equation
    for theta(s), fitted to the angle with time constant `tau_s`.

    A drive with backlash may creep to its far side first and stand there, so only the rise after
    the last stand counts.
    """
    t, theta = move.t_s[: move.driven], move.sign * move.theta_rad[: move.driven]
    later = np.searchsorted(t, t + _STAND_S)
    later[later >= len(t)] = len(t) - 1
    stands = (theta[later] - theta <= _COUNT_RAD) & (t + _STAND_S < t[-1])
    last = int(np.flatnonzero(stands)[-1]) if stands.any() else 0
    rise = theta - theta[last]
    used = (np.arange(len(t)) > last) & (rise > 2 * _COUNT_RAD)
    rate = abs(move.volts[move.driven - 1] - move.volts[0]) / (t[-1] - t[0])
    start = float(t[-1] - np.sqrt(2 * rise[-1] / (1.6 * rate)))

    def left(p: np.ndarray) -> np.ndarray:
        s = np.maximum(t[used] - p[0], 0.0)
        return 1e3 * (p[1] * _ramp_answer(s, tau_s) - rise[used])

    fit = least_squares(left, [start, 1.6 * rate])
    return float(move.volts[0]) + move.sign * rate * float(fit.x[0])


def _ramp_answer(s: np.ndarray, tau: float) -> np.ndarray:
    return s * s / 2 - tau * s + tau * tau * (1 - np.exp(-s / tau))


def pulse_angle(move: Move, gain: float, tau: float, offset: float, friction: float) -> np.ndarray:
    """Angle (n,) [rad] that the module's motor equation gives at the times of `move`: constant
    volts from rest, then the rest's volts until it stops. `gain` K [rad/s/V], `tau` [s], `offset`
    V0 and `friction` F [V]."""
    n, period, sign = move.driven, move.t_s[1] - move.t_s[0], move.sign
    first = move.volts[0] / move.volts[n - 1]  # the clamp lets large volts grow within a tick
    length = (n - 1 + first) * period
    t = np.maximum(move.t_s - (1 - first) * period, 0.0)
    drive = gain * (sign * (move.volts[n - 1] + offset) - friction)
    brake = gain * (sign * (move.volts[-1] + offset) - friction)  # the speed's aim afterwards
    on, off = np.minimum(t, length), np.maximum(t - length, 0.0)
    theta = drive * (on - tau * (1 - np.exp(-on / tau)))
    speed = drive * (1 - np.exp(-length / tau))
    if brake < 0:
        off = np.minimum(off, tau * np.log(1 - speed / brake))
    theta += brake * off + (speed - brake) * tau * (1 - np.exp(-off / tau))
    return sign * theta


def fit_pulses(pulsed: list[Move]) -> tuple[Value, Value, Value, Value]:
    """K [rad/s/V], tau [s], offset and friction [V] by least squares over all pulses `pulsed` of
    one axis, with 95 % intervals.

    The intervals come from the jackknife over up to 8 groups of pulses, since errors within a pulse
    are correlated, widened by the model's own error. `CalibrationError`: under 6 pulses, or all in
    one direction.
    """
    if len(pulsed) < 2 * _MIN_MOVES or len({move.sign for move in pulsed}) < 2:
        raise CalibrationError(
            f"{len(pulsed)} pulses can be used, {2 * _MIN_MOVES} in both directions are needed: "
            "does the servo move freely?"
        )

    def fit(some: list[Move]) -> np.ndarray:
        def left(p: np.ndarray) -> np.ndarray:
            return np.concatenate([1e3 * (pulse_angle(move, *p) - move.theta_rad) for move in some])

        bounds = ([0.01, 1e-3, -2.0, 0.0], [100.0, 1.0, 2.0, 3.0])
        scale = [1.0, 0.02, 0.1, 0.1]
        return least_squares(left, [1.6, 0.03, 0.0, 0.15], bounds=bounds, x_scale=scale).x

    best = fit(pulsed)
    groups = min(8, len(pulsed) // 2)
    without_one = [
        fit([m for i, m in enumerate(pulsed) if i % groups != left_out])
        for left_out in range(groups)
    ]
    half = student_quantile(groups - 1) * jackknife_std(np.array(without_one))
    half += _MODEL * (best[0], best[1], 1.0, 1.0)
    gain, lag, offset, friction = map(Value.around, best.tolist(), half.tolist())
    return gain, lag, offset, friction


def mean_value(numbers: list[float], least: int = _MIN_MOVES) -> Value:
    """Mean of repeated measurements `numbers` with its 95 % interval, in their unit.
    `CalibrationError`: fewer than `least`.
    """
    if len(numbers) < least:
        raise CalibrationError(
            f"{len(numbers)} ramps in one direction can be used, {least} are needed: does the "
            "servo move freely?"
        )
    return Value.around(*mean_with_half_width(numbers))
