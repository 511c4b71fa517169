"""Which thing is the ball, if nobody has said? Watched live, a few looks a second.

Round things are sought in the whole image a dozen times a second, at any frame rate, and followed
(`things`): the ball is the one that travels or, at rest, stands out. Between these looks they are
glanced at in their places, which tells them from grain, not from each other. The windows are
times, so that a film at 250 frames a second is judged as one at 30.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from vision.detection.appearance import Appearance
from vision.detection.detector import REACH, Detection
from vision.detection.pixels import mean_probability, relief
from vision.frames import Frame
from vision.tracking.camera_motion import CameraMotion
from vision.tracking.gate import TELLING_FILL, is_inside
from vision.tracking.kinematics import START_SPEED_RADII_S
from vision.tracking.sightings import RELIEF, Sighting, bounds_of, round_things, same_place, sight
from vision.tracking.stir import SPAN_S, Stir
from vision.tracking.things import TRAVEL, UNLIKE_COLOUR, UNLIKE_SIZE, Thing, Things

LOOK_S = 0.08  # between two looks at the image, so that finding costs little beside tracking
# Between two glances at known things in their places: a ball just met is within its rays then.
GLANCE_S = REACH / START_SPEED_RADII_S
WINDOW_S = 2.0
LOOKED_AT_EACH = 1e5  # pixels of the largest image that every look searches; larger ones less often
AT_MOST = 6  # circles of an octave that are looked at more closely
AGAIN = 6  # known things that are looked for in their place
KNOWN_S = 0.05  # how long the ball that was lost has to be seen
BRIEF_S = 0.4  # a ball that was held for less may have been a mistake
# Where another ball was known before: a thing at rest that is unlike it, and a mover of another
# size (other light changes a ball's colours but not its size); where one was tracked before, a
# mover that is not clear, as a finger or an outline that leaps from mark to mark.
UNLIKE_S = 1.8
# How much better than the next the ball has to be: two equal things cannot be told apart.
STANDS_OUT, STANDS_OUT_AT_REST = 1.2, 1.5
# Sum over the looks of the logarithm of that lead, from which a thing is believed (Wald's
# sequential test): log 9, of ten beliefs one may be wrong, as what does not move stays in doubt.
SURE = math.log(9.0)
# While other things move: a ball on a plate that tilts by half a degree rolls 8 mm in it.
STIRRED_S = 0.5
LEAST_EVIDENCE = 0.5  # mean over the sightings; grain and specks reach 0.4
# Of a ball that rests. Of the first locks in 212 films of two generated worlds on which nothing was
# tuned, 2 of 5 below this evidence were balls, 6 of 6 from there to 1, and 161 of 167 above; radii
# of 4.1 to 4.5 px were screws, dots and grain, and the smallest ball had 5.1.
AT_REST_EVIDENCE, AT_REST_PX = 0.8, 4.5
# Of a ball beyond doubt: of generated films 95 % of the balls have it, of hands and leaves 10 %.
CLEAR_EVIDENCE = 1.0
NAMED = 1.5  # weight of the colour that was asked for: a prior, never a condition
LIKE = 3.0  # weight of looking like the ball that was lost


@dataclass(frozen=True, eq=False)
class Acquired:
    """The ball as it was recognised in a frame; `moves` says whether it was seen to move, `clear`
    whether it is too evidently round for a finger or a leaf."""

    seen: Detection
    appearance: Appearance
    moves: bool
    clear: bool


@dataclass(frozen=True, eq=False)
class Known:
    """What is known of a ball that was lost: its appearance, its radius (px), whether it was
    `clear` (see `Acquired`), and whether a disc is a still thing of its colour."""

    appearance: Appearance
    radius_px: float
    clear: bool
    is_still: Callable[[Detection], bool]

    def of_size(self, radius_px: float) -> bool:
        """Whether a radius (px) is the ball's, at another place of its plate."""
        return abs(math.log(radius_px / self.radius_px)) < 2.0 * UNLIKE_SIZE

    def like(self, image: np.ndarray, s: Sighting) -> bool:
        """Whether a sighting in an image (h, w, 3) has its size and colours."""
        size = abs(math.log(s.seen.radius_px / self.radius_px))
        ball, table = self.appearance, self.appearance.table
        colour = np.linalg.norm(s.appearance.ball_bgr - ball.ball_bgr)
        fill = mean_probability(image, table, *s.place, 0.0, 0.85 * s.seen.radius_px)
        own = ball.fill >= TELLING_FILL and fill > 0.65 * ball.fill
        return bool(size < UNLIKE_SIZE and (colour < UNLIKE_COLOUR or own))


class Acquisition:
    """Watches frames until one ball is found; then gives its appearance and place.

    `radius_px` (min, max) bounds its radius, `mask` (h, w) uint8 is nonzero where it can be,
    `colour` is an assumed appearance, which counts in its favour. `things`: what was seen so far.
    """

    def __init__(
        self,
        radius_px: tuple[float, float] | None = None,
        mask: np.ndarray | None = None,
        *,
        colour: Appearance | None = None,
    ) -> None:
        self._bounds = radius_px
        self._colour = colour
        self._mask = mask
        self._known: Known | None = None
        self._held = False  # whether a ball was tracked and lost before
        self.things = Things(window_s=WINDOW_S)
        self._stir = Stir()
        self._camera = CameraMotion()
        self._stirred_s = self._calm_s = -math.inf
        self._looked_s = self._glanced_s = -math.inf
        self._looks = 0

    def locked(self, ball: Sighting, t_s: float) -> None:
        """The ball was found here, by whatever means; what is elsewhere is not the ball."""
        self.things.ball_is(ball)
        self._calm_s = t_s

    def doubts(self, frame: Frame, ball: Detection) -> bool:
        """Whether the `ball`, which has stayed where it was locked, is no ball: other things have
        stirred for so long that a ball on their plate would have rolled. A hand or its shadow stirs
        as well: what light shades as a solid is no mark, unless a round thing drifts."""
        if self._stirred_s != frame.t_s:
            return False
        place = ball.u_px, ball.v_px
        if not self._stir.elsewhere(place, ball.radius_px):
            self._calm_s = frame.t_s
        if frame.t_s - self._calm_s < STIRRED_S:
            return False
        solid, reach = relief(frame.image, *place, ball.radius_px) > RELIEF, _reach(frame.image)
        if solid and not any(thing.drifts(reach) for thing in self.things.all):
            return False
        look = Appearance.sketch(frame.image, *place, ball.radius_px)
        self.things.ball_is_not(frame.t_s, Sighting(ball, look, 0.0))
        return True

    def lost(self, known: Known, *, held_s: float) -> None:
        """A ball that is known was lost: it is believed sooner than another. One that was held for
        a shorter time than a lock takes may have been a mistake, and says nothing."""
        self._held = True
        if held_s < BRIEF_S:
            self.things.ball_was_not()
        else:
            self._known = known

    def step(self, frame: Frame, *, every_s: float = LOOK_S) -> Acquired | None:
        """The ball in this frame, once it has been recognised, else None; frames come in order of
        time. The image is looked at `every_s`, in search known things in between."""
        searching = every_s == LOOK_S  # what is locked is doubted by `doubts`
        if not 0.0 <= frame.t_s - self._stirred_s < LOOK_S:
            self._stirred_s = frame.t_s
            self._stir.add(frame.t_s, frame.image)
            self._camera.add(frame.image)
        if not 0.0 <= frame.t_s - self._looked_s < every_s:
            self._looked_s = self._glanced_s = frame.t_s
            self._look(frame)
            if searching:
                self._blame(frame.t_s, _reach(frame.image))
        elif searching and not 0.0 <= frame.t_s - self._glanced_s < GLANCE_S:
            self._glanced_s = frame.t_s
            self.things.glance(frame.t_s, self._again(frame.image, []))
        else:
            return None
        thing = self._choose(frame)
        if thing is None:
            return None
        moves = thing.travel(_reach(frame.image)) > 1.0
        return Acquired(thing.last.seen, thing.last.appearance, moves, _is_clear(thing, moves))

    def _look(self, frame: Frame) -> None:
        """Search the whole image for round things."""
        self._looks += 1
        bounds, due = bounds_of(frame.image, self._bounds), _cadence(self._looks - 1)
        seen = round_things(frame.image, bounds, at_most=AT_MOST, due=due)
        self.things.add(frame.t_s, self._again(frame.image, seen), self._arrived)

    def _blame(self, t_s: float, reach: float) -> None:
        """Things that stayed while others stirred for `STIRRED_S` are not the ball."""
        for thing in self.things.all:
            alone = self._stir.elsewhere(thing.last.place, thing.radius_px)
            stays = alone and not thing.drifts(reach)
            thing.calm_s = min(thing.calm_s, t_s) if stays else t_s
            thing.other |= t_s - thing.calm_s > STIRRED_S

    def _again(self, image: np.ndarray, seen: list[Sighting]) -> list[Sighting]:
        """`seen`, and the known things that are in their place still, where the ball can be."""
        found, bounds = list(seen), bounds_of(image, self._bounds)
        for thing in self.things.ranked(_reach(image))[:AGAIN]:
            last = thing.last
            if not any(same_place(last, s) for s in found):
                s = sight(image, *last.place, last.seen.radius_px, bounds)
                # It may have been another thing's outline that the rays met.
                if s is not None and not any(same_place(s, f) for f in found):
                    found.append(s)
        known = self._known
        return [
            replace(s, settled=self._camera.home(s.place))
            for s in found
            if is_inside(s.seen, self._mask) and (known is None or not known.is_still(s.seen))
        ]

    def _choose(self, frame: Frame) -> Thing | None:
        reach = _reach(frame.image)
        ranked = self._ranked(frame, reach)
        if not ranked or ranked[0][1].last_s != frame.t_s:
            return None
        (score, best), others = ranked[0], ranked[1:]
        n, lasted_s, moves = len(best.times), best.last_s - best.times[0], best.travel(reach) > 1.0
        if n < 0.6 * best.looks or (not moves and (best.other or best.leapt)):
            return None
        ahead = score / max((s for s, _ in others[:1]), default=1e-9)
        if self._is_like_known(best, frame.image):
            return best if n >= 2 and lasted_s >= KNOWN_S and ahead > STANDS_OUT else None
        believed = _is_sure(best, ahead, reach, moves)
        if not moves:
            believed = believed and self._may_rest(best, [thing for _, thing in others], reach)
        return best if believed and lasted_s >= self._wait_s(best, moves) else None

    def _ranked(self, frame: Frame, reach: float) -> list[tuple[float, Thing]]:
        """The things that may be the ball with their scores, best first."""
        image, things = frame.image, self.things
        scored = sorted(((self._score(x, image), x) for x in things.all), key=lambda pair: -pair[0])
        return [
            (score, thing)
            for score, thing in scored[:AGAIN]
            if thing.evidence >= LEAST_EVIDENCE
            and things.may_be_ball(thing, reach)
            and not self._joined(thing, reach, frame.t_s)
            and (self._is_like_known(thing, image) or not things.has_twin(thing, reach))
        ]

    def _may_rest(self, best: Thing, others: list[Thing], reach: float) -> bool:
        """Whether a thing at rest may be the ball: nothing else begins to travel, and it raises one
        of four doubts at most, each of which says little alone: flat light, a shadow at its rim,
        the image's border, a hand that passes."""
        if any(thing.drifts(reach) and thing.evidence > 0.5 * best.evidence for thing in others):
            return False  # that one will be seen to travel, or not
        looked_s = SPAN_S if best.flattened or best.is_cut else LOOK_S
        stirs = best.last_s - best.times[0] < looked_s
        stirs = stirs or self._stir.elsewhere(best.last.place, best.radius_px)
        return best.last.flat + best.flattened + best.is_cut + stirs <= 1

    def _wait_s(self, best: Thing, moves: bool) -> float:
        """How long the best thing has to be seen [s]: longer where it is faint, and where it is
        unlike the ball that was lost."""
        known, unlike = self._known, False
        if self._held if moves else known is not None:
            # What was lost and was not clear may have been a finger, as what moves now may be.
            fitting = known is None or not known.clear or (moves and known.of_size(best.radius_px))
            unlike = not (_is_clear(best, moves) and fitting)
        small = self._bounds is None and best.radius_px < AT_REST_PX
        faint = best.is_cut if moves else small or best.evidence < AT_REST_EVIDENCE
        return UNLIKE_S if faint or unlike else 0.0

    def _is_like_known(self, thing: Thing, image: np.ndarray) -> bool:
        """Whether a thing has size and colours of the ball that was lost."""
        return self._known is not None and self._known.like(image, thing.last)

    def _arrived(self, thing: Thing, s: Sighting) -> bool:
        """Whether a thing can have come to where a sighting is: the discs overlap, or the
        image changed."""
        look, radius = s.appearance, s.seen.radius_px
        if thing.last.far(s) < radius + thing.last.seen.radius_px:
            return True
        contrast = float(np.abs(look.ball_bgr - look.surround_bgr).max())
        return not self._stir.is_calm(s.place, radius, contrast, thing.last_s)

    def _joined(self, thing: Thing, reach: float, t_s: float) -> bool:
        """Whether a thing that travels is part of something larger that moves; that this is the
        camera is believed after a while only."""
        if thing.travel(reach) <= 1.0:
            return False
        still = t_s - thing.times[0] < UNLIKE_S
        before = sum(t_s - seen_s > SPAN_S for seen_s in thing.times)
        recent = (*thing.sightings[max(before - 1, 0) :], thing.last)
        return self._stir.joined([s.place for s in recent], thing.radius_px, still=still)

    def _score(self, thing: Thing, image: np.ndarray) -> float:
        score = thing.score(_reach(image))
        if not thing.missed and self._is_like_known(thing, image):
            score *= LIKE
        if self._colour is not None and fits(self._colour, thing.last):
            score *= NAMED
        return score


def _is_sure(best: Thing, ahead: float, reach: float, moves: bool) -> bool:
    """Whether a thing outdoes grain, and `ahead` times the next best thing, for long enough.

    Grain differs at every glance; whether one thing outdoes another, looks alone tell.
    """
    n = len(best.times)
    met = n + best.glances
    over_grain = best.moved_proof(reach) / (LEAST_EVIDENCE * math.sqrt(n))
    if min(ahead, over_grain) <= (STANDS_OUT if moves else STANDS_OUT_AT_REST):
        return False
    return met >= 2 and min(met * math.log(over_grain), n * math.log(ahead)) > SURE


def _is_clear(thing: Thing, moves: bool) -> bool:
    """Whether a thing is too evidently round for a finger, a leaf or a scrap; what moves at the
    image's border is not, since an arm reaches in over it."""
    return thing.evidence > CLEAR_EVIDENCE and not (moves and thing.is_cut)


def _reach(image: np.ndarray) -> float:
    """Way (px) from which a thing in an image (h, w, 3) has travelled."""
    return TRAVEL * max(image.shape[:2])


def _cadence(look: int) -> Callable[[int], bool]:
    """Which images a look searches, by their number of pixels: the larger, the less often."""
    return lambda pixels: look % max(1, round(pixels / LOOKED_AT_EACH)) == 0


def fits(colour: Appearance, s: Sighting) -> bool:
    """Whether the thing's mean colour, brightened where it is dark, is one of the table's."""
    pixel = np.clip(s.appearance.ball_bgr, 0, 255)
    top = max(float(pixel.max()), 1.0)
    for gain in (1.0, max(1.0, 160.0 / top)):
        patch = np.clip(gain * pixel, 0, 255).astype(np.uint8).reshape(1, 1, 3)
        if mean_probability(patch, colour.table, 0.0, 0.0, 0.0, 1.0) > 0.35:
            return True
    return False
