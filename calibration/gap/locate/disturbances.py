"""Where an unexplained disturbance acts, if it depends on time or state.

An innovation responds to a disturbance late and smeared (the observer has memory), so bins of
innovations show little. Here a disturbance f, one free size a bin, is filtered by the
observer's response h and fitted to the innovations z:

    C = h * f,   A = C'C,   b = C'z,   gain = b'A^-1 b/2 - PENALTY_PER_SIZE k

(score test, k sizes, nothing iterated). The model fails in the region of bins that gains most.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import exp, sqrt

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import fftconvolve

# Log-likelihood that a free size costs; as decision_rule.PENALTY_PER_PARAMETER.
PENALTY_PER_SIZE = 3.0
NEARLY_BEST_SHARE = 0.9  # of the best gain: the smallest region that reaches it is reported
CLIP_Z = 5.0  # standard deviations at which innovations are clipped
RESPONSE_S = 4.0  # of the observer to a disturbance
RHYTHM_NEIGHBOURS = 120  # frequencies on either side that a rhythm is compared with


@dataclass(frozen=True, eq=False)
class Series:
    """The innovations of a channel: `z` (n,) over their expected deviation, 0 where masked; `w`
    (n,): the mask, 0 or 1; `h` (l,): the observer's response to a disturbance, of unit power;
    `segments`: slices in which the observer runs on; `t_s` (n,): times on one axis for all runs."""

    z: np.ndarray
    w: np.ndarray
    h: np.ndarray
    segments: tuple[slice, ...]
    t_s: np.ndarray

    def responses(self, forces: np.ndarray) -> np.ndarray:
        """The innovations (n, m) that the disturbances `forces` (n, m) cause: each column convolved
        with h within the segments, 0 where masked."""
        out = np.zeros(forces.shape)
        for part in self.segments:
            length = part.stop - part.start
            h = self.h[:length, None]
            out[part] = fftconvolve(forces[part], h, axes=0)[:length]
        return out * self.w[:, None]

    def apparent(self) -> np.ndarray:
        """The apparent disturbance (n,) of each sample by the matched filter (correlation of z with
        h); its variance is 1 where there is no disturbance."""
        out = np.zeros(len(self.z))
        for part in self.segments:
            length = part.stop - part.start
            h = self.h[:length][::-1]
            out[part] = fftconvolve(self.z[part], h)[len(h) - 1 :]
        return out

    @property
    def lag(self) -> int:
        """Samples from a disturbance to the largest value of the response h."""
        return int(np.argmax(np.abs(self.h)))


def response(step_s: float, process: float, measured: float, tau_s: float = np.inf) -> np.ndarray:
    """Innovations (l,), scaled to unit power, of a steady-state Kalman filter of position and speed
    after a short disturbance.

    `step_s`: sampling period; `process`: density of white acceleration [m or rad, /s2/sqrt(Hz)];
    `measured`: standard deviation of a position [m or rad]; `tau_s`: time constant in which speed
    decays (infinite: a free mass).
    """
    decay = exp(-step_s / tau_s)
    reach = tau_s * (1.0 - decay) if np.isfinite(tau_s) else step_s
    f = np.array([[1.0, reach], [0.0, decay]])
    q = process**2 * step_s * np.array([[step_s**2 / 3, step_s / 2], [step_s / 2, 1.0]])
    p, gain, count = np.diag([measured**2, 1.0]), np.zeros(2), int(max(RESPONSE_S / step_s, 8))
    for _ in range(count):
        p = f @ p @ f.T + q
        gain = p[:, 0] / (p[0, 0] + measured**2)
        p = p - np.outer(gain, p[0])
    after = f @ (np.eye(2) - np.outer(gain, [1.0, 0.0]))
    state, h = np.array([0.5 * step_s, 1.0]), np.empty(min(count, 4000))
    for k in range(len(h)):
        h[k] = state[0]
        state = after @ state
    h = h[: np.flatnonzero(np.abs(h) > 1e-3 * np.abs(h).max())[-1] + 1]
    return h / sqrt(float(h @ h))


@dataclass(frozen=True, eq=False)
class Coordinate:
    """A quantity on which a disturbance may depend, in bins: `value` (n,) by sample, `edges` (m +
    1,).

    `kind` and `axis` name it. `side` (n,), -1, 0 or 1: the direction of a motion; each bin (of a
    magnitude then) has one size for either side. `second`: the other coordinate of a place.
    `whole`: a region has one size, not one for each bin. `anchored`: a region begins with the first
    bin.
    """

    kind: str
    axis: str
    value: np.ndarray
    edges: np.ndarray
    side: np.ndarray | None = None
    second: "Coordinate | None" = None
    whole: bool = False
    anchored: bool = False

    def bins(self) -> np.ndarray:
        """The bin (n,) of every sample, -1 outside the edges."""
        with np.errstate(invalid="ignore"):
            found = np.searchsorted(self.edges, self.value, side="right") - 1
        inside = np.isfinite(self.value) & (self.value <= self.edges[-1]) & (found >= 0)
        return np.where(inside, np.minimum(found, len(self.edges) - 2), -1)


@dataclass(frozen=True, eq=False)
class Pattern:
    """A disturbance within the bins `first` to `last` of a coordinate (`second`: first and last bin
    of the second coordinate), on one side (+1 or -1) or both (0); `sizes` (k,), and the gain less
    what they cost."""

    coordinate: Coordinate
    first: int
    last: int
    side: int
    sizes: np.ndarray
    gain: float
    second: tuple[int, int] = (0, 0)

    def inside(self) -> np.ndarray:
        """Whether each sample (n,) lies in the region."""
        c = self.coordinate
        k = c.bins()
        found = (k >= self.first) & (k <= self.last)
        if c.second is not None:
            k2 = c.second.bins()
            found &= (k2 >= self.second[0]) & (k2 <= self.second[1])
        if c.side is not None and self.side:
            found &= c.side == self.side
        return found


def columns(c: Coordinate) -> np.ndarray:
    """Unit disturbances (n, bins), each 1 in the samples of one bin; where the coordinate has
    sides, the bins of side 1 come first and then those of side -1."""
    k, m = c.bins(), len(c.edges) - 1
    if c.second is not None:
        m2 = len(c.second.edges) - 1
        k2 = c.second.bins()
        k, m = np.where((k >= 0) & (k2 >= 0), k * m2 + k2, -1), m * m2
    sides = (0,) if c.side is None else (1, -1)
    out = np.zeros((len(k), m * len(sides)))
    for s, side in enumerate(sides):
        rows = np.flatnonzero((k >= 0) if c.side is None else (k >= 0) & (c.side == side))
        out[rows, k[rows] + s * m] = 1.0
    return out


def _choices(c: Coordinate) -> Iterator[tuple[np.ndarray, int, int, int, tuple[int, int]]]:
    """Every region of a coordinate: its columns, first and last bin, side, second bins."""
    m = len(c.edges) - 1
    pairs = [(i, j) for i in range(1 if c.anchored else m) for j in range(i, m)]
    if c.second is not None:
        m2 = len(c.second.edges) - 1
        grid = np.arange(m * m2).reshape(m, m2)
        others = [(i, j) for i in range(m2) for j in range(i, m2)]
        for i, j in pairs:
            for a, b in others:
                yield grid[i : j + 1, a : b + 1].ravel(), i, j, 0, (a, b)
        return
    for i, j in pairs:
        own = np.arange(i, j + 1)
        if c.side is None:
            yield own, i, j, 0, (0, 0)
            continue
        yield np.concatenate([own, own + m]), i, j, 0, (0, 0)
        yield own, i, j, 1, (0, 0)
        yield own + m, i, j, -1, (0, 0)


def best(series: Series, c: Coordinate) -> tuple[Pattern, np.ndarray] | None:
    """The smallest region of a coordinate (by power) that gains nearly as much as the best one, and
    the innovations (n,) that it explains; None where no bin has samples."""
    forces = series.responses(columns(c))
    a, b = forces.T @ forces, forces.T @ series.z
    power = a.diagonal().copy()
    a[np.diag_indices_from(a)] += 1e-6 * max(float(power.mean()), 1e-9)
    found = []
    for chosen, i, j, side, second in _choices(c):
        own = chosen[power[chosen] > 1e-9]
        if len(own):
            sizes = _sizes(a[np.ix_(own, own)], b[own], c.whole)
            gain = 0.5 * float(b[own] @ sizes) - PENALTY_PER_SIZE * (1 if c.whole else len(own))
            found.append(
                (float(power[own].sum()), own, Pattern(c, i, j, side, sizes, gain, second))
            )
    if not found:
        return None
    top = max(pattern.gain for _, _, pattern in found)
    good = [one for one in found if one[2].gain >= top - (1 - NEARLY_BEST_SHARE) * abs(top)]
    _, own, pattern = min(good, key=lambda one: one[0])
    return pattern, forces[:, own] @ pattern.sizes


def _sizes(a: np.ndarray, b: np.ndarray, whole: bool) -> np.ndarray:
    """The sizes (k,) that gain most: A d = b, or one size for all."""
    return np.full(len(b), b.sum() / a.sum()) if whole else np.linalg.solve(a, b)


def significance(series: Series, pattern: Pattern, answer: np.ndarray) -> float:
    """The region's gain over the noise level that is left without `answer` (n,), the innovations
    that it explains; its cost is subtracted after the division. Coloured noise thereby makes no
    region significant."""
    left = replace(series, z=series.z - answer)
    level = max(1.0, float(np.mean(left.apparent()[series.w > 0] ** 2)))
    cost = PENALTY_PER_SIZE * (1 if pattern.coordinate.whole else len(pattern.sizes))
    return (pattern.gain + cost) / level - cost


def rhythm(series: Series) -> tuple[float, float, float]:
    """Frequency [Hz], gain and significance of the sinusoidal disturbance that gains most
    (periodogram); the last two less what it costs.

    The significance is the gain over the level of the neighbouring frequencies. (0, 0, 0): the
    series is too short.
    """
    step = float(np.median(np.diff(series.t_s)))
    slots = np.round((series.t_s - series.t_s[0]) / step).astype(int)
    length = 4 * (slots[-1] + 1)
    if length < 128:
        return 0.0, 0.0, 0.0
    power = np.abs(np.fft.rfft(series.h, length)) ** 2
    hz = np.fft.rfftfreq(length, step)
    fine = (hz > max(0.3, 32.0 / (length * step))) & (hz < 0.4 / step)
    fine &= power > 1e-2 * power.max()
    if not fine.any():
        return 0.0, 0.0, 0.0
    apparent, window = series.apparent(), np.sin(np.pi * slots / slots[-1]) ** 2

    def spectrum(weights: np.ndarray) -> np.ndarray:
        line = np.fft.rfft(np.bincount(slots, weights * apparent, length))
        return np.abs(line[fine]) ** 2 / (power[fine] * float(weights**2 @ series.w))

    gain = spectrum(np.ones(len(apparent)))
    beside = median_filter(spectrum(window), 2 * RHYTHM_NEIGHBOURS + 1, mode="nearest") / np.log(2)
    k = int(np.argmax(gain / np.maximum(beside, 1.0)))
    cost = 4 * PENALTY_PER_SIZE
    return float(hz[fine][k]), float(gain[k]) - cost, float(gain[k] / max(beside[k], 1.0)) - cost
