"""Where the nominal model is wrong: by channel, over time and state, in units of the noise floor.

A gap is the RMS innovation of the baseline over the floor of its channel, counted at the time of
its cause (the observer responds late). The regions reported are those in which a disturbance would
explain the innovations (`disturbances`); where none does, those that are louder than the rest.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibration.gap.findings import PlateMap, Profile, Where
from calibration.gap.locate.channels import Channel, channel, present
from calibration.gap.locate.coordinates import by_run
from calibration.gap.locate.disturbances import (
    Coordinate,
    Pattern,
    Series,
    best,
    rhythm,
    significance,
)
from calibration.gap.locate.regions import region
from calibration.gap.model.data import Evidence
from calibration.gap.model.state import State
from rig.parameters import CHANNELS

# Log-likelihood gain of a region: 2 x 12 is a chi-square of 24 on 1 degree of freedom, p = 1e-6;
# with about 1000 regions tested the probability of a false one is about 0.1 %.
MIN_REGION_GAIN = 12.0
# The others decide what is shown, not the verdict; chosen.
MIN_EXPLAINED_SHARE = 0.3  # of the excess of a channel, for a region to be where it comes from
LOUD_GAP, LOUD_SIGMAS = 1.05, 5.0  # a gap that is reported though no region explains it
LOUDER_RATIO = 1.5  # of the gap inside such a region to that outside
MIN_SAMPLE_SHARE = 0.05  # of the samples, inside such a region and outside
MIN_REGION_GAP = 1.015  # a region with less is not reported
SECOND_REGION_SHARE = 0.4  # of the first region's gain, for a second one
# A constant disturbance is preferred if it reaches this share of the gain.
CONSTANT_PREFERENCE = 0.9
OWN_AXIS_PREFERENCE = 0.8  # likewise a coordinate of the channel's own axis
RHYTHM_SHARE = 0.5  # of the excess, for a rhythm to be reported instead of a region
MIN_BIN_SAMPLES = 8  # for a bin to have a gap
LOUDNESS_BLOCK_S = 0.5  # of the means whose scatter says how sure a gap is
PROFILE_QUANTITIES = {
    "time": "time",
    "position": "position",
    "speed": "speed",
    "reversal": "after reversal",
    "voltage": "voltage",
}
STILL_M_S, STILL_RAD_S = 0.01, 0.1  # below, a motion has no direction
MAP_CELLS = 6
NO_DEPARTURE = "no channel departs from its noise"


@dataclass(frozen=True, eq=False)
class Located:
    """Where the model is wrong: regions with their gap, the largest first; the profiles and maps
    behind them; and one sentence that names the first region."""

    where: tuple[Where, ...]
    profiles: tuple[Profile, ...]
    maps: tuple[PlateMap, ...]
    sentence: str


def locate(
    state_before: State, floors: Mapping[str, float], *, evidence: Evidence | None = None
) -> Located:
    """Find where the model of `state_before` is wrong.

    `floors`: channel -> RMS innovation [rad or m] of a perfect model; channels without one are left
    out. `evidence`: the logs at the noise levels of the final model, for a baseline's own levels
    contain the missing effect; None: the baseline's.

    `ValueError`: a floor that is not finite and above 0.
    """
    evidence = evidence or state_before.evidence
    if bad := {c: f for c, f in floors.items() if not (np.isfinite(f) and f > 0)}:
        raise ValueError(f"a noise floor must be above 0, got {bad}: leave such channels out")
    found = [
        channel(state_before, evidence, name, floors[name])
        for name in CHANNELS
        if name in floors and present(evidence, name)
    ]
    found = [c for c in found if np.isfinite(c.gap).sum() >= MIN_BIN_SAMPLES]
    half_side_m = 0.5 * state_before.nominal.rig.linkage.side_m
    where = sorted((w for c in found for w in regions_of(c, half_side_m)), key=lambda w: -w.gap)
    profiles = tuple(p for c in found for p in profiles_of(c))
    return Located(tuple(where), profiles, maps_of(found, half_side_m), sentence(where))


def sentence(where: list[Where]) -> str:
    """The first region of `where`, the one with the largest gap, in words; NO_DEPARTURE if there is
    none."""
    if not where:
        return NO_DEPARTURE
    first = where[0]
    name = first.channel.replace("_", " ")
    size = f"{first.gap:.1f}" if first.gap >= 1.1 else f"{first.gap:.2f}"
    return f"{name}, {first.region}: {size} times the noise"


def rms(x: np.ndarray) -> float:
    """Root mean square of x (n,), in its unit."""
    return float(np.sqrt(np.mean(x**2)))


def regions_of(c: Channel, half_side_m: float) -> list[Where]:
    """At most two regions in which the channel departs from its noise, each with its gap;
    `half_side_m`: half the plate's side."""
    known = np.isfinite(c.gap)
    overall, loud = rms(c.gap[known]), is_loud(c)
    excess = 0.5 * float(np.sum(c.series.z**2 - c.series.w))
    patterns = strongest(c.series, c.coordinates, c.name[-1])
    explained = patterns[0].gain if patterns else 0.0
    hz, beat, sure = rhythm(c.series)
    if sure > MIN_REGION_GAIN and beat > explained and (not loud or beat > RHYTHM_SHARE * excess):
        return [Where(c.name, f"everywhere, with a rhythm of {hz:.2g} Hz", overall)]
    if not patterns or (loud and explained < MIN_EXPLAINED_SHARE * excess):
        return [Where(c.name, *loudest(c, half_side_m))] if loud else []
    words = [
        region(p, ball=c.ball, kept=known, half_side_m=half_side_m, starts_s=c.starts_s)
        for p in patterns
    ]
    gaps = [rms(g) if len(g := c.gap[p.inside() & known]) else overall for p in patterns]
    told = dict(zip(words[::-1], gaps[::-1], strict=True))
    return [Where(c.name, text, gap) for text, gap in told.items() if gap >= MIN_REGION_GAP]


def strongest(series: Series, tried: list[Coordinate], axis: str) -> list[Pattern]:
    """The significant disturbances of a channel, best first: the best region and at most a second
    one, found in what the first leaves. `axis`: the channel's own, "x" or "y"."""
    found: list[Pattern] = []
    for _ in range(2):
        pairs = [pair for c in tried if (pair := best(series, c)) is not None]
        if not pairs:
            break
        top, answer = plainest(pairs, axis)
        enough = max(MIN_REGION_GAIN, SECOND_REGION_SHARE * found[0].gain if found else 0.0)
        if top.gain < enough or significance(series, top, answer) < MIN_REGION_GAIN:
            break
        found.append(top)
        series = replace(series, z=series.z - answer)
    return found


def plainest(pairs: list[tuple[Pattern, np.ndarray]], axis: str) -> tuple[Pattern, np.ndarray]:
    """The (region, innovations) pair with the largest gain; a plainer one (constant, or along the
    channel's own `axis`) if it gains nearly as much."""

    def worth(pair: tuple[Pattern, np.ndarray]) -> float:
        c, gain = pair[0].coordinate, pair[0].gain
        own = c.axis in ("", axis) and c.second is None
        return gain * (
            1.0
            if c.kind == "always"
            else CONSTANT_PREFERENCE
            if own
            else CONSTANT_PREFERENCE * OWN_AXIS_PREFERENCE
        )

    return max(pairs, key=worth)


def blocks(c: Channel, x: np.ndarray) -> np.ndarray:
    """Means (b,) of x (n,) over stretches of LOUDNESS_BLOCK_S; NaN samples and empty stretches are
    left out."""
    slot = ((c.series.t_s - c.series.t_s[0]) / LOUDNESS_BLOCK_S).astype(int)
    known = np.isfinite(x)
    count = np.bincount(slot[known])
    total = np.bincount(slot[known], x[known])
    return total[count > 0] / count[count > 0]


def is_loud(c: Channel) -> bool:
    """Whether the channel's mean square gap exceeds LOUD_GAP^2, and exceeds 1 by LOUD_SIGMAS
    standard errors; False with under 3 stretches of LOUDNESS_BLOCK_S."""
    square = blocks(c, c.gap**2)
    if len(square) < 3:
        return False
    spread = float(square.std(ddof=1)) / len(square) ** 0.5
    return bool(square.mean() > LOUD_GAP**2 and square.mean() - 1 > LOUD_SIGMAS * spread)


def loudest(c: Channel, half_side_m: float) -> tuple[str, float]:
    """The region whose gap exceeds the rest most, in words, and its gap in noise floors;
    "everywhere" where no region stands out. `half_side_m`: half the plate's side."""
    known = np.isfinite(c.gap)
    found = [
        one
        for q in c.coordinates
        if q.second is None and q.kind != "always"
        for one in _louder(c.gap, q)
    ]
    if not found:
        return "everywhere", rms(c.gap[known])
    _, pattern, gap = max(found, key=lambda one: one[0])
    words = region(pattern, ball=c.ball, kept=known, half_side_m=half_side_m, starts_s=c.starts_s)
    return words, gap


def _louder(gap: np.ndarray, q: Coordinate) -> Iterator[tuple[float, Pattern, float]]:
    """Regions of a coordinate louder than the rest by LOUDER_RATIO: gain, pattern, gap."""
    k, m = q.bins(), len(q.edges) - 1
    use = np.isfinite(gap) & (k >= 0)
    n = np.append(0, np.cumsum(np.bincount(k[use], minlength=m)))
    s = np.append(0, np.cumsum(np.bincount(k[use], gap[use] ** 2, minlength=m)))
    for i in range(1 if q.anchored else m):
        for j in range(i, m):
            inside = n[j + 1] - n[i]
            outside = n[-1] - inside
            if min(inside, outside) < MIN_SAMPLE_SHARE * n[-1]:
                continue
            within, without = (s[j + 1] - s[i]) / inside, (s[-1] - s[j + 1] + s[i]) / outside
            if within > LOUDER_RATIO**2 * without:
                gain = -inside * np.log(within) - outside * np.log(without)
                yield float(gain), Pattern(q, i, j, 0, np.zeros(0), 0.0), float(within**0.5)


def profiles_of(c: Channel) -> list[Profile]:
    """The gap of a channel over each of PROFILE_QUANTITIES that it has, and over the direction of
    motion."""
    found = [
        _profile(c, c.of(kind))
        for kind in PROFILE_QUANTITIES
        if any(q.kind == kind for q in c.coordinates)
    ]
    speed = c.of("speed")
    assert speed.side is not None
    way = np.where(speed.value > (STILL_M_S if c.ball else STILL_RAD_S), speed.side, 0.0)
    edges = np.array([-1.5, -0.5, 0.5, 1.5])
    direction = Coordinate("direction", speed.axis, way, edges)
    gap, count = _binned(c.gap, direction)
    return [*found, Profile(c.name, "direction", "1", edges, gap, count)]


def _profile(c: Channel, q: Coordinate) -> Profile:
    if q.kind == "time":
        q = replace(q, edges=by_run(q.edges, c.starts_s))
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
    units = {
        "time": "s",
        "reversal": "s",
        "voltage": "V",
        "position": "m" if c.ball else "rad",
        "speed": "m/s" if c.ball else "rad/s",
    }
    return Profile(c.name, PROFILE_QUANTITIES[q.kind], units[q.kind], edges, gap, count, c.starts_s)


def _binned(gap: np.ndarray, q: Coordinate) -> tuple[np.ndarray, np.ndarray]:
    """RMS gap (m,) and number of samples (m,) by bin; NaN where too few fell."""
    k, m = q.bins(), len(q.edges) - 1
    use = np.isfinite(gap) & (k >= 0)
    count = np.bincount(k[use], minlength=m)
    total = np.bincount(k[use], gap[use] ** 2, minlength=m)
    return np.where(count >= MIN_BIN_SAMPLES, np.sqrt(total / np.maximum(count, 1)), np.nan), count


def maps_of(found: list[Channel], half_side_m: float) -> tuple[PlateMap, ...]:
    """The mean innovation over the part of the plate that the ball visited, as one map; 0 for an
    axis that was not seen, no map without a ball. `half_side_m`: half the plate's side."""
    balls = {c.name[-1]: c for c in found if c.ball}
    if not balls:
        return ()
    some = next(iter(balls.values()))
    places = [q for q in some.coordinates if q.kind == "position"]
    x, y = (next(q.value for q in places if q.axis == axis) for axis in "xy")
    reach = min(max(float(np.abs([x, y]).max()), 1e-3), half_side_m)
    edges = np.linspace(-reach, reach, MAP_CELLS + 1)
    i, j = (Coordinate("position", "", np.clip(v, -reach, reach), edges).bins() for v in (x, y))
    known = np.all([np.isfinite(c.gap) for c in balls.values()], axis=0)
    cell = (j * MAP_CELLS + i)[known]
    count = np.bincount(cell, minlength=MAP_CELLS**2)
    mean = np.zeros((MAP_CELLS, MAP_CELLS, 2))
    for a, axis in enumerate("xy"):
        if axis in balls:
            total = np.bincount(cell, balls[axis].gap[known], minlength=MAP_CELLS**2)
            mean[..., a] = (total / np.maximum(count, 1)).reshape(MAP_CELLS, MAP_CELLS)
    return (PlateMap(edges, edges, mean, count.reshape(MAP_CELLS, MAP_CELLS)),)
