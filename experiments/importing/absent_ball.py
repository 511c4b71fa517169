"""Which values of the ball's columns mean `no ball`: -1, 0, 9999, the panel's end, a corner, and
places that a detector holds."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

MIN_ROWS = 3  # a lost ball is lost for longer than a moment, or again and again
LONG_ROWS = 10
FAR = 8.0  # of the 99 % quantile of the steps between rows: no ball moves so between two rows
NEAR = 2.0  # so far a ball may move: between NEAR and FAR it cannot be told
LONGER = 3.0  # times the longest stay anywhere else: no ball rests so much better in one place
HOLE = 5.0  # usual times between two known rows, over which a ball may come from anywhere
SUDDEN = 3.0  # times the ball's step before or after: one that was pushed moves on so fast
# Chosen: this share of the steps lies within the usual distance off the line, so that fewer than
# the rest may jump; ten times as far is no noise.
USUAL, ROUGH = 0.7, 10.0
MIN_ROUGH = 50  # chosen: of fewer steps no share is told
_CONDITION = re.compile(r"(.+?)\s*([<>]=?)\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)")
_HOLDS = {
    "": np.greater,
    ">": np.greater,
    ">=": np.greater_equal,
    "<": np.less,
    "<=": np.less_equal,
}
BEYOND = 2.0  # widths of the middle 90 % of the places, beyond which no ball comes in one step


@dataclass(frozen=True, eq=False)
class _Stays:
    """Where `points` (n, k) stay the same: place (m, k), rows (m,), and the steps into and out of
    it (m,), NaN where there is none."""

    points: np.ndarray
    steps: np.ndarray
    place: np.ndarray
    rows: np.ndarray
    sides: np.ndarray

    def at(self, place: Sequence[float]) -> np.ndarray:
        """Which stays (m,) are there."""
        return np.all(self.place == np.array(place), axis=1)

    def rest(self, place: Sequence[float]) -> np.ndarray:
        """Steps that are none, into, within or out of this place."""
        inside = np.all(self.points == np.array(place), axis=1)
        return self.steps[~inside[1:] & ~inside[:-1] & (self.steps > 0)]


def _stays(columns: Sequence[np.ndarray], seconds: np.ndarray | None = None) -> _Stays:
    """Stays of the rows in which each coordinate (n,) is known, and when; steps over a hole in
    `seconds` (n,) are none."""
    points = np.column_stack(columns)
    known = np.isfinite(points).all(axis=1)
    if seconds is not None:
        known &= np.isfinite(seconds)
    points = points[known]
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if seconds is not None and len(steps):
        waits = np.diff(seconds[known])
        steps = np.where(waits <= HOLE * np.median(waits), steps, np.nan)
    moves = 1 + np.flatnonzero(np.any(points[1:] != points[:-1], axis=1))
    edges = np.unique(np.r_[0, moves, len(points)])
    ends = np.r_[np.nan, steps, np.nan]
    sides = np.column_stack((ends[edges[:-1]], ends[edges[1:]]))
    return _Stays(points, steps, points[edges[:-1]], np.diff(edges), sides)


def absent_codes(columns: list[np.ndarray]) -> tuple[tuple[float, ...], bool]:
    """The value of each coordinate ((n,) each, 1 or 2) that means `no ball`, and if that is sure.

    Such a value is repeated exactly in all coordinates at once, and the ball jumps to it and from
    it; or it is a whole number, and stays far longer than any other place. Empty where there is
    none. Not sure: the jumps are no larger than a fast ball's.
    """
    stays = _stays(columns)
    points = stays.points
    if len(points) < 10:
        return (), True
    for key in _candidates(stays):
        inside = np.all(points == np.array(key), axis=1)
        rest, jumps = stays.rest(key), stays.steps[inside[1:] != inside[:-1]]
        if inside.sum() < MIN_ROWS or len(rest) < 5 or not len(jumps):
            continue
        usual, jump = float(np.quantile(rest, 0.99)), float(np.median(jumps))
        whole = all(value == int(value) for value in key)
        apart = points[~inside]
        corner = bool(np.any(np.all(apart > key, axis=0) | np.all(apart < key, axis=0)))
        here = stays.at(key)
        stuck = whole and stays.rows[here].max() >= _stuck(stays, here)
        if jump > FAR * usual or stuck or (jump > 3 * usual and corner and whole):
            return key, True
        lasts = np.any(stays.rows[here] >= MIN_ROWS)
        if jump > NEAR * usual and len(jumps) >= 2 and lasts:
            return key, False
    return (), True


def alone_codes(
    values: np.ndarray, seconds: np.ndarray
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """The values of one coordinate (n,) that surely mean `no ball` by themselves, and those that
    may. seconds (n,): when.

    Surely: the ball jumps to it and from it whenever it is there, or comes there in one step from
    afar, where no other place is. Perhaps: it lasts there, and jumps on one side alone; or it
    rolls over it at other times.
    """
    stays = _stays([values], seconds)
    known = np.isfinite(stays.sides)
    sure, open_ = _beyond(stays), []
    for key in _candidates(stays):
        here, rest = stays.at(key), stays.rest(key)
        if key[0] in sure or len(rest) < 5:
            continue
        far = stays.sides > FAR * float(np.quantile(rest, 0.99))
        far &= stays.sides > SUDDEN * _steps_about(stays, here)
        clear = here & far.any(axis=1) & (far | ~known).all(axis=1)
        half = here & far.any(axis=1) & (stays.rows >= _stuck(stays, here))
        if stays.rows[clear | half].sum() >= MIN_ROWS:
            (sure if clear[here].all() else open_).append(key[0])
    return tuple(sure), tuple(open_)


def held_rows(columns: list[np.ndarray], seconds: np.ndarray) -> tuple[int, bool]:
    """From how many known rows on a place that stays is one that the detector holds while the ball
    is lost, 0 where it holds none; and if that is sure.

    Such places are several, the ball rolls to each, and jumps from it. Not sure: there is one, or
    it rolls from most, as a ball that rests, which coarse readings show as still.
    """
    stays = _stays(columns, seconds)
    if len(stays.rows) < 10:
        return 0, True
    least = max(LONG_ROWS, int(np.ceil(LONGER * np.quantile(stays.rows, 0.95))))
    long = stays.rows >= least
    into, out = stays.sides.T
    steps = into[~long & np.isfinite(into) & ~np.r_[False, long[:-1]]]
    if len(steps) < 5:
        return 0, True
    usual = float(np.quantile(steps, 0.99))
    come = long & (into <= usual)
    left = (out > FAR * usual) & (out > SUDDEN * _steps_about(stays, long)[:, 1])
    held, rests = come & left, come & (out <= NEAR * usual)
    if not held.any():
        return 0, True
    several = len(np.unique(stays.place[held], axis=0)) > 1
    return least, several and bool(held.sum() > rests.sum())


def _stuck(stays: _Stays, here: np.ndarray) -> float:
    """Rows that no ball rests at one place, of the stays `here` (m,), by those elsewhere."""
    return max(LONG_ROWS, LONGER * max(stays.rows[~here], default=1))


def _steps_about(stays: _Stays, here: np.ndarray) -> np.ndarray:
    """The ball's steps (m, 2) before the one into a stay and after the one out of it, where the
    stays `here` (m,) are left out; 0 for none."""
    others = np.flatnonzero(~here)
    steps = np.linalg.norm(np.diff(stays.place[others], axis=0), axis=1)
    padded = np.r_[0.0, 0.0, steps, 0.0, 0.0]
    at = np.searchsorted(others, np.arange(len(here)))
    return np.column_stack((padded[at], padded[at + 2]))


def _beyond(stays: _Stays) -> list[float]:
    """Places of one coordinate that lie far beyond the others, and are come to from those, and left
    to them, in one step."""
    seen = stays.points
    if len(seen) < 10:
        return []
    low, high = np.quantile(seen, 0.05, method="higher"), np.quantile(seen, 0.95, method="lower")
    width = high - low
    place = stays.place[:, 0]
    outside = (place < low - BEYOND * width) | (place > high + BEYOND * width)
    known = np.isfinite(stays.sides)
    known[0, 0] = True  # a sensor that begins with one
    near = ~np.r_[False, outside[:-1]] & ~np.r_[outside[1:], False] & known.all(axis=1)
    few = (stays.rows < LONG_ROWS) & (width > 0)
    return np.unique(place[outside & near & few]).tolist()


def _candidates(stays: _Stays) -> list[tuple[float, ...]]:
    """The five places that last longest, and of those that were come to MIN_ROWS times the five
    with the largest steps: a detector that misses single rows."""
    lasting, into = Counter[tuple[float, ...]](), dict[tuple[float, ...], list[float]]()
    each = (stays.place.tolist(), stays.rows.tolist(), stays.sides[:, 0].tolist())
    for place, rows, step in zip(*each, strict=True):
        key = tuple(place)
        lasting[key] += rows if rows >= MIN_ROWS else 0
        if np.isfinite(step):
            into.setdefault(key, []).append(step)
    known = [key for key, come in into.items() if len(come) >= MIN_ROWS]
    far = sorted(known, key=lambda key: -float(np.median(into[key])))[:5]
    return list(dict.fromkeys([*(key for key, _ in lasting.most_common(5)), *far]))


def jumps(columns: Sequence[np.ndarray], seconds: np.ndarray) -> float:
    """Share of the steps from place to place that no ball makes: it leaves the line between its
    neighbours ROUGH times as far as noise and tilt take it, and is back on its way with the next
    step; one that is pushed or thrown back goes on. NaN where too little is known without holes.
    columns: (n,) each; seconds (n,): when."""
    points = np.column_stack(columns)
    known = np.isfinite(points).all(axis=1) & np.isfinite(seconds)
    points, seconds = points[known], seconds[known]
    moved = np.r_[True, np.any(points[1:] != points[:-1], axis=1)][: len(points)]
    if np.sum(moved) < MIN_ROUGH:
        return np.nan
    steps, waits = np.diff(points[moved], axis=0), np.diff(seconds[moved])[:, None]
    near = ((waits > 0) & (waits <= HOLE * np.median(waits))).ravel()
    known = near[1:] & near[:-1]
    if np.sum(known) < MIN_ROUGH:
        return np.nan
    before, after = waits[:-1][known], waits[1:][known]
    off = np.zeros((len(known), points.shape[1]))
    off[known] = (steps[:-1][known] * after - steps[1:][known] * before) / (before + after)
    far = np.linalg.norm(off, axis=1)
    far = far > ROUGH * np.quantile(far[known], USUAL)
    back = np.sum(off[1:] * off[:-1], axis=1) < 0
    return float(np.mean(far[1:] & far[:-1] & back))


def seen_rows(columns: Mapping[str, np.ndarray], conditions: Iterable[str]) -> np.ndarray:
    """Rows (n,) in which all conditions hold: `NAME` (more than 0), `NAME >= 0.6`, `NAME < 1` ... A
    blank is no yes. columns: by name, (n,) each. KeyError: no column has that name."""
    seen = np.ones(len(next(iter(columns.values()))), bool)
    for condition in conditions:
        name, sign, limit = condition_of(condition)
        seen &= _HOLDS[sign](columns[name], limit)
    return seen


def condition_of(text: str) -> tuple[str, str, float]:
    """The column, the sign (`>`, `>=`, `<`, `<=` or nothing), and the limit of a condition."""
    match = _CONDITION.fullmatch(text)
    return (match[1], match[2], float(match[3])) if match else (text, "", 0.0)


def gone(
    columns: Sequence[np.ndarray],
    absent: Sequence[Sequence[float]] = (),
    alone: Sequence[Sequence[float]] = (),
    held: int = 0,
) -> np.ndarray:
    """Rows (n,) without a ball: a coordinate is blank or has one of the values that say so `alone`,
    each has one that is `absent`, or a place stays for `held` known rows, after its first."""
    known = np.all([np.isfinite(values) for values in columns], axis=0)
    out = ~known
    if absent:
        out |= np.all([np.isin(v, c) for v, c in zip(columns, absent, strict=True)], axis=0)
    for values, codes in zip(columns, alone, strict=False):
        out |= np.isin(values, codes)
    if held:
        rows = _stays(columns).rows
        later = np.arange(rows.sum()) > np.repeat(np.cumsum(rows) - rows, rows)
        out[np.flatnonzero(known)[later & np.repeat(rows >= held, rows)]] = True
    return out
