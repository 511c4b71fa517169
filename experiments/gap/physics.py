"""Which way, and by how much, a signal answers its cause: enough to find a wrong unit or sign.

Servo: over a window much longer than tau, theta rises by K times the integral of V. Ball: the
second difference x(t+h) - 2 x(t) + x(t-h) is the integral of (h - |s|) a(t+s), so it is compared
with theta under the same triangle: exact for a = gain theta, and quiet for a long h.
"""

from dataclasses import dataclass

import numpy as np

from rig.log import Log

WINDOW_S = 0.25
CLEAR = 0.6  # rank correlation beyond which the answer is certain
WINDOWS = 25  # that many are needed for it
HOLE = 3.0  # a gap of so many usual intervals is none to measure across


@dataclass(frozen=True)
class Response:
    """rank: Spearman's correlation of result and cause; gain: their ratio; windows: how many."""

    rank: float
    gain: float
    windows: int

    @property
    def clear(self) -> bool:
        """Is the answer beyond doubt?"""
        return abs(self.rank) > CLEAR and self.windows >= WINDOWS


def servo_response(log: Log, cause: str, result: str) -> Response | None:
    """theta of axis `result` to the volts of axis `cause`, gain [rad/s/V]; None: not both there."""
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
    """Acceleration of the ball along `result` to theta of `cause`, gain [m/s2/rad]; or None."""
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
    bend = np.diff(np.interp(at, seen_s, x), 2) / WINDOW_S**2
    near = _near(at, seen_s) & _near(at, t)
    return _response(tilt, bend, near[2:] & near[1:-1] & near[:-2])


def _integral(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Integral (n,) from the first time of what each value holds until the next."""
    return np.concatenate(([0.0], np.cumsum(values[:-1] * np.diff(t))))


def _near(at: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Which of the times `at` (k,) lie in no hole of the times `t` (n,)."""
    gaps = np.diff(t)
    inside = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(gaps) - 1)
    return gaps[inside] <= HOLE * float(np.median(gaps))


def _response(cause: np.ndarray, result: np.ndarray, good: np.ndarray) -> Response | None:
    """Rank correlation, and the slope through the medians by least absolute errors."""
    cause, result = cause[good], result[good]
    if len(cause) < 3 or np.ptp(cause) == 0 or np.ptp(result) == 0:
        return None
    ranks = [np.argsort(np.argsort(values)).astype(float) for values in (cause, result)]
    rank = float(np.corrcoef(ranks[0], ranks[1])[0, 1])
    a, b = cause - np.median(cause), result - np.median(result)
    a, b = a[a != 0], b[a != 0]
    order = np.argsort(b / a)
    weight = np.cumsum(np.abs(a[order]))
    gain = (b / a)[order][np.searchsorted(weight, weight[-1] / 2)]
    return Response(rank, float(gain), len(cause))
