"""The swing of a ball that is held at rest: a number that every run has, however uneven it swings.

    amplitude = sqrt(2) std(x),   period = 1/(frequency of the periodogram's peak)

over the last SWING_S, RATE_HZ samples a second by straight lines: those of the sine with the same
power. The peak lies between SLOWEST_HZ and FASTEST_HZ, on a grid of 1 mHz (zero padding).
"""

import numpy as np
from scipy.signal import periodogram

from experiments.analysis.samples import ball_samples
from rig.log import Log

SWING_S = 40.0  # a dozen periods of the shipped loop; chosen
RATE_HZ = 50.0  # 25 times FASTEST_HZ, whatever the rate of the camera; chosen
SLOWEST_HZ, FASTEST_HZ, GRID_HZ = 0.1, 2.0, 0.001  # about the loop's 0.3 Hz; chosen


def swing(log: Log, axis: int) -> tuple[float, float]:
    """Amplitude [m] and period [s] of the ball's swing on an axis (0: x, 1: y).

    ValueError: the ball was seen for less than SWING_S.
    """
    ball = ball_samples(log)
    seen = np.isfinite(ball.xy_m[:, axis])
    t, x = ball.t_s[seen], ball.xy_m[seen, axis]
    if not len(t) or t[-1] - t[0] < SWING_S:
        raise ValueError(f"the ball was seen for less than {SWING_S:g} s: make the run again")
    late = t > t[-1] - SWING_S
    t, x = t[late], x[late]
    samples = np.interp(np.arange(t[-1] - SWING_S, t[-1], 1.0 / RATE_HZ), t, x)
    frequency, power = periodogram(
        samples, RATE_HZ, window="hann", nfft=round(RATE_HZ / GRID_HZ), detrend="linear"
    )
    within = (frequency >= SLOWEST_HZ) & (frequency <= FASTEST_HZ)
    peak = frequency[within][np.argmax(power[within])]
    return float(np.sqrt(2.0) * np.std(x)), float(1.0 / peak)
