"""What a run's log says in numbers: where the ball was, how it cycled, what the servos did.

Pure functions of a `Log`. Only rows of phase 2 (run) count, times from the first of them; a log
without phases (an import) is a run from its first row. Ball samples are new observations alone, at
the time when the light hit the sensor. What a log lacks is NaN: an axis, the ball, a channel.
"""

from dataclasses import dataclass
from itertools import pairwise
from math import nan, pi, sqrt
from typing import Any

import numpy as np

from experiments.centroids import Place, Samples, ball_samples, mean_seen, place, run_part
from experiments.statistics import WithinRun, within_run_interval
from rig.log import Log
from rig.parameters import Rig

GAP_S = 0.25  # a ball unseen for longer was not there
SMOOTH_S = 0.1  # far below any period of the ball's loop (3 s)
FEWEST_CYCLES = 2


@dataclass(frozen=True)
class Cycle:
    """Limit cycle of one axis: amplitude of its fundamental, period, whole cycles seen.

    NaN with a reason where fewer than two whole cycles rise above the noise.
    """

    amplitude_m: float
    period_s: float
    cycles: int
    reason: str = ""


@dataclass(frozen=True, eq=False)
class RunMetrics:
    """A run in SI units; pairs (2,) are x, y.

    centroid_m to error_rms_m: over the whole run, as in `Place`; settled: the same after
    `settling_s`, or over the last half where the ball never settled (`has_settled` False); cycle:
    of that part, x and y. servo_rms_rad: RMS about zero, servo_activity_rad: standard deviation,
    servo_tracking_rad: RMS of theta - desired_theta, all of that part; *_whole_*: of the whole run.
    unseen_at_end_s: how long the ball had not been seen at the end, a lost ball's time is not
    counted to its servos. pushes: None where the log does not say. Plays: last estimates.
    """

    duration_s: float
    samples: int
    centroid_m: np.ndarray
    distance_m: float
    spread_m: float
    error_rms_m: float
    settling_s: float
    has_settled: bool
    settled: Place
    cycle: tuple[Cycle, Cycle]
    servo_rms_rad: np.ndarray
    servo_activity_rad: np.ndarray
    servo_tracking_rad: np.ndarray
    servo_tracking_whole_rad: np.ndarray
    voltage_rms_V: np.ndarray
    pushes: int | None
    unseen_at_end_s: float
    gear_play_rad: np.ndarray
    gear_play_std_rad: np.ndarray
    joint_play_rad: np.ndarray
    joint_play_std_rad: np.ndarray


def run_metrics(
    log: Log, *, band_m: float = 0.02, stay_s: float = 1.0, servo_only: bool = False
) -> RunMetrics:
    """Compute every number of one run; `band_m` and `stay_s` say what counts as settled.

    `servo_only`: targets are servo angles, whatever the camera saw on the plate is left out.
    """
    run, ball = run_part(log), ball_samples(log)
    if servo_only:
        ball = ball.where(slice(0, 0))
    t = run["t_s"] - run["t_s"][:1]
    duration = float(t[-1] + np.median(np.diff(t))) if len(t) > 1 else 0.0
    unseen = duration - float(ball.until_s[-1]) if len(ball.t_s) else nan
    end = duration - unseen if unseen > GAP_S else duration
    settling = settling_time(ball, band_m=band_m, stay_s=stay_s)
    begin = end / 2 if np.isnan(settling) else settling
    after = ball.where(ball.t_s >= begin)
    return RunMetrics(
        duration_s=duration,
        **vars(place(ball)),
        settling_s=settling,
        has_settled=not np.isnan(settling),
        settled=place(after),
        cycle=limit_cycle(undisturbed(after, band_m)),
        **_servos(run, run.where((t >= begin) & (t <= end))),
        pushes=_episodes(run["push"]) if run.has("push") else None,
        unseen_at_end_s=unseen,
        **_plays(run),
    )


def _servos(run: Log, calm: Log) -> dict[str, Any]:
    """Numbers of the servos over the whole run and its settled part."""
    theta, whole = _pair(calm, "theta_{}_rad"), _pair(run, "theta_{}_rad")
    return {
        "servo_rms_rad": _rms(theta),
        "servo_activity_rad": _rms(theta - mean_seen(theta)),
        "servo_tracking_rad": _rms(theta - _pair(calm, "desired_theta_{}_rad")),
        "servo_tracking_whole_rad": _rms(whole - _pair(run, "desired_theta_{}_rad")),
        "voltage_rms_V": _rms(_pair(run, "voltage_{}_V")),
    }


def _plays(run: Log) -> dict[str, Any]:
    """Read the last estimates of the plays and their standard deviations."""
    names = ("gear_play", "gear_play_std", "joint_play", "joint_play_std")
    return {f"{name}_rad": _last(_pair(run, f"estimated_{name}_{{}}_rad")) for name in names}


def _pair(log: Log, name: str) -> np.ndarray:
    """Return the x and y column of a signal, (n, 2); `{}` in the name is the axis."""
    return np.column_stack([log[name.format(axis)] for axis in "xy"])


def _rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt(mean_seen(values**2))


def _last(values: np.ndarray) -> np.ndarray:
    """Last number of each column (n, 2), NaN where there is none."""
    ends = [column[~np.isnan(column)][-1:] for column in values.T]
    return np.array([end[0] if len(end) else nan for end in ends])


def _episodes(push: np.ndarray) -> int:
    on = np.nan_to_num(push) != 0
    return int(np.sum(on & ~np.concatenate(([False], on[:-1]))))


def settled_interval(
    log: Log, *, rng: np.random.Generator, band_m: float = 0.02, stay_s: float = 1.0
) -> WithinRun:
    """95 % intervals of where the ball of ONE run stays once settled, and how spread.

    Of the longest stretch without pushes, in blocks of whole limit cycles; NaN where it never
    settled or too little is left. While the integral still drifts they are too narrow.
    """
    ball = ball_samples(log)
    settling = settling_time(ball, band_m=band_m, stay_s=stay_s)
    calm = undisturbed(ball.where(ball.t_s >= settling), band_m)
    frame = float(np.median(np.diff(calm.t_s))) if len(calm.t_s) > 1 else nan
    periods = [c.period_s for c in limit_cycle(calm) if c.cycles >= FEWEST_CYCLES]
    period = max(periods, default=nan)
    return within_run_interval(calm.xy_m, sample_s=frame, period_s=period, rng=rng)


def settling_time(ball: Samples, *, band_m: float = 0.02, stay_s: float = 1.0) -> float:
    """First time [s] from which every sample of `stay_s` lies within `band_m` of its target.

    NaN: never. A gap of more than GAP_S ends a stay: an unseen ball does not count as staying.
    """
    if not len(ball.t_s):
        return nan
    for first, last in _stretches(ball, ball.off_m <= band_m):
        if ball.until_s[last] - ball.t_s[first] >= stay_s - 1e-9:
            return max(float(ball.t_s[first]), 0.0)
    return nan


def _stretches(ball: Samples, good: np.ndarray) -> list[tuple[int, int]]:
    """First and last index of each stretch of good samples (k,) without a long gap."""
    parted = np.append(False, ball.t_s[1:] - ball.until_s[:-1] > GAP_S)[: len(good)]
    label = np.cumsum(parted | (np.diff(good, prepend=good[:1]) != 0))
    index = np.flatnonzero(good)
    if not len(index):
        return []
    cuts = np.flatnonzero(np.diff(label[index]))
    firsts = index[np.concatenate(([0], cuts + 1))]
    lasts = index[np.concatenate((cuts, [len(index) - 1]))]
    return list(zip(firsts.tolist(), lasts.tolist(), strict=True))


def undisturbed(ball: Samples, band_m: float = 0.02) -> Samples:
    """Return the longest stretch without pushes and without what they left behind.

    Without pushes that is everything; else the longest stretch within `band_m` of the target.
    """
    if not ball.pushed.any():
        return ball
    stretches = _stretches(ball, ~ball.pushed & (ball.off_m <= band_m))
    if not stretches:
        return ball.where(slice(0, 0))
    first, last = max(stretches, key=lambda s: ball.t_s[s[1]] - ball.t_s[s[0]])
    return ball.where(slice(first, last + 1))


def limit_cycle(ball: Samples) -> tuple[Cycle, Cycle]:
    """Find the limit cycle of each axis in settled samples about a target that stands still."""
    if len(ball.t_s) and np.ptp(ball.target_m, axis=0).any():
        moves = Cycle(nan, nan, 0, "the target moves")
        return moves, moves
    return _cycle(ball.t_s, ball.xy_m[:, 0]), _cycle(ball.t_s, ball.xy_m[:, 1])


def _cycle(t: np.ndarray, x: np.ndarray) -> Cycle:
    seen = ~np.isnan(x)
    t, x = t[seen], x[seen]
    if len(t) < 8:
        return Cycle(nan, nan, 0, f"{len(t)} samples after settling")
    times = _crossings(t, x)
    ups, downs = times[::2], times[1::2]  # or the other way round
    use = ups if len(ups) > len(downs) else downs
    cycles = max(len(use) - 1, 0)
    if cycles < FEWEST_CYCLES:
        return Cycle(nan, nan, cycles, f"{cycles} whole cycles above the noise, 2 are needed")
    period = float(np.median(np.concatenate([np.diff(ups), np.diff(downs)])))
    parts = [((t >= a) & (t < b), b - a) for a, b in pairwise(use)]
    each = [_fundamental(t[i], x[i], seconds) for i, seconds in parts if i.sum() >= 8]
    if not each:
        return Cycle(nan, nan, cycles, "fewer than 8 samples a cycle")
    return Cycle(float(np.median(each)), period, cycles)


def _fundamental(t: np.ndarray, x: np.ndarray, period_s: float) -> float:
    """Amplitude of one cycle's first harmonic, fitted beside a constant and a drift."""
    s = 2 * pi * (t - t[0]) / period_s
    basis = np.column_stack([np.sin(s), np.cos(s), np.ones_like(s), s])
    fit = np.linalg.lstsq(basis, x, rcond=None)[0]
    return float(np.hypot(fit[0], fit[1]))


def _crossings(t: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Times at which x (n,) passes, alternately up and down, its middle between turning points.

    Not the mean of all: the integral still drifts while the ball cycles. With hysteresis: a turning
    point counts once x has come back from it by eight standard deviations of the noise left after
    smoothing over 0.1 s, and by 0.6 RMS about a straight line (a sine comes back by 2.8 RMS).
    """
    width = max(1, round(SMOOTH_S / float(np.median(np.diff(t)))))
    kernel = np.ones(width) / width
    x_s, t_s = np.convolve(x, kernel, "valid"), np.convolve(t, kernel, "valid")
    line = np.polynomial.polynomial.polyfit(t - t[0], x, 1)
    rest = np.std(x - np.polynomial.polynomial.polyval(t - t[0], line))
    turns = _turning_points(x_s, max(8 * noise_std(x) / sqrt(width), 0.6 * float(rest)))
    times = []
    for a, b in pairwise(turns):
        up = np.sign(x_s[b] - x_s[a]) * (x_s[a : b + 1] - (x_s[a] + x_s[b]) / 2)
        i = int(np.argmax(up >= 0))  # from below to above its middle: i >= 1
        share = up[i - 1] / (up[i - 1] - up[i])
        times.append(t_s[a + i - 1] + share * (t_s[a + i] - t_s[a + i - 1]))
    return np.array(times)


def _turning_points(x: np.ndarray, back: float) -> list[int]:
    """Indices of alternating maxima and minima of x (n,), each followed by a way back > `back`.

    The ends of x are no turning points.
    """
    turns, low, high, rising = [], 0, 0, 0
    for i, value in enumerate(x.tolist()):
        if value > x[high]:
            high = i
        if value < x[low]:
            low = i
        if rising >= 0 and x[high] - value > back:
            turns.append(high)
            low, rising = i, -1
        elif rising <= 0 and value - x[low] > back:
            turns.append(low)
            high, rising = i, 1
    return [i for i in turns if i > 0]


def noise_std(x: np.ndarray) -> float:
    """Standard deviation of white noise on smooth samples (n,): from second differences, robust."""
    second = np.diff(x, 2)
    second = np.abs(second[np.isfinite(second)])
    if not len(second):
        return 0.0
    middle = float(np.median(second)) / 0.6745
    return (middle if middle > 0 else float(np.sqrt(np.mean(second**2)))) / sqrt(6)


# Detection of pushes: straight lines through the samples before and after a gap that holds a push.
PUSH_GAP_S = 0.1
PUSH_WINDOW_S = 0.1
PUSH_WINDOW_FRAMES = 5
PUSH_APART_S = 0.2
MODEL_SHARE, MODEL_ANGLE_RAD = 0.3, 0.06  # error of the ball's gain; play and level together


def detect_pushes(log: Log, *, rig: Rig | None = None) -> np.ndarray:
    """Times (k,) [s] at which the ball's velocity jumps beyond what the plate can do.

    From Eq. 15 and the moving plate's Euler term, z = x + r (2 R_d/L) theta has z'' = b theta. A
    jump of z' across 0.1 s, less the integral of b theta, is a push where it exceeds six standard
    deviations of its noise and what a wrong model can explain: 30 % of b theta and b times 0.06 rad
    (play, level). Without servo angles the bound is both axes at their angle limit. Smallest push
    seen: about 0.05 m/s. A ball that meets a wall jumps too. Needs both axes and 20 frames/s.
    """
    rig = rig or Rig()
    run, ball = run_part(log), ball_samples(log)
    ball = ball.where(np.asarray(~np.isnan(ball.xy_m).any(axis=1)))
    t = ball.t_s
    if len(t) < 3 * PUSH_WINDOW_FRAMES:
        return np.empty(0)
    free, work = _free_of_plate(run, ball, rig)
    window = max(PUSH_WINDOW_S, (PUSH_WINDOW_FRAMES - 0.5) * float(np.median(np.diff(t))))
    before, var_before = _slopes(t, free, t - PUSH_GAP_S / 2 - window, t - PUSH_GAP_S / 2)
    after, var_after = _slopes(t, free, t + PUSH_GAP_S / 2, t + PUSH_GAP_S / 2 + window)
    jump = np.hypot(*(after - before).T)
    noise = max(noise_std(ball.xy_m[:, a]) for a in range(2)) * np.sqrt(var_before + var_after)
    span = PUSH_GAP_S + window
    explained = np.interp(t + span / 2, t, work) - np.interp(t - span / 2, t, work)
    excess = jump - 6 * noise - explained
    found = np.flatnonzero(excess > 0)  # NaN (too few samples around) compares as False
    groups = np.split(found, np.flatnonzero(np.diff(t[found]) > PUSH_APART_S) + 1)
    return np.array([t[group[np.argmax(jump[group])]] for group in groups if len(group)])


def _free_of_plate(run: Log, ball: Samples, rig: Rig) -> tuple[np.ndarray, np.ndarray]:
    """Path (k, 2) of the samples less what the plate does to it, and the integral (k,) of what a
    wrong model of the plate can do [m/s]."""
    tick = run["t_s"] - run["t_s"][0]
    theta = _pair(run, "theta_{}_rad")
    b = rig.ball_gain_m_s2
    if np.isnan(theta).any():
        return ball.xy_m, sqrt(2) * b * np.sin(rig.servo.angle_limit_rad) * ball.t_s
    dt = np.diff(tick, prepend=tick[0])[:, None]
    speed = np.cumsum(b * np.sin(theta) * dt, axis=0)
    path = np.cumsum(speed * dt, axis=0) - rig.ball.radius_m * rig.linkage.ratio * np.sin(theta)
    drive = MODEL_SHARE * np.hypot(*np.sin(theta).T) + np.sin(MODEL_ANGLE_RAD)
    work = np.cumsum(b * drive * dt[:, 0])
    moved = [np.interp(ball.t_s, tick, path[:, a]) for a in range(2)]
    return ball.xy_m - np.column_stack(moved), np.interp(ball.t_s, tick, work)


def _slopes(
    t: np.ndarray, xy: np.ndarray, begin: np.ndarray, end: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Slopes (k, 2) of lines through the samples within begin (k,) to end (k,), and their variance
    for samples of unit variance (k,); NaN where fewer than 4 samples lie there."""
    first, last = np.searchsorted(t, begin - 1e-6), np.searchsorted(t, end + 1e-6)
    terms = np.column_stack([t, t * t, xy, xy * t[:, None]])
    total = np.vstack([np.zeros(6), np.cumsum(terms, axis=0)])
    sums = total[last] - total[first]
    n = np.where(last - first >= 4, last - first, np.nan)
    spread = sums[:, 1] - sums[:, 0] ** 2 / n
    slopes = (sums[:, 4:] - sums[:, 2:4] * (sums[:, 0] / n)[:, None]) / spread[:, None]
    return slopes, 1 / spread
