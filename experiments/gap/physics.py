"""Sign and gain of a signal's response to its cause: enough to find a wrong unit or sign.

Servo, over a window h much longer than tau:   theta(t+h) - theta(t) = K int_t^(t+h) V ds
Ball, for an acceleration a = g theta:
    x(t+h) - 2 x(t) + x(t-h) = g int_-h^h (h - |s|) theta(t+s) ds

Both hold without differentiating a measured signal, so that noise stays small for a long h.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import spearmanr

from rig.log import Log

WINDOW_S = 0.25
CLEAR_RANK = 0.6  # rank correlation beyond which the sign is certain,
MIN_WINDOWS = 25  # of at least so many windows: p < 0.002
MAX_HOLE = 3.0  # of the median interval: nothing is measured across a longer one


@dataclass(frozen=True)
class Response:
    """Response of a result to its cause over windows of WINDOW_S.

    rank: Spearman's rank correlation of result and cause; gain: their ratio, the slope of least
    absolute error through the medians; windows: number of windows.
    """

    rank: float
    gain: float
    windows: int

    @property
    def clear(self) -> bool:
        """True if the sign of the response is certain: |rank| > 0.6 in 25 windows or more."""
        return abs(self.rank) > CLEAR_RANK and self.windows >= MIN_WINDOWS


def servo_response(log: Log, cause: str, result: str) -> Response | None:
    """Response of the servo angle of axis `result` to the volts of axis `cause`.

    gain: K [rad/s/V] in theta(t+h) - theta(t) = K int_t^(t+h) V ds. None: one of the two signals is
    missing or constant, or there are fewer than three windows.
    """
    volts, theta = log[f"voltage_{cause}_V"], log[f"theta_{result}_rad"]
    if np.isnan(volts).all() or np.isnan(theta).all():
        return None
    t = log["t_s"]
    at = np.arange(t[0], t[-1], WINDOW_S)
    if len(at) < 3:
        return None
    whole = np.interp(at, t, _integral(t, volts))
    rise = np.diff(np.interp(at, t, theta)) / WINDOW_S
    near = _near(at, t)
    return _response(np.diff(whole) / WINDOW_S, rise, near[1:] & near[:-1])


def ball_response(log: Log, cause: str, result: str, delay_s: float) -> Response | None:
    """Response of the ball's acceleration along `result` to the servo angle of axis `cause`.

    gain: g [m/s2/rad] in x(t+h) - 2 x(t) + x(t-h) = g int_-h^h (h - |s|) theta(t+s) ds. delay_s:
    the camera's delay, for rows without ball_exposed_s. The rank is 0 where it has the other sign
    once the ball's place is held fixed: in a bowl that draws the ball back by b x, a circle of a
    rate w < sqrt(b) takes tilts g theta = (b - w^2) x against the acceleration -w^2 x. None: one of
    the two signals is missing or constant, or there are fewer than three windows.
    """
    theta = log[f"theta_{cause}_rad"]
    seen_s, xy = log.ball(delay_s)
    x = xy[:, "xy".index(result)]
    seen_s, x = seen_s[~np.isnan(x)], x[~np.isnan(x)]
    order = np.argsort(seen_s, kind="stable")
    seen_s, x = seen_s[order], x[order]
    if np.isnan(theta).all() or len(x) < 3:
        return None
    t = log["t_s"]
    at = np.arange(max(t[0], seen_s[0]), min(t[-1], seen_s[-1]), WINDOW_S)
    if len(at) < 3:
        return None
    once = _integral(t, theta)
    twice = _integral(t, once)
    tilt = np.diff(np.interp(at, t, twice), 2) / WINDOW_S**2
    place = np.interp(at, seen_s, x)
    bend = np.diff(place, 2) / WINDOW_S**2
    near = _near(at, seen_s) & _near(at, t)
    good = near[2:] & near[1:-1] & near[:-2]
    whole = _response(tilt, bend, good)
    if whole is None:
        return None
    beside = np.column_stack([place[1:-1], np.ones(len(tilt))])[good]
    left = [y[good] - beside @ np.linalg.lstsq(beside, y[good])[0] for y in (tilt, bend)]
    held = _response(left[0], left[1], np.ones(len(beside), np.bool_))
    opposite = held is not None and whole.rank * held.rank < 0.0
    return replace(whole, rank=0.0) if opposite else whole


def _integral(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Integral (n,) from the first time of what each value holds until the next."""
    return np.concatenate(([0.0], np.cumsum(values[:-1] * np.diff(t))))


def _near(at: np.ndarray, t: np.ndarray) -> np.ndarray:
    """True (k,) where a time of `at` (k,) lies in no hole of the times `t` (n,)."""
    gaps = np.diff(t)
    inside = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(gaps) - 1)
    return gaps[inside] <= MAX_HOLE * float(np.median(gaps))


def _response(cause: np.ndarray, result: np.ndarray, good: np.ndarray) -> Response | None:
    """Spearman's rank correlation, and the slope through the medians of least absolute error."""
    cause, result = cause[good], result[good]
    if len(cause) < 3 or np.ptp(cause) == 0 or np.ptp(result) == 0:
        return None
    rank = float(spearmanr(cause, result).statistic)  # pyright: ignore[reportAttributeAccessIssue]
    a, b = cause - np.median(cause), result - np.median(result)
    a, b = a[a != 0], b[a != 0]
    order = np.argsort(b / a)
    weight = np.cumsum(np.abs(a[order]))
    gain = (b / a)[order][np.searchsorted(weight, weight[-1] / 2)]
    return Response(rank, float(gain), len(cause))
