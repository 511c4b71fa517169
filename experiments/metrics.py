"""What a run's log says in numbers: where the ball was, how it cycled, what the servos did.

Pure functions of a `Log`. Only rows of phase 2 (run) count, times from the first of them; a log
without phases (an import) is a run from its first row. Ball samples are new observations alone, at
the time when the light hit the sensor. What a log lacks is NaN: an axis, the ball, a channel.
"""

from dataclasses import dataclass
from math import ceil, nan, pi, sqrt

import numpy as np

from experiments.centroids import Place, Samples, ball_samples, mean_seen, place, run_part
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


def run_metrics(log: Log, *, band_m: float = 0.02, stay_s: float = 1.0) -> RunMetrics:
    """Compute every number of one run; `band_m` and `stay_s` say what counts as settled."""
    run, ball = run_part(log), ball_samples(log)
    t = run["t_s"] - run["t_s"][:1]
    duration = float(t[-1] + np.median(np.diff(t))) if len(t) > 1 else 0.0
    whole, settling = place(ball), settling_time(ball, band_m=band_m, stay_s=stay_s)
    begin = duration / 2 if np.isnan(settling) else settling
    settled = ball.where(ball.t_s >= begin)
    unseen = duration - float(ball.t_s[-1]) if len(ball.t_s) else nan
    end = duration - unseen if unseen > GAP_S else duration
    calm = run.where((t >= begin) & (t <= end))
    episodes = np.diff(np.nan_to_num(run["push"]) != 0, prepend=False, append=False).sum() // 2
    return RunMetrics(
        duration_s=duration,
        **vars(whole),
        settling_s=settling,
        has_settled=not np.isnan(settling),
        settled=place(settled),
        cycle=limit_cycle(undisturbed(settled, band_m)),
        servo_rms_rad=_rms(_pair(calm, "theta_{}_rad")),
        servo_activity_rad=_std(_pair(calm, "theta_{}_rad")),
        servo_tracking_rad=_rms(_pair(calm, "theta_{}_rad", "desired_theta_{}_rad")),
        servo_tracking_whole_rad=_rms(_pair(run, "theta_{}_rad", "desired_theta_{}_rad")),
        voltage_rms_V=_rms(_pair(run, "voltage_{}_V")),
        pushes=int(episodes) if run.has("push") else None,
        unseen_at_end_s=unseen,
        gear_play_rad=_last(_pair(run, "estimated_gear_play_{}_rad")),
        gear_play_std_rad=_last(_pair(run, "estimated_gear_play_std_{}_rad")),
        joint_play_rad=_last(_pair(run, "estimated_joint_play_{}_rad")),
        joint_play_std_rad=_last(_pair(run, "estimated_joint_play_std_{}_rad")),
    )


def settling_time(ball: Samples, *, band_m: float = 0.02, stay_s: float = 1.0) -> float:
    """First time [s] from which every sample of `stay_s` lies within `band_m` of its target.

    NaN: never. A gap of more than GAP_S ends a stay: an unseen ball does not count as staying.
    """
    if not len(ball.t_s):
        return nan
    for first, last in _stretches(ball, ball.off_m <= band_m):
        if ball.t_s[last] - ball.t_s[first] >= stay_s - 1e-9:
            return max(float(ball.t_s[first]), 0.0)
    return nan


def _stretches(ball: Samples, good: np.ndarray) -> list[tuple[int, int]]:
    """First and last index of each stretch of good samples (k,) without a long gap."""
    parted = np.diff(ball.t_s, prepend=ball.t_s[:1]) > GAP_S
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
    """Find the limit cycle of each axis in settled samples, relative to their mean."""
    return _cycle(ball.t_s, ball.xy_m[:, 0]), _cycle(ball.t_s, ball.xy_m[:, 1])


def _cycle(t: np.ndarray, x: np.ndarray) -> Cycle:
    seen = ~np.isnan(x)
    t, x = t[seen], x[seen]
    if len(t) < 8:
        return Cycle(nan, nan, 0, f"{len(t)} samples after settling")
    x = x - x.mean()
    times = _crossings(t, x)
    rises, falls = times[::2], times[1::2]
    cycles = max(len(rises), len(falls)) - 1
    if cycles < FEWEST_CYCLES:
        found = max(cycles, 0)
        return Cycle(nan, nan, found, f"{found} whole cycles above the noise, 2 are needed")
    period = float(np.median(np.concatenate([np.diff(rises), np.diff(falls)])))
    use = rises if len(rises) > len(falls) else falls
    each = [
        _fundamental(t[inside], x[inside], b - a)
        for a, b in zip(use[:-1], use[1:], strict=True)
        if (inside := (t >= a) & (t < b)).sum() >= 8
    ]
    if not each:
        return Cycle(nan, nan, cycles, "fewer than 8 samples a cycle")
    return Cycle(float(np.median(each)), period, cycles)


def _fundamental(t: np.ndarray, x: np.ndarray, period_s: float) -> float:
    """Amplitude of the first harmonic of one cycle, beside a constant and a drift (least squares)."""
    s = 2 * pi * (t - t[0]) / period_s
    basis = np.column_stack([np.sin(s), np.cos(s), np.ones_like(s), s])
    fit = np.linalg.lstsq(basis, x, rcond=None)[0]
    return float(np.hypot(fit[0], fit[1]))


def _crossings(t: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Times at which x (n,), of mean zero, passes zero, alternately up and down.

    With hysteresis: a passage counts from below -h to above h, h = four standard deviations of the
    noise left after smoothing over 0.1 s and at least 0.3 RMS (a sine passes at 1.41 RMS).
    """
    width = max(1, round(SMOOTH_S / float(np.median(np.diff(t)))))
    kernel = np.ones(width) / width
    smooth_x, smooth_t = np.convolve(x, kernel, "valid"), np.convolve(t, kernel, "valid")
    h = max(4 * noise_std(x) / sqrt(width), 0.3 * float(np.std(x)))
    side = np.where(smooth_x > h, 1, np.where(smooth_x < -h, -1, 0))
    outside = np.flatnonzero(side)
    turn = np.flatnonzero(np.diff(side[outside]))
    a, b = outside[turn], outside[turn + 1]
    share = -smooth_x[a] / (smooth_x[b] - smooth_x[a])
    return smooth_t[a] + share * (smooth_t[b] - smooth_t[a])


def noise_std(x: np.ndarray) -> float:
    """Standard deviation of white noise on smooth samples (n,): from second differences, robust."""
    second = np.diff(x, 2)
    second = np.abs(second[np.isfinite(second)])
    if not len(second):
        return 0.0
    middle = float(np.median(second)) / 0.6745
    return (middle if middle > 0 else float(np.sqrt(np.mean(second**2)))) / sqrt(6)
