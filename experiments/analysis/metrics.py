"""What a run's log says in numbers: where the ball was, how it cycled, what the servos did.

Pure functions of a `Log`; ball samples are new observations alone, at the time when the light hit
the sensor. What a log lacks is NaN: an axis, the ball, a channel.
"""

from dataclasses import dataclass
from math import nan
from typing import Any

import numpy as np

from experiments.analysis.limit_cycle import FEWEST_CYCLES, Cycle, limit_cycle
from experiments.analysis.samples import (
    Place,
    Samples,
    ball_samples,
    mean_seen,
    pair,
    place,
    run_part,
)
from experiments.analysis.statistics import WithinRun, within_run_interval
from rig.log import Log, shown_angles

NEAR_M, FAR_M, WIDER = 0.002, 0.03, 1.2
GAP_S = 0.25  # a ball unseen for longer was not there
NUMBERS_TOLD = (
    "A ball has settled when it stays as near to its target as in the last third of the run "
    f"(within {WIDER:g} times the largest distance there, at least {1e3 * NEAR_M:g} mm); one that "
    "is pushed, when it first stays within 2 cm for 1 s. Servo activity: standard deviation of the "
    "servos' angles from then on, mean of x and y."
)


@dataclass(frozen=True, eq=False)
class RunMetrics:
    """Metrics of one run in SI units; pairs (2,) are x, y, and NaN is what the log lacks.

    duration_s: of the run phase; samples: observations of the ball; target_moves: whether the
    ball's target does: centroid, spread and settling then say nothing of the controller; centroid_m
    to error_rms_m: over the whole run, as in `Place`. settling_s: NaN where the ball never settled
    (`has_settled` False). The settled part begins at settling_s, or at half the run where the ball
    never settled; of that part are settled (`Place`), cycle (x and y), servo_rms_rad (RMS about
    zero), servo_activity_rad (standard deviation; of the commands where no angle is measured) and
    servo_tracking_rad (RMS of theta - desired_theta). Over the whole run are
    servo_tracking_whole_rad and voltage_rms_V. pushes: their number, None where the log does not
    say. unseen_at_end_s: how long the ball had not been seen at the end; where that is above GAP_S,
    this time is not part of the settled part. gear_play_rad, joint_play_rad and their standard
    deviations: the last estimates, full widths.
    """

    duration_s: float
    samples: int
    target_moves: bool
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
    """Compute all metrics of one run.

    A run without pushes has settled when the ball is as near to its target as at the end of the run
    (`final_settling_time`); a run with pushes when the ball first stays within `band_m` for
    `stay_s` (`settling_time`). servo_only: the targets are servo angles, and the ball's samples are
    left out.
    """
    run, ball = run_part(log), ball_samples(log)
    if servo_only:
        ball = ball.where(slice(0, 0))
    t = run["t_s"] - run["t_s"][:1]
    duration = float(t[-1] + np.median(np.diff(t))) if len(t) > 1 else 0.0
    unseen = duration - float(ball.until_s[-1]) if len(ball.t_s) else nan
    end = duration - unseen if unseen > GAP_S else duration
    pushed = bool(ball.pushed.any())
    settling = (
        settling_time(ball, band_m=band_m, stay_s=stay_s) if pushed else final_settling_time(ball)
    )
    begin = end / 2 if np.isnan(settling) else settling
    after = ball.where(ball.t_s >= begin)
    return RunMetrics(
        duration_s=duration,
        target_moves=ball.target_moves,
        **vars(place(ball)),
        settling_s=settling,
        has_settled=not np.isnan(settling),
        settled=place(after),
        cycle=limit_cycle(undisturbed(after, band_m) if pushed else after),
        **_servos(run, run.where((t >= begin) & (t <= end))),
        pushes=_episodes(run["push"]) if run.has("push") else None,
        unseen_at_end_s=unseen,
        **_plays(run),
    )


def _servos(run: Log, calm: Log) -> dict[str, Any]:
    """Numbers of the servos over the whole run and its settled part."""
    theta, whole = pair(calm, "theta_{}_rad"), pair(run, "theta_{}_rad")
    moved = shown_angles(calm.rows)
    return {
        "servo_rms_rad": _rms(moved),
        "servo_activity_rad": _rms(moved - mean_seen(moved)),
        "servo_tracking_rad": _rms(theta - pair(calm, "desired_theta_{}_rad")),
        "servo_tracking_whole_rad": _rms(whole - pair(run, "desired_theta_{}_rad")),
        "voltage_rms_V": _rms(pair(run, "voltage_{}_V")),
    }


def _plays(run: Log) -> dict[str, Any]:
    """Read the last estimates of the plays and their standard deviations."""
    names = ("gear_play", "gear_play_std", "joint_play", "joint_play_std")
    return {f"{name}_rad": _last(pair(run, f"estimated_{name}_{{}}_rad")) for name in names}


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
    """95 % intervals of the settled ball's mean position and spread in ONE run.

    Taken from the samples after settling, with pushes from the longest stretch without them, in
    blocks of whole limit cycles (`within_run_interval`). band_m, stay_s: settling of a run with
    pushes, as in `run_metrics`. NaN where the ball never settled or too few samples are left. The
    intervals are too narrow while the integral still drifts.
    """
    ball = ball_samples(log)
    if ball.pushed.any():
        settling = settling_time(ball, band_m=band_m, stay_s=stay_s)
        calm = undisturbed(ball.where(ball.t_s >= settling), band_m)
    else:
        calm = ball.where(ball.t_s >= final_settling_time(ball))
    frame = float(np.median(np.diff(calm.t_s))) if len(calm.t_s) > 1 else nan
    periods = [c.period_s for c in limit_cycle(calm) if c.cycles >= FEWEST_CYCLES]
    period = max(periods, default=nan)
    return within_run_interval(calm.xy_m, sample_s=frame, period_s=period, rng=rng)


def final_settling_time(ball: Samples) -> float:
    """First time [s] from which the ball stays as near to its target as in the run's last third.

    As near means within WIDER times the largest distance in the last third, or within NEAR_M if
    that is more. A fixed band would call the transient settled wherever the limit cycle is small.
    NaN where the last third ends over 3 cm away, still comes closer (its first half is over 1.5
    times as wide as its second), or was not seen throughout.
    """
    if not len(ball.t_s) or ball.until_s[-1] <= 0:
        return nan
    last_third_s = ball.until_s[-1] * 2 / 3  # a value that was held counts as long as it was
    tail = ball.off_m[ball.until_s >= last_third_s]
    early, late = tail[: (len(tail) + 1) // 2], tail[len(tail) // 2 :]
    if tail.max() > FAR_M or early.max() > 1.5 * max(late.max(), NEAR_M):
        return nan
    stretches = _stretches(ball, ball.off_m <= max(WIDER * tail.max(), NEAR_M))
    if not stretches or stretches[-1][1] != len(ball.t_s) - 1:
        return nan
    begin = max(float(ball.t_s[stretches[-1][0]]), 0.0)
    return begin if begin <= last_third_s else nan


def settling_time(ball: Samples, *, band_m: float = 0.02, stay_s: float = 1.0) -> float:
    """First time [s] from which every sample of `stay_s` lies within `band_m` of its target.

    NaN where that never happens. A gap of more than GAP_S between samples ends a stay: an unseen
    ball does not count as staying.
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
    """Longest stretch of samples without pushes and without the transients that they cause.

    Without any push these are all samples; otherwise the longest stretch within `band_m` of the
    target, empty where there is none.
    """
    if not ball.pushed.any():
        return ball
    stretches = _stretches(ball, ~ball.pushed & (ball.off_m <= band_m))
    if not stretches:
        return ball.where(slice(0, 0))
    first, last = max(stretches, key=lambda s: ball.t_s[s[1]] - ball.t_s[s[0]])
    return ball.where(slice(first, last + 1))
