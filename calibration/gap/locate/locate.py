"""Where the believed model is wrong: by channel, over time and state, in units of the noise floor.

A gap is the RMS innovation of the baseline over the floor of its channel, counted where its cause
was (the observer answers a push late). Which regions are told is decided by the pushes that would
explain the innovations (`pushes`); what no push explains is looked for by its loudness alone.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibration.gap.channels import Channel, channel, present
from calibration.gap.evidence import Evidence
from calibration.gap.findings import PlateMap, Profile, Where
from calibration.gap.pushes import Coordinate, Pattern, Series, best, rhythm, significance
from calibration.gap.regions import region
from calibration.gap.state import State
from rig.parameters import CHANNELS

STANDS_OUT = 12.0  # of a pattern's gain: none of the thousands of regions of a healthy log has it
SHARE = 0.3  # of what is too much in a channel: a region that explains less is not where it is
LOUD, LOUD_SIGMAS = 1.05, 5.0  # a gap that is wrong even where no region explains it
LOUDER = 1.5  # gap inside a region over the gap outside, for the region to be told
SMALLEST = 0.05  # of the samples, inside such a region and outside
LEAST = 1.015  # a gap below which a region is as good as its noise, whatever explains it
SECOND = 0.4  # of the first region's gain, for a second one to be told
STEADIER = 0.9  # of the best gain: a push that is always there is preferred to a region
RHYTHMIC = 0.5  # of what is too much, and more than any region explains: it is a rhythm
PLAIN = 0.8  # of the best gain: what the channel's own axis does is preferred
FEWEST = 8  # samples for a bin to have a gap
BLOCK_S = 0.5
SHOWN = {"time": "time", "position": "position", "speed": "speed", "reversal": "after reversal",
         "voltage": "voltage"}  # fmt: skip
STILL_M_S, STILL_RAD_S = 0.01, 0.1  # below, a motion has no direction
CELLS = 6
QUIET = "no channel departs from its noise"


@dataclass(frozen=True, eq=False)
class Located:
    """Where the model is wrong: regions with their gap, the largest first; the profiles and maps
    behind them; and the one sentence."""

    where: tuple[Where, ...]
    profiles: tuple[Profile, ...]
    maps: tuple[PlateMap, ...]
    sentence: str


def locate(state_before: State, floors: Mapping[str, float], *, evidence: Evidence | None = None
           ) -> Located:  # fmt: skip
    """Find where the model of `state_before` is wrong.

    floors: channel -> RMS innovation [rad or m] of a perfect model; channels without one are left
    out. evidence: the same logs at the noise levels of the final model, for a baseline's own have
    the missing effect in them. ValueError: a floor that is not above 0.
    """
    evidence = evidence or state_before.evidence
    if bad := {c: f for c, f in floors.items() if not (np.isfinite(f) and f > 0)}:
        raise ValueError(f"a noise floor must be above 0, got {bad}: leave such channels out")
    found = [channel(state_before, evidence, name, floors[name]) for name in CHANNELS
             if name in floors and present(evidence, name)]  # fmt: skip
    found = [c for c in found if np.isfinite(c.gap).sum() >= FEWEST]
    half_side_m = 0.5 * state_before.believed.rig.linkage.plate_side_m
    where = sorted((w for c in found for w in regions_of(c, half_side_m)), key=lambda w: -w.gap)
    profiles = tuple(p for c in found for p in profiles_of(c))
    return Located(tuple(where), profiles, maps_of(found, half_side_m), sentence(where))


def sentence(where: list[Where]) -> str:
    """The largest gap in one sentence."""
    if not where:
        return QUIET
    first = where[0]
    name = first.channel.replace("_", " ")
    size = f"{first.gap:.1f}" if first.gap >= 1.1 else f"{first.gap:.2f}"
    return f"{name}, {first.region}: {size} times the noise"


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))


def regions_of(c: Channel, half_side_m: float) -> list[Where]:
    """At most two regions in which the channel departs from its noise."""
    known = np.isfinite(c.gap)
    overall, loud = rms(c.gap[known]), is_loud(c)
    excess = 0.5 * float(np.sum(c.series.z**2 - c.series.w))
    patterns = strongest(c.series, c.coordinates, c.name[-1])
    explained = patterns[0].gain if patterns else 0.0
    hz, beat, sure = rhythm(c.series)
    if sure > STANDS_OUT and beat > explained and (not loud or beat > RHYTHMIC * excess):
        return [Where(c.name, f"everywhere, with a rhythm of {hz:.2g} Hz", overall)]
    if not patterns or (loud and explained < SHARE * excess):
        return [Where(c.name, *loudest(c, half_side_m))] if loud else []
    words = [region(p, ball=c.ball, kept=known, half_side_m=half_side_m, starts_s=c.starts_s)
             for p in patterns]  # fmt: skip
    gaps = [rms(g) if len(g := c.gap[p.inside() & known]) else overall for p in patterns]
    told = dict(zip(words[::-1], gaps[::-1], strict=True))
    return [Where(c.name, text, gap) for text, gap in told.items() if gap >= LEAST]


def strongest(series: Series, tried: list[Coordinate], axis: str) -> list[Pattern]:
    """The pattern of pushes that explains most, and one more where much is left; none by chance."""
    found: list[Pattern] = []
    for _ in range(2):
        pairs = [pair for c in tried if (pair := best(series, c)) is not None]
        if not pairs:
            break
        top, answer = plainest(pairs, axis)
        enough = max(STANDS_OUT, SECOND * found[0].gain if found else 0.0)
        if top.gain < enough or significance(series, top, answer) < STANDS_OUT:
            break
        found.append(top)
        series = replace(series, z=series.z - answer)
    return found


def plainest(pairs: list[tuple[Pattern, np.ndarray]], axis: str) -> tuple[Pattern, np.ndarray]:
    """The best pattern, but a plainer one where it explains nearly as much."""

    def worth(pair: tuple[Pattern, np.ndarray]) -> float:
        c, gain = pair[0].coordinate, pair[0].gain
        own = c.axis in ("", axis) and c.second is None
        return gain * (1.0 if c.kind == "always" else STEADIER if own else STEADIER * PLAIN)

    return max(pairs, key=worth)


def blocks(c: Channel, x: np.ndarray) -> np.ndarray:
    """Means (b,) of x (n,) over stretches of BLOCK_S."""
    slot = ((c.series.t_s - c.series.t_s[0]) / BLOCK_S).astype(int)
    known = np.isfinite(x)
    count = np.bincount(slot[known])
    total = np.bincount(slot[known], x[known])
    return total[count > 0] / count[count > 0]


def is_loud(c: Channel) -> bool:
    """Whether the channel as a whole is beyond its noise, surely."""
    square = blocks(c, c.gap**2)
    if len(square) < 3:
        return False
    spread = float(square.std(ddof=1)) / len(square) ** 0.5
    return bool(square.mean() > LOUD**2 and square.mean() - 1 > LOUD_SIGMAS * spread)


def loudest(c: Channel, half_side_m: float) -> tuple[str, float]:
    """The region that is louder than the rest, in words, and its gap; else everywhere."""
    known = np.isfinite(c.gap)
    found = [one for q in c.coordinates if q.second is None and q.kind != "always"
             for one in _louder(c.gap, q)]  # fmt: skip
    if not found:
        return "everywhere", rms(c.gap[known])
    _, pattern, gap = max(found, key=lambda one: one[0])
    words = region(pattern, ball=c.ball, kept=known, half_side_m=half_side_m, starts_s=c.starts_s)
    return words, gap


def _louder(gap: np.ndarray, q: Coordinate) -> Iterator[tuple[float, Pattern, float]]:
    """Regions of a coordinate that are clearly louder than the rest: gain, pattern, gap."""
    k, m = q.bins(), len(q.edges) - 1
    use = np.isfinite(gap) & (k >= 0)
    n = np.append(0, np.cumsum(np.bincount(k[use], minlength=m)))
    s = np.append(0, np.cumsum(np.bincount(k[use], gap[use] ** 2, minlength=m)))
    for i in range(1 if q.anchored else m):
        for j in range(i, m):
            inside = n[j + 1] - n[i]
            outside = n[-1] - inside
            if min(inside, outside) < SMALLEST * n[-1]:
                continue
            within, without = (s[j + 1] - s[i]) / inside, (s[-1] - s[j + 1] + s[i]) / outside
            if within > LOUDER**2 * without:
                gain = -inside * np.log(within) - outside * np.log(without)
                yield float(gain), Pattern(q, i, j, 0, np.zeros(0), 0.0), float(within**0.5)


def profiles_of(c: Channel) -> list[Profile]:
    """The gap of a channel over time, position, speed, direction, reversals and voltage."""
    found = [
        _profile(c, c.of(kind)) for kind in SHOWN if any(q.kind == kind for q in c.coordinates)
    ]
    speed = c.of("speed")
    assert speed.side is not None
    way = np.where(speed.value > (STILL_M_S if c.ball else STILL_RAD_S), speed.side, 0.0)
    edges = np.array([-1.5, -0.5, 0.5, 1.5])
    direction = Coordinate("direction", speed.axis, way, edges)
    gap, count = _binned(c.gap, direction)
    return [*found, Profile(c.name, "direction", "1", edges, gap, count)]


def _profile(c: Channel, q: Coordinate) -> Profile:
    gap, count = _binned(c.gap, q)
    edges = q.edges
    if q.kind == "reversal":  # what lies beyond the last edge is not drawn
        edges, gap, count = edges[:-1], gap[:-1], count[:-1]
    elif not np.isfinite(edges[-1]):  # drawn as wide as all before it
        edges = np.append(edges[:-1], 2 * max(edges[-2], 1e-3))
    if q.kind == "voltage" and q.side is not None:
        volts = np.clip(q.value * q.side, -edges[-1], edges[-1])
        both = np.concatenate([-edges[:0:-1], edges])
        signed = replace(q, value=volts, side=None, edges=both)
        edges, (gap, count) = signed.edges, _binned(c.gap, signed)
    units = {"time": "s", "reversal": "s", "voltage": "V", "position": "m" if c.ball else "rad",
             "speed": "m/s" if c.ball else "rad/s"}  # fmt: skip
    return Profile(c.name, SHOWN[q.kind], units[q.kind], edges, gap, count)


def _binned(gap: np.ndarray, q: Coordinate) -> tuple[np.ndarray, np.ndarray]:
    """RMS gap (m,) and number of samples (m,) by bin; NaN where too few fell."""
    k, m = q.bins(), len(q.edges) - 1
    use = np.isfinite(gap) & (k >= 0)
    count = np.bincount(k[use], minlength=m)
    total = np.bincount(k[use], gap[use] ** 2, minlength=m)
    return np.where(count >= FEWEST, np.sqrt(total / np.maximum(count, 1)), np.nan), count


def maps_of(found: list[Channel], half_side_m: float) -> tuple[PlateMap, ...]:
    """The mean innovation over the part of the plate that the ball visited; a missing axis is 0."""
    balls = {c.name[-1]: c for c in found if c.ball}
    if not balls:
        return ()
    some = next(iter(balls.values()))
    places = [q for q in some.coordinates if q.kind == "position"]
    x, y = (next(q.value for q in places if q.axis == axis) for axis in "xy")
    reach = min(max(float(np.abs([x, y]).max()), 1e-3), half_side_m)
    edges = np.linspace(-reach, reach, CELLS + 1)
    i, j = (Coordinate("position", "", np.clip(v, -reach, reach), edges).bins() for v in (x, y))
    known = np.all([np.isfinite(c.gap) for c in balls.values()], axis=0)
    cell = (j * CELLS + i)[known]
    count = np.bincount(cell, minlength=CELLS**2)
    mean = np.zeros((CELLS, CELLS, 2))
    for a, axis in enumerate("xy"):
        if axis in balls:
            total = np.bincount(cell, balls[axis].gap[known], minlength=CELLS**2)
            mean[..., a] = (total / np.maximum(count, 1)).reshape(CELLS, CELLS)
    return (PlateMap(edges, edges, mean, count.reshape(CELLS, CELLS)),)
