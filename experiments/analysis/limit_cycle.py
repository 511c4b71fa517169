"""The limit cycle of a settled ball: amplitude of its fundamental, period, whole cycles."""

from dataclasses import dataclass
from itertools import pairwise
from math import nan, pi, sqrt

import numpy as np

from experiments.analysis.samples import Samples

SMOOTH_S = 0.1  # far below any period of the ball's loop (3 s)
FEWEST_CYCLES = 2
FEW = f"fewer than {FEWEST_CYCLES} whole swings"
TOLD = (
    f"A limit cycle is told from {FEWEST_CYCLES} whole swings after settling on; where there are "
    "fewer, the run is too short to tell it (the protocol hold runs long enough) or the ball rests."
)


@dataclass(frozen=True)
class Cycle:
    """Limit cycle of one axis: amplitude of its fundamental, period and number of whole cycles.

    Amplitude and period are NaN, with a `reason`, where fewer than two whole cycles rise above the
    noise or a cycle has fewer than 8 samples.
    """

    amplitude_m: float
    period_s: float
    cycles: int
    reason: str = ""


def limit_cycle(ball: Samples) -> tuple[Cycle, Cycle]:
    """Limit cycles of the x and the y axis in settled samples about a target at rest.

    Amplitude: median over the cycles of the first harmonic, fitted by least squares beside a
    constant and a drift. Where the target moves both results are NaN with that reason.
    """
    if ball.target_moves:
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
        return Cycle(nan, nan, cycles, FEW)
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
    Before the first turning point and behind the last one the middle is that of the nearest two: a
    swing is whole from one passage to the next but one, whether or not its turning point is seen.
    """
    width = max(1, round(SMOOTH_S / float(np.median(np.diff(t)))))
    kernel = np.ones(width) / width
    x_s, t_s = np.convolve(x, kernel, "valid"), np.convolve(t, kernel, "valid")
    line = np.polynomial.polynomial.polyfit(t - t[0], x, 1)
    rest = np.std(x - np.polynomial.polynomial.polyval(t - t[0], line))
    turns = _turning_points(x_s, max(8 * noise_std(x) / sqrt(width), 0.6 * float(rest)))
    if len(turns) < 2:
        return np.array([])
    middles = [(x_s[a] + x_s[b]) / 2 for a, b in pairwise(turns)]
    times = [
        _passage(t_s[a : b + 1], x_s[a : b + 1] - middle)
        for (a, b), middle in zip(pairwise(turns), middles, strict=True)
    ]
    first, last = turns[0], turns[-1]
    times.insert(0, _passage(t_s[first::-1], x_s[first::-1] - middles[0]))
    times.append(_passage(t_s[last:], x_s[last:] - middles[-1]))
    return np.array([time for time in times if time is not None])


def _passage(t: np.ndarray, x: np.ndarray) -> float | None:
    """When x (n,), which begins on one side of 0, is first on the other; None: it never is."""
    beyond = np.sign(x[0]) * x <= 0
    i = int(np.argmax(beyond))
    if not beyond[i]:
        return None
    share = x[i - 1] / (x[i - 1] - x[i])
    return float(t[i - 1] + share * (t[i] - t[i - 1]))


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
    """Standard deviation of white noise on smooth samples x (n,), in the unit of x.

    Median absolute second difference/(0.6745 sqrt(6)); where that median is 0, the RMS of the
    second differences/sqrt(6). 0 with no finite second difference.
    """
    second = np.diff(x, 2)
    second = np.abs(second[np.isfinite(second)])
    if not len(second):
        return 0.0
    middle = float(np.median(second)) / 0.6745
    return (middle if middle > 0 else float(np.sqrt(np.mean(second**2)))) / sqrt(6)
