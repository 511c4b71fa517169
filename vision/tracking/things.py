"""Which of the round things that were seen is the ball? Things are followed by look and place.

A still thing is seen in its place again and again; the ball is a round thing that moves otherwise
than the plate or, where nothing moves, the one that stands out.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from vision.tracking.sightings import FAINT, FLAT, Sighting, same_place

# Of the image's longer side: a mark at the edge of a plate tilted by 6 degrees shifts by 1 %.
TRAVEL = 0.03
# What counts as one unlike step between two sightings of a thing: share of the radius (perspective
# on a plate changes it by a fifth), grey levels (a ball's shading; a painted half changes by more,
# and is then known by its place).
UNLIKE_SIZE, UNLIKE_COLOUR = 0.2, 40.0
NEAR_RADII, FAR_RADII = 2.0, 6.0
SPEED_RADII_S = 50.0  # twice that of a ball of 10 mm at 0.25 m/s: equal marks far apart are two
# Company of a thing from which it is a patch of a pattern: of 405 sighted balls of two generated
# worlds none has it, of 289 other things one in four.
PATTERN = 0.2
OTHER = 0.1  # weight of a thing that stays where it was while the ball was elsewhere
# Flattening of what is no ball, blurred or not: of the first locks in 212 films of two generated
# worlds 180 balls have .14 and less, 5 of 14 leaves, coins and the like .17 and more. A white ball
# on a white plate, of which only the shadow shows an edge, has up to .18 with that and is lost by
# it. A coin has (1 - sin e) / (1 + sin e) at an elevation e of the camera: .15 at 48 degrees.
FLATTEST = 0.15
LARGER, FIXED = 1.4, 0.3  # ratio of radii; share of the larger radius that a part may sway
# A shadow: shares of the light beside it that are left at most, and that the colours differ by; how
# far (sum of the radii) it lies from what moves with it; sway, share of their common way.
SHADED, TINTED, AWAY, RIGID = 0.9, 0.2, 2.0, 0.4
# Unevenness (`pixels.unevenness`) below which what is a darker copy of its surround is a shadow. A
# matt sphere seen from above under an even sky, light (1 + n_z)/2, has .08, with a lamp more; black
# and steel balls in 12 films of two generated worlds had .07 and more, shadows .02 to .03 (smaller
# than 7 px or half covered by their ball up to .3: these are not told). A grey ball in light from
# all round is as even and as dark: what casts a shadow is seen beside it, in few looks perhaps. A
# black ball in even light is darker than a shadow, which the room's light reaches: of the light
# beside them shadows keep .56 to .81, black balls .13 to .30; a third, where a lamp is twice as
# bright as the room.
EVEN, UMBRA = 0.05, 1.0 / 3.0
# Travel beyond which more says nothing: marks on a plate that tilts by 10 degrees reach 2 to 3, and
# leaves and hands come farther than a ball.
FARTHEST = 3.0


HIDDEN = 3  # looks in a row that miss a thing; from then on it is hidden, not seen unsteadily


@dataclass(eq=False)
class Thing:
    """A round thing and where looks saw it: `times` [s] and `sightings` of equal length; `looks`
    counts the images since its first in which it was not hidden, `missed` those since its last,
    `glances` how often it was met between looks, at last as `glance` (time, sighting); `other` says
    that the ball was known to be elsewhere while it was there, `calm_s` when nothing stirred beside
    it or it moved itself [s]."""

    times: list[float] = field(default_factory=list)
    sightings: list[Sighting] = field(default_factory=list)
    looks: int = 0
    missed: int = 0
    glances: int = 0
    glance: tuple[float, Sighting] | None = None
    other: bool = False
    calm_s: float = math.inf

    @property
    def last(self) -> Sighting:
        """The latest sighting, by a look or a glance."""
        return self.sightings[-1] if self.glance is None else self.glance[1]

    @property
    def last_s(self) -> float:
        """When that was [s]."""
        return self.times[-1] if self.glance is None else self.glance[0]

    @property
    def radius_px(self) -> float:
        """Median radius (px)."""
        return float(np.median([s.seen.radius_px for s in self.sightings]))

    @property
    def leapt(self) -> bool:
        """Whether it was elsewhere a look before: no ball at rest starts so fast, and what was seen
        last may be another thing, which other light shows."""
        before = self.sightings[-1 if self.glance is not None else -2 :][:1]
        return not all(same_place(self.last, s) for s in before)

    @property
    def is_cut(self) -> bool:
        """Whether the image's border cuts its latest sighting."""
        return self.last.seen.framed < 1.0

    @property
    def share(self) -> np.ndarray:
        """What it usually has of the light beside it, (3,) by colour channels."""
        looks = [s.appearance for s in self.sightings]
        return np.median([(x.ball_bgr + 1.0) / (x.surround_bgr + 1.0) for x in looks], 0)

    @property
    def shadowy(self) -> bool:
        """Whether it is what lies beside it, darker: as a shadow, or a black ball, is."""
        share = self.share
        return bool(share.max() < SHADED and np.ptp(share) < TINTED)

    @property
    def is_even(self) -> bool:
        """Whether it is what lies beside it, darker, and even, as a shadow is: a lamp shades a
        ball, and steel mirrors a room; a black ball is darker."""
        even = float(np.median([s.uneven for s in self.sightings])) < EVEN
        return even and self.shadowy and float(self.share.min()) > UMBRA

    @property
    def round(self) -> float:
        """How round it usually is, see `Sighting`."""
        return float(np.median([s.round for s in self.sightings]))

    @property
    def flattened(self) -> bool:
        """Whether it is seldom as round as a ball at rest, but as a disc that lies on a plate."""
        return self.round < FAINT

    @property
    def is_aslant(self) -> bool:
        """Whether it is flatter than any ball, as a coin or a leaf that is seen aslant."""
        return float(np.median([s.seen.flattening for s in self.sightings])) > FLATTEST

    def is_ring(self, reach_px: float) -> bool:
        """Whether it stays and differs from what is about it along its turn alone, as a printed
        ring does (`reach_px` as for `travel`)."""
        faint = float(np.median([s.likely for s in self.sightings])) <= FAINT
        return faint and self.travel(reach_px) <= 1.0

    def is_patch(self, reach_px: float) -> bool:
        """Whether it stays and is one of a pattern's patches, such as a cell of a printed marker
        (`reach_px` as for `travel`)."""
        company = float(np.median([s.company for s in self.sightings]))
        return company > PATTERN and self.travel(reach_px) <= 1.0

    @property
    def evidence(self) -> float:
        """Mean evidence of its sightings."""
        return float(np.mean([s.evidence for s in self.sightings]))

    @property
    def proof(self) -> float:
        """Evidence of all its sightings that it is round: grows with the root of their number, and
        is less the more of the looks missed it while it was there."""
        n = len(self.times)
        steadily = n / max(self.looks - min(self.missed, HIDDEN), n)
        return self.evidence * math.sqrt(n) * steadily

    def drifts(self, reach_px: float) -> bool:
        """Whether it is elsewhere than at first, though perhaps not seen often enough to be sure
        that it travels (`reach_px` as for `travel`)."""
        way = math.dist(self.last.home, self.sightings[0].home)
        return self.missed < 3 and way > max(0.5 * reach_px, 0.5 * self.radius_px)

    def travel(self, reach_px: float) -> float:
        """How far it came from where it was at first, in units of half of `reach_px` or of its
        radius, whichever is longer; the farthest sightings, which may be mistakes, do not count."""
        places = np.array([s.home for s in self.sightings])
        n = len(places)
        off = np.sort(np.hypot(*(places - np.median(places[: (n + 1) // 2], 0)).T))
        sure = off[-2 - n // 10] if n > 3 else 0.0
        return float(sure) / max(0.5 * reach_px, 0.5 * self.radius_px)

    def moved_proof(self, reach_px: float) -> float:
        """Its proof, the more the farther it travelled (`reach_px` as for `travel`)."""
        return self.proof * (1.0 + min(self.travel(reach_px), FARTHEST))

    def score(self, reach_px: float) -> float:
        """How much speaks for it as the ball among other things: one that stays counts by how
        likely it is a ball's (`Sighting.likely`)."""
        likely = self.sightings[-1].likely * (OTHER if self.other else 1.0) * max(self.round, FLAT)
        stays = 1.0 - min(self.travel(reach_px), 1.0)
        return self.moved_proof(reach_px) * likely**stays


class Things:
    """The round things of a film or, with `window_s`, of its last seconds."""

    def __init__(self, *, window_s: float = math.inf) -> None:
        self._window_s = window_s
        self.all: list[Thing] = []

    def add(
        self,
        t_s: float,
        sightings: list[Sighting],
        arrived: Callable[[Thing, Sighting], bool] = lambda thing, s: True,
    ) -> None:
        """Add what was seen in one image: every sighting goes to the thing it is most like.

        `arrived` says whether a thing can have come to where a sighting is since it was last seen.
        """
        taken = self._matched(t_s, sightings, arrived)
        for i, thing in enumerate(self.all):
            thing.looks += thing.missed < HIDDEN
            thing.missed += 1
            if i in taken:
                thing.missed, thing.glance = 0, None
                thing.times.append(t_s)
                thing.sightings.append(sightings[taken[i]])
        free = set(range(len(sightings))) - set(taken.values())
        self.all += [Thing([t_s], [sightings[k]], looks=1) for k in sorted(free)]
        self._forget(t_s)

    def glance(self, t_s: float, sightings: list[Sighting]) -> None:
        """Add what was seen where known things are expected: they are there now, and more than
        grain; what they are beside others, looks at the whole image alone tell."""
        for i, k in self._matched(t_s, sightings).items():
            self.all[i].glance = t_s, sightings[k]
            self.all[i].glances += 1

    def _matched(
        self,
        t_s: float,
        sightings: list[Sighting],
        arrived: Callable[[Thing, Sighting], bool] = lambda thing, s: True,
    ) -> dict[int, int]:
        """Number of the sighting by that of the thing that it is most like; see `add`."""
        pairs = sorted(
            (unlike, i, k)
            for i, thing in enumerate(self.all)
            for k, unlike in enumerate(_unlike(thing, sightings, t_s))
        )
        taken: dict[int, int] = {}
        for unlike, i, k in pairs:
            free = math.isfinite(unlike) and i not in taken and k not in taken.values()
            if free and arrived(self.all[i], sightings[k]):
                taken[i] = k
        return taken

    def _forget(self, t_s: float) -> None:
        for thing in self.all:
            old = sum(t < t_s - self._window_s for t in thing.times)
            old -= thing.other and old == len(thing.times)  # of those one sighting stays
            if old:
                # As if it had been looked for since its first sighting that is kept.
                thing.looks = max(len(thing.times) - old, thing.looks - old)
                thing.glances = 0
                del thing.times[:old], thing.sightings[:old]
        self.all = [thing for thing in self.all if thing.times]

    def ball_is(self, ball: Sighting) -> None:
        """The ball is here: what is elsewhere is another thing; what was seen counts no more."""
        for thing in self.all:
            apart = thing.last.far(ball) > max(thing.radius_px, ball.seen.radius_px)
            thing.other = apart and (thing.other or len(thing.times) > 1)
            thing.times, thing.sightings = [thing.last_s], [thing.last]
            thing.looks, thing.missed, thing.glances, thing.glance = 1, 0, 0, None
        self.all = [thing for thing in self.all if thing.other]

    def ball_is_not(self, t_s: float, still: Sighting) -> None:
        """What was taken for the ball at `t_s` stayed while others stirred, as what else was seen
        may have done: none of it is the ball until it moves."""
        self.all = [x for x in self.all if x.last.far(still) > still.seen.radius_px]
        self.all.append(Thing([t_s], [still], looks=1))
        for thing in self.all:
            thing.other = True

    def ball_was_not(self) -> None:
        """What `ball_is` said last was a mistake."""
        for thing in self.all:
            thing.other = False

    def may_be_ball(self, thing: Thing, reach_px: float) -> bool:
        """Whether it is no flat thing seen aslant, no shadow, no printed ring, no patch of a
        pattern and no part of another thing."""
        is_print = thing.is_ring(reach_px) or thing.is_patch(reach_px)
        is_mark = thing.is_aslant or is_print or self.is_shadow(thing)
        return not (is_mark or self.is_part(thing, reach_px))

    def is_shadow(self, thing: Thing) -> bool:
        """Whether it is even and was seen beside what may cast it, in however few looks."""
        return thing.is_even and any(
            _casts(other, thing) for other in self.all if other is not thing and not other.is_even
        )

    def is_part(self, thing: Thing, reach_px: float) -> bool:
        """Whether it is of another thing: a highlight in its place on a ball, the shadow of a ball
        that moves with it, or a highlight that moves with the shadow of a ball that is not seen.
        `reach_px`: what counts as travelling."""
        return any(_is_of(thing, other, reach_px) for other in self.all if other is not thing)

    def has_twin(self, thing: Thing, reach_px: float) -> bool:
        """Whether another thing that is seen now has its size and colour and, where it travels,
        drifts too: screws and dots of a plate are several, the ball is one. What touches it is no
        twin: a ball's image in a glossy plate is less than a diameter away."""
        travels = thing.travel(reach_px) > 1.0
        return any(
            _look_alike(thing, other) and (other.drifts(reach_px) or not travels)
            for other in self.all
            if other is not thing and not other.missed and len(other.times) + other.glances > 1
        )

    def ranked(self, reach_px: float) -> list[Thing]:
        """The things by their score, best first; `reach_px`: what counts as travelling."""
        return sorted(self.all, key=lambda thing: -thing.score(reach_px))


def _look_alike(thing: Thing, other: Thing) -> bool:
    """Whether two things that do not touch have one size and colour."""
    apart = thing.last.far(other.last) > thing.radius_px + other.radius_px
    size = abs(math.log(thing.radius_px / other.radius_px))
    colours = thing.last.appearance.ball_bgr - other.last.appearance.ball_bgr
    return apart and size < UNLIKE_SIZE and float(np.linalg.norm(colours)) < UNLIKE_COLOUR


def _together(thing: Thing, other: Thing) -> np.ndarray:
    """Places (n, 2, 2) of a thing and of another in the looks that saw both."""
    at = dict(zip(other.times, other.sightings, strict=True))
    seen = zip(thing.times, thing.sightings, strict=True)
    return np.reshape([(s.place, at[t].place) for t, s in seen if t in at], (-1, 2, 2))


def _casts(other: Thing, thing: Thing) -> bool:
    """Whether another thing is beside a thing as a ball is beside its shadow, and stays there."""
    both = _together(thing, other)
    if not len(both):
        return False
    off = both[:, 0] - both[:, 1]
    away, sway, way = (
        float(np.hypot(*x)) for x in (np.median(off, 0), off.std(0), both[:, 0].std(0))
    )
    near = 0.7 * thing.radius_px < away <= AWAY * (thing.radius_px + other.radius_px)
    return near and sway <= max(RIGID * way, FIXED * thing.radius_px)


def _is_of(thing: Thing, other: Thing, reach_px: float) -> bool:
    """Whether a thing is a part or the shadow of another, or has its shadow; see `is_part`."""
    both = _together(thing, other)
    if len(both) < max(2, 0.5 * len(thing.times)):
        return False
    places, off = both[:, 0], both[:, 0] - both[:, 1]
    away, sway = (float(np.hypot(*x)) for x in (np.median(off, 0), off.std(0)))
    larger = other.radius_px > LARGER * thing.radius_px and other.proof > 0.7 * thing.proof
    if larger and away < 0.95 * other.radius_px:
        return sway < FIXED * other.radius_px
    way = float(np.hypot(*places.std(0)))
    if (
        way < 0.4 * reach_px
        or sway > RIGID * way
        or away > AWAY * (thing.radius_px + other.radius_px)
    ):
        return False
    if larger and away > thing.radius_px + other.radius_px:
        return True
    return away > 0.7 * thing.radius_px and thing.shadowy and not other.shadowy


def _unlike(thing: Thing, new: list[Sighting], t_s: float) -> list[float]:
    """How unlike a thing sightings at `t_s` are, infinite where they cannot be of it.

    A thing looks as it did last or as it usually does: a fingertip may have stood for it once.
    """
    last = thing.last
    looks = [
        (last.seen.radius_px, last.appearance.ball_bgr),
        (thing.radius_px, np.median([s.appearance.ball_bgr for s in thing.sightings], 0)),
    ]
    farthest = NEAR_RADII + SPEED_RADII_S * abs(t_s - thing.last_s)
    return [
        math.inf
        if last.far(s) > farthest * max(last.seen.radius_px, s.seen.radius_px)
        else min(_differ(*look, last, s) for look in looks)
        for s in new
    ]


def _differ(radius: float, bgr: np.ndarray, last: Sighting, new: Sighting) -> float:
    size = abs(math.log(new.seen.radius_px / radius)) / UNLIKE_SIZE
    colour = float(np.linalg.norm(new.appearance.ball_bgr - bgr)) / UNLIKE_COLOUR
    far = last.far(new) / radius
    if size > 1.5 or (colour > 1.5 and far > NEAR_RADII):
        return math.inf
    return size + min(colour, 1.5) + min(far / FAR_RADII, 2.0)
