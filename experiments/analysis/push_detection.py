"""When a ball was pushed, read off the log: its speed changed faster than the plate can do.

Straight lines through the samples before and after a gap that holds a push, less what the plate
did in between.
"""

from math import sqrt

import numpy as np

from experiments.analysis.limit_cycle import noise_std
from experiments.analysis.samples import Samples, ball_samples, pair, run_part
from rig.log import Log
from rig.parameters import Rig

PUSH_GAP_S = 0.1
PUSH_WINDOW_S = 0.1
PUSH_WINDOW_FRAMES = 5
PUSH_APART_S = 0.2
MODEL_SHARE, MODEL_ANGLE_RAD = 0.3, 0.06  # error of the ball's gain; play and level together


def detect_pushes(log: Log, *, rig: Rig | None = None) -> np.ndarray:
    """Times (k,) [s] of the run phase at which the ball's velocity jumps as no plate can make it.

    From Eq. 15 and the moving plate's Euler term, z = x + r (2 R_d/L) theta has z'' = b theta. A
    jump of z' across 0.1 s, less the integral of b theta, is a push where it exceeds six standard
    deviations of its noise and what a wrong model can explain: 30 % of b theta and b times 0.06 rad
    (play, level). Without servo angles the bound is both axes at their angle limit. The smallest
    push detected is about 0.05 m/s. The rebound of a ball from a wall is detected as a push too.
    Needs both axes and 20 frames/s; with fewer than 15 samples the result is empty.
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
    theta = pair(run, "theta_{}_rad")
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
