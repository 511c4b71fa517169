"""The servos from ramps and pulses: breakaway volts, gain K, time constant tau, moving friction.

The motor obeys tau w' + w = K (V + V0 - F sgn w), with V0 the offset and F the friction; it stays
at rest while |V + V0| < F_static. From rest a ramp of r volts a second therefore moves it by

    theta(s) = K r (s^2/2 - tau s + tau^2 (1 - exp(-s/tau))),   s = t - t_breakaway,

and a pulse V of length T by the usual exponentials, up to the moment in which it stops again.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

from calibration.manoeuvres import Trace, perform, probe, pulses, ramps
from calibration.records import ServoAxis, ServoRecord, Value
from calibration.sheet import CalibrationError
from rig.table import Table

_MIN_MOVES = 3
_SHORTEST = 5  # ticks
_TAU_S = 0.035  # about any such servo's: enough for a rough look
# What a rigid motor leaves out of a drive with shafts and play, on simulated tables: it repeats, so
# the jackknife does not see it. Shares of K and tau, volts of offset and friction.
_MODEL = np.array((0.015, 0.025, 0.002, 0.01))
_STAND_S, _COUNT_RAD = 0.15, 0.0016


@dataclass(frozen=True, eq=False)
class Move:
    """One move from rest: t_s (n,) from the moment the volts began, volts (n,), angle (n,) from
    its value at rest; the first `driven` ticks are the move, the others the rest after it."""

    t_s: np.ndarray
    volts: np.ndarray
    theta_rad: np.ndarray
    driven: int

    @property
    def sign(self) -> float:
        return float(np.sign(self.volts[self.driven - 1] - self.volts[-1]))


def calibrate_servos(table: Table) -> tuple[ServoRecord, Trace, Trace]:
    """Measure both servos of a table without a ball; also what happened in ramps and pulses.

    A few ramps tell roughly the volts at which the motor feels none (an offset would else let the
    arm creep back through its play in every rest); then all are made from there. Raises
    `CalibrationError` on wrong directions, a dead motor or moves that do not fit.
    """
    probe(table)
    period = table.period_s
    rough = perform(table, (ramps(period, 0.0, 3), ramps(period, 0.0, 3)))
    bias = [_middle_V(moves(rough, a)) for a in range(2)]
    ramped = perform(table, (ramps(period, bias[0], 6), ramps(period, bias[1], 6)))
    pulsed = perform(table, (pulses(period, bias[0]), pulses(period, bias[1])))
    return servo_record(ramped, pulsed), ramped, pulsed


def _middle_V(found: list[Move]) -> float:
    both = [[breakaway_V(m, _TAU_S) for m in found if m.sign == sign] for sign in (1.0, -1.0)]
    return 0.5 * (mean_value(both[0], 2).value + mean_value(both[1], 2).value)


def servo_record(ramped: Trace, pulsed: Trace) -> ServoRecord:
    """The record of two traces; errors as `calibrate_servos`."""
    axes = []
    for a in range(2):
        gain, lag, offset, friction = fit_pulses(moves(pulsed, a))
        found = moves(ramped, a)
        up, down = (
            [breakaway_V(move, lag.value) for move in found if move.sign == sign]
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
    """The moves from rest of one axis, but for the first in each direction: it takes up play."""
    numbers, found, last_sign = trace.move[:, axis], [], 0.0
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
            found.append(move)
        last_sign = move.sign
    return found


def breakaway_V(move: Move, tau_s: float) -> float:
    """Volts at which a ramp moved its servo for good [V].

    A drive with play may creep to its far side first and stand there: what counts is the move
    after the last stand.
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
    """Angle (n,) of the model for a move of constant volts from rest, then none."""
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


def fit_pulses(found: list[Move]) -> tuple[Value, Value, Value, Value]:
    """K, tau, offset and friction of all pulses of one axis, with 95 % intervals by the jackknife
    over groups of pulses (what one pulse's model misses is alike all along it)."""
    if len(found) < 2 * _MIN_MOVES or len({move.sign for move in found}) < 2:
        raise CalibrationError(
            f"{len(found)} pulses can be used, {2 * _MIN_MOVES} in both directions are needed: "
            "does the servo move freely?"
        )

    def fit(some: list[Move]) -> np.ndarray:
        def left(p: np.ndarray) -> np.ndarray:
            return np.concatenate([1e3 * (pulse_angle(move, *p) - move.theta_rad) for move in some])

        bounds = ([0.01, 1e-3, -2.0, 0.0], [100.0, 1.0, 2.0, 3.0])
        scale = [1.0, 0.02, 0.1, 0.1]
        return least_squares(left, [1.6, 0.03, 0.0, 0.15], bounds=bounds, x_scale=scale).x

    best = fit(found)
    groups = min(8, len(found) // 2)
    parts = np.array([fit([m for i, m in enumerate(found) if i % groups != k]) for k in
                      range(groups)])  # fmt: skip
    std = np.sqrt((groups - 1) / groups * np.sum((parts - parts.mean(axis=0)) ** 2, axis=0))
    wide = float(student.ppf(0.975, groups - 1))
    values = [
        Value(value=float(v), low=float(v - wide * s - m), high=float(v + wide * s + m))
        for v, s, m in zip(best, std, _MODEL * (best[0], best[1], 1.0, 1.0), strict=True)
    ]
    return values[0], values[1], values[2], values[3]


def mean_value(numbers: list[float], least: int = _MIN_MOVES) -> Value:
    """Mean with its 95 % interval (Student). `CalibrationError` with fewer than `least`."""
    if len(numbers) < least:
        raise CalibrationError(
            f"{len(numbers)} ramps in one direction can be used, {least} are needed: does the "
            "servo move freely?"
        )
    mean, n = float(np.mean(numbers)), len(numbers)
    wide = float(student.ppf(0.975, n - 1)) * float(np.std(numbers, ddof=1)) / np.sqrt(n)
    return Value(value=mean, low=mean - wide, high=mean + wide)
