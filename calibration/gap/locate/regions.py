"""Regions in the words of the lab: "within 80 ms after the x servo reverses"."""

from math import degrees, inf

import numpy as np

from calibration.gap.locate.disturbances import Pattern

WHOLE_SHARE = 0.85  # a region with this share of the samples is no region
SIDE_WORDS = {"x": ("left", "right"), "y": ("near", "far")}  # y points away from the operator
PLATE_EDGE_SHARE = 0.5  # of the half side of the plate: beyond it, "edge"


def _from_zero(pattern: Pattern) -> tuple[float, float]:
    """The edges of a magnitude; below the first it is as good as zero, unless all above counts."""
    edges = pattern.coordinate.edges
    low, high = float(edges[pattern.first]), float(edges[pattern.last + 1])
    return (0.0 if pattern.first <= 1 and high < inf else low), high


def number(value: float) -> str:
    """`value` with two significant digits; from 100 on, rounded to a whole number."""
    return f"{value:.2g}" if abs(value) < 100 else f"{value:.0f}"


def region(
    pattern: Pattern, *, ball: bool, kept: np.ndarray, half_side_m: float, starts_s: np.ndarray
) -> str:
    """The region of a pattern in plain words. `ball`: whether the channel is one of the ball's;
    `kept` (n,): whether each sample counts; `half_side_m`: half the plate's side; `starts_s` (r,):
    where each run begins on the common time axis."""
    c = pattern.coordinate
    inside = pattern.inside()
    counted = kept & (c.bins() >= 0)
    whole = bool(inside[counted].mean() >= WHOLE_SHARE) if counted.any() else True
    if c.kind == "always":
        return "everywhere, always to the same side"
    if c.kind == "time":
        return "everywhere" if whole else _time(pattern, starts_s)
    if c.kind == "place":
        return _place(pattern, half_side_m)
    if c.kind == "reversal":
        return _reversal(pattern)
    if c.kind in ("speed", "turning"):
        return _speed(pattern, ball and c.kind == "speed", whole)
    if c.kind == "voltage":
        return _volts(pattern, whole)
    if c.kind == "position" and ball:
        return _position(pattern, half_side_m, whole)
    return _angle(pattern, whole)


def _ends(pattern: Pattern) -> tuple[float, float]:
    """Low and high edge; infinite at the ends of the coordinate, whose bins are open."""
    edges = pattern.coordinate.edges
    low = -inf if pattern.first == 0 else float(edges[pattern.first])
    high = inf if pattern.last == len(edges) - 2 else float(edges[pattern.last + 1])
    return low, high


def _between(name: str, low: float, high: float, scale: float, unit: str) -> str:
    if low == -inf:
        return f"{name} below {number(scale * high)} {unit}"
    if high == inf:
        return f"{name} above {number(scale * low)} {unit}"
    return f"{name} between {number(scale * low)} and {number(scale * high)} {unit}"


def _time(pattern: Pattern, starts_s: np.ndarray) -> str:
    edges = pattern.coordinate.edges
    low, high = float(edges[pattern.first]), float(edges[pattern.last + 1])
    runs = [max(int(np.searchsorted(starts_s, t, side="right")) - 1, 0) for t in (low, high - 1e-6)]
    begin, end = (t - starts_s[r] for t, r in zip((low, high), runs, strict=True))
    if len(starts_s) == 1:
        return f"from {begin:.1f} to {end:.1f} s"
    if runs[0] == runs[1]:
        return f"in log {runs[0] + 1}, from {begin:.1f} to {end:.1f} s"
    return f"from {begin:.1f} s of log {runs[0] + 1} to {end:.1f} s of log {runs[1] + 1}"


def _reversal(pattern: Pattern) -> str:
    c = pattern.coordinate
    edges = c.edges
    high = edges[pattern.last + 1]
    way = {1: " towards plus", -1: " towards minus", 0: ""}[pattern.side]
    what = f"after the {c.axis} servo reverses{way}"
    if not np.isfinite(high):
        return f"{what}, until it reverses again"
    return f"within {1000 * high:.0f} ms {what}"


def _speed(pattern: Pattern, ball: bool, whole: bool) -> str:
    c = pattern.coordinate
    low, high = _from_zero(pattern)
    verb = "the ball rolls" if ball else f"the {c.axis} servo turns"
    factor, unit = (1000.0, "mm/s") if ball else (degrees(1), "deg/s")
    way = ""
    if pattern.side:
        way = f" towards {'plus' if pattern.side > 0 else 'minus'} {c.axis}"
        if ball:
            way = f" towards the {SIDE_WORDS[c.axis][pattern.side > 0]}"
            way = way.replace("near", "near side").replace("far", "far side")
    sense = "" if way else _against(pattern)
    if whole or (low == 0 and high == inf):
        return f"while {verb}{way}{sense}"
    if low == 0:
        return f"while {verb}{way} slower than {number(factor * high)} {unit}{sense}"
    if high == inf:
        return f"while {verb}{way} faster than {number(factor * low)} {unit}{sense}"
    return f"while {verb}{way} at {number(factor * low)} to {number(factor * high)} {unit}{sense}"


def _against(pattern: Pattern) -> str:
    """Whether the pushes are along or against the motion, where they are one or the other."""
    c = pattern.coordinate
    half = len(pattern.sizes) // 2
    if c.side is None or not half or 2 * half != len(pattern.sizes):
        return ""
    k = c.bins()
    count = [
        np.bincount(k[(c.side == side) & pattern.inside()] - pattern.first, minlength=half)
        for side in (1, -1)
    ]
    if any(len(n) != half or not n.any() for n in count):
        return ""
    forth = np.average(pattern.sizes[:half], weights=count[0])
    back = np.average(pattern.sizes[half:], weights=count[1])
    if forth * back >= 0 or min(abs(forth), abs(back)) < 0.3 * max(abs(forth), abs(back)):
        return ""
    return ", against its motion" if forth < 0 else ", along its motion"


def _volts(pattern: Pattern, whole: bool) -> str:
    low, high = _from_zero(pattern)
    sign = {1: "positive ", -1: "negative ", 0: ""}[pattern.side]
    if (whole or (low == 0 and high == inf)) and not sign:
        return "everywhere, depending on the voltage"
    if low == 0 and high == inf:
        return f"at {sign}voltages"
    if low == 0:
        return f"at {sign}voltages below {number(high)} V"
    if high == inf:
        return f"at {sign}voltages beyond {number(low)} V"
    return f"at {sign}voltages between {number(low)} and {number(high)} V"


def _position(pattern: Pattern, half_side_m: float, whole: bool) -> str:
    axis = pattern.coordinate.axis
    low, high = _ends(pattern)
    if whole or (low == -inf and high == inf):
        return f"over the whole plate, depending on {axis}"
    words = _between(axis, low, high, 1000.0, "mm")
    for side, at in ((0, -high), (1, low)):
        if np.isfinite(at) and (low == -inf, high == inf)[side]:
            part = "edge" if at >= PLATE_EDGE_SHARE * half_side_m else "part"
            return f"{SIDE_WORDS[axis][side]} {part} of the plate ({words})"
    return f"where the ball is at {words}"


def _place(pattern: Pattern, half_side_m: float) -> str:
    second = pattern.coordinate.second
    assert second is not None
    pairs = [(pattern.coordinate, pattern.first, pattern.last), (second, *pattern.second)]
    parts = []
    for c, first, last in pairs:
        if first > 0 or last < len(c.edges) - 2:
            one = Pattern(c, first, last, 0, np.zeros(0), 0.0)
            parts.append(_between(c.axis, *_ends(one), 1000.0, "mm"))
    if not parts:
        return "over the whole plate, depending on the place"
    return f"where the ball is on the plate at {' and '.join(parts)}"


def _angle(pattern: Pattern, whole: bool) -> str:
    axis = pattern.coordinate.axis
    low, high = _ends(pattern)
    if whole or (low == -inf and high == inf):
        return f"everywhere, depending on the angle of the {axis} servo"
    return f"where {_between(f'the {axis} servo stands', low, high, degrees(1), 'deg')}"
