"""Does one signal follow another, with which sign and how strongly? By regression, with intervals.

A ball on a plate accelerates with the angle that tilts it, x''(t) = g theta(t - d) + c; a motor's
speed follows its volts, theta'(t) = K V(t - d) + c while the windows are longer than its time
constant. The derivative is the slope (or curvature) of a polynomial of degree 1 (or 2) fitted by
least squares to the window [t - h, t + h] (Savitzky and Golay 1964). Of any x that is the exact
derivative averaged with a weight:

    slope       (3/4h)  int (1 - s^2)   x'(t + hs) h ds
    curvature   (15/16) int (1 - s^2)^2 x''(t + hs) ds

so that the cause, averaged with the same weight, is what the result must follow, however wide the
window: noise is averaged away and nothing is differentiated.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

STEP_S = 0.01  # grid; control and cameras of such tables are slower or little faster
HALF_WINDOWS_S = (0.15, 0.3, 0.6)  # chosen: from a few frames to a third of a table's period
DELAYS_S = np.arange(0.0, 0.31, 0.02)  # chosen: camera, link and servo together stay below 0.3 s
MAX_HOLE_S = 0.15  # between two samples; across a longer hole nothing is known, but
MAX_HOLE_STEPS = 1.5  # chosen: so many of the usual steps are none, however slow the rows
MAX_LENGTH_S = 1200.0  # more adds nothing to a sign
CONFIDENCE = 0.999
MIN_SHARE = 0.1  # of the result's variance that a cause explains, below which nothing is said
MIN_LEAD = 0.1  # by which the better sign explains more than the other one at any delay
HUBER = 1.345  # standard deviations beyond which the first rounds bound a window
TUKEY = 4.685  # standard deviations beyond which a window counts nothing: 95 % efficient
MIN_WINDOWS = 8.0  # independent ones


@dataclass(frozen=True)
class Response:
    """How a result follows one cause, others beside it held fixed.

    gain: result's derivative per unit of the cause, with its 99.9 % interval (low, high); zero: the
    cause at which the result rests while the others are at their means, with its standard error;
    share: of the result's variance that goes with this cause alone; opposite: share that the best
    fit with the other sign explains;
    windows: number of independent windows.
    """

    gain: float
    low: float
    high: float
    delay_s: float
    share: float
    opposite: float
    zero: float
    zero_error: float
    windows: float

    @property
    def sure(self) -> bool:
        """True where the sign cannot reasonably be the other one."""
        return (
            self.low * self.high > 0
            and self.windows >= MIN_WINDOWS
            and self.share >= MIN_SHARE
            and self.share - self.opposite >= MIN_LEAD
        )


@dataclass(frozen=True, eq=False)
class _Fit:
    total: float
    shares: np.ndarray
    gains: np.ndarray
    errors: np.ndarray
    centre: np.ndarray  # mean of every cause, at which
    constant: float  # is the result
    constant_error: float
    windows: float


def responses(
    t_s: np.ndarray,
    result: np.ndarray,
    causes: Sequence[np.ndarray],
    *,
    order: int,
    delays_s: np.ndarray = DELAYS_S,
) -> list[Response | None]:
    """How the derivative of `order` (1 or 2) of `result` (n,) follows each of `causes` ((n,) each).

    NaN where a sample is missing; t_s (n,) grows, sessions parted by holes; delays_s: of the result
    behind the causes that are tried, negative where a cause is told late. None for a cause that
    never changes, or where too few windows are whole.
    """
    length = min(t_s[-1] - t_s[0], MAX_LENGTH_S)
    grid = t_s[0] + np.arange(int(length / STEP_S)) * STEP_S
    x, seen = _on_grid(t_s, result, grid)
    signals = [_on_grid(t_s, cause, grid) for cause in causes]
    moving = [i for i, (values, there) in enumerate(signals) if _moves(values, there)]
    best: list[tuple[_Fit, float]] = []
    for half_s in HALF_WINDOWS_S:
        fits = _fits(x, seen, [signals[i] for i in moving], half_s, order, delays_s)
        if fits and (not best or max(f.total for f, _ in fits) > max(f.total for f, _ in best)):
            best = fits
    found: list[Response | None] = [None] * len(causes)
    if best:
        for k, i in enumerate(moving):
            found[i] = _response(best, k)
    return found


def _moves(values: np.ndarray, there: np.ndarray) -> bool:
    return bool(there.any() and np.ptp(values[there]) > 0)


def _on_grid(
    t_s: np.ndarray, values: np.ndarray, grid: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`values` on the grid by straight lines, and where they are known: not inside a hole. Of rows
    closer than the grid's the mean over a step, since volts of a fast loop change with every row.
    """
    there = np.isfinite(values)
    if there.sum() < 3:
        return np.zeros_like(grid), np.zeros(len(grid), bool)
    t_s, values = t_s[there], values[there]
    longest_s = max(MAX_HOLE_S, MAX_HOLE_STEPS * float(np.median(np.diff(t_s))))
    after = np.clip(np.searchsorted(t_s, grid, side="left"), 1, len(t_s) - 1)
    hole = t_s[after] - t_s[after - 1] > longest_s
    known = ~hole & (grid >= t_s[0]) & (grid <= t_s[-1])
    if np.median(np.diff(t_s)) >= STEP_S:
        return np.interp(grid, t_s, values), known
    return _means(t_s, values, np.append(grid, grid[-1:] + STEP_S) - STEP_S / 2), known


def _means(t_s: np.ndarray, values: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Means (m,) between `edges` (m + 1,) of the straight lines through values (n,)."""
    t = np.union1d(t_s, edges)
    v = np.interp(t, t_s, values)
    area = np.concatenate(([0.0], np.cumsum(np.diff(t) * (v[1:] + v[:-1]) / 2)))
    return np.diff(area[np.searchsorted(t, edges)]) / np.diff(edges)


def _kernels(half: int, order: int) -> tuple[np.ndarray, np.ndarray]:
    """What turns samples into the derivative, and the weight (2 half + 1,) to average causes by."""
    s = np.arange(-half, half + 1) / half
    powers = np.vander(s, order + 1, increasing=True)
    slope = np.linalg.pinv(powers)[order] * (2.0 if order == 2 else 1.0)
    weight = (1 - s**2) ** order
    return slope / (half * STEP_S) ** order, weight / weight.sum()


def _fits(
    x: np.ndarray,
    seen: np.ndarray,
    signals: list[tuple[np.ndarray, np.ndarray]],
    half_s: float,
    order: int,
    delays_s: np.ndarray,
) -> list[tuple[_Fit, float]]:
    """Fits with every delay, for one width of the window."""
    half = round(half_s / STEP_S)
    if len(x) < 4 * half or not signals:
        return []
    slope, weight = _kernels(half, order)
    ones = np.ones(2 * half + 1)
    whole = np.convolve((~seen).astype(float), ones, "same") < 0.5
    result = np.convolve(x - x[seen].mean() if seen.any() else x, slope[::-1], "same")
    smooth, known = [], []
    for values, there in signals:
        centre = values[there].mean()
        smooth.append(np.convolve(values - centre, weight, "same") + centre)
        known.append(np.convolve((~there).astype(float), ones, "same") < 0.5)
    fits = []
    for delay_s in delays_s:
        back = round(delay_s / STEP_S)
        at = np.arange(half + max(back, 0), len(x) - half + min(back, 0), max(half // 2, 1))
        at = at[whole[at] & np.all([k[at - back] for k in known], axis=0)]
        if len(at) > 4 * (len(signals) + 2):
            fit = _regression(result[at], np.array([s[at - back] for s in smooth]))
            if fit is not None:
                fits.append((fit, float(delay_s)))
    return fits


def _regression(y: np.ndarray, causes: np.ndarray) -> _Fit | None:
    """Robust least squares of y (m,) on causes (k, m) and a constant; None where nothing moves.

    A hand that pushes or holds the ball is no noise: Tukey's biweight (Huber and Ronchetti, Robust
    Statistics, 2009, section 7.8) leaves such windows out. Windows overlap: standard errors count
    as many as the residual's correlation from one to the next leaves independent.
    """
    scale, centre = causes.std(axis=1), causes.mean(axis=1)
    if y.std() == 0 or np.any(scale == 0):
        return None
    A = np.vstack(((causes - centre[:, None]) / scale[:, None], np.ones(len(y)))).T
    if np.linalg.cond(A.T @ A) > 1e8:
        return None
    weights = np.ones(len(y))
    b, inverse = _weighted(A, y, weights)
    for reach in (*([HUBER] * 6), *([TUKEY] * 12)):
        left = y - A @ b
        spread = 1.4826 * np.median(np.abs(left))
        if spread == 0:
            break
        size = np.abs(left) / spread
        if reach == TUKEY:
            weights = np.clip(1 - (size / reach) ** 2, 0, None) ** 2
        else:
            weights = np.minimum(1.0, HUBER / np.maximum(size, 1e-9))
        if weights.sum() < 4 * len(b):
            return None
        before, (b, inverse) = b, _weighted(A, y, weights)
        if reach == TUKEY and np.all(np.abs(b - before) <= 1e-3 * spread):
            break
    left = y - A @ b
    own = np.sqrt(weights) * left
    rho = float(np.clip(np.dot(own[1:], own[:-1]) / max(np.dot(own, own), 1e-300), 0, 0.95))
    windows = weights.sum() * (1 - rho) / (1 + rho)
    k, mean = len(causes), np.average(y, weights=weights)
    power = np.average((y - mean) ** 2, weights=weights)
    if power == 0:  # nothing varies but in windows that are left out
        return None
    noise = np.average(left**2, weights=weights)
    errors = np.sqrt(noise * weights.sum() / max(windows - k - 1, 1.0) * np.diag(inverse))
    return _Fit(
        total=1 - noise / power,
        shares=b[:k] ** 2 / np.diag(inverse)[:k] / weights.sum() / power,
        gains=b[:k] / scale,
        errors=errors[:k] / scale,
        centre=centre,
        constant=float(b[k]),
        constant_error=float(errors[k]),
        windows=windows - k - 1,
    )


def _weighted(A: np.ndarray, y: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Solution (k,) of weighted least squares, and the inverse normal matrix (k, k)."""
    normal = A.T @ (w[:, None] * A)
    inverse = np.linalg.inv(normal + 1e-9 * np.trace(normal) * np.eye(len(normal)))
    return inverse @ (A.T @ (w * y)), inverse


def _response(fits: list[tuple[_Fit, float]], k: int) -> Response:
    """The response to cause k in the fit that explains the most, and the best one against it."""
    fit, delay_s = max(fits, key=lambda one: one[0].total)
    sign = np.sign(fit.gains[k])
    against = [one.shares[k] for one, _ in fits if np.sign(one.gains[k]) != sign]
    reach = float(stdtrit(max(fit.windows, 1.0), 0.5 + CONFIDENCE / 2) * fit.errors[k])
    gain = float(fit.gains[k])
    return Response(
        gain=gain,
        low=gain - reach,
        high=gain + reach,
        delay_s=delay_s,
        share=float(fit.shares[k]),
        opposite=float(max(against, default=0.0)),
        zero=fit.centre[k] - fit.constant / gain if gain else np.nan,
        zero_error=abs(fit.constant_error / gain) if gain else np.inf,
        windows=fit.windows,
    )
