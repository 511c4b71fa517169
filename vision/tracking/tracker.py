"""Where is the one ball in this frame, given the frames before?

    search -> track <-> coast -> lost -> track

In `track` a position was measured and accepted in this very frame. A frame without one is `coast`
(a prediction) for at most 100 ms after the ball was last seen, if only roughly, then `lost`, which
has no position.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np

from vision.detection.appearance import Appearance
from vision.detection.detector import REACH, Detection, locate_ball
from vision.detection.pixels import mean_probability
from vision.detection.streaks_and_mirrors import locate_streak, mirror_silhouette
from vision.frames import Frame, Track
from vision.tracking.acquisition import Acquisition, Known
from vision.tracking.candidates import (
    DISTRACTOR_LIMIT,
    DiscCandidate,
    associate,
    choose_candidate,
    find_discs,
    rough_centres,
)
from vision.tracking.gate import TELLING_FILL, is_apart, is_inside, is_plausible
from vision.tracking.kinematics import ImageMotion, gate_radii
from vision.tracking.sightings import Sighting, bounds_of, surest_disc
from vision.tracking.static_distractors import StaticDistractors
from vision.tracking.things import LARGER

COAST_S = 0.100
GOOD_SHARE = 0.2  # of the radius: a position with a larger sigma only corrects the prediction
# How far the radius may be from its usual value: the ball's distance changes it by a few per cent,
# a wide lens and motion blur by more.
RADIUS_SLACK = 0.25
SAME_SIZE_SHARE = 0.06  # share of the radius that a ball's outline keeps from one frame to the next
ROUGH_SHARE = 0.03  # residual of an outline, share of the radius, that a sharp whole ball never has
# Share of the radius below which a sharp outline is the image in a mirroring one.
INNER_SHARE = 0.92
SHRUNK = 0.92  # of the radius: may be a patch of the ball that shrinks as it turns
WATCH_S = 0.3  # between two looks for a ball that moves while what is tracked has not moved yet
GONE_SHARE = 0.1  # of the ball's own fill, below which its colour is gone from a place
ADAPT_SHARE = 0.03  # of every whole view of the ball, into its size
ADAPT_EVERY, APPEARANCE_SHARE = 4, 0.1  # and of every fourth into its appearance


class Tracker:
    """Follows one ball frame by frame.

    `appearance`: the ball's; None: the ball is the round thing that moves or, at rest, stands out,
    and its appearance is learned from it. `radius_px` (min, max) bounds its radius; `mask` (h, w)
    uint8 is nonzero where it can be; `ball_at` (u, v) or (u, v, radius) px: where it is in the
    first frame; `seeks`: what is sought while there is none, any ball, one of the same colour, or
    nothing. The attribute `appearance` is the one tracked by at present (None: not yet known).
    """

    def __init__(
        self,
        *,
        appearance: Appearance | None = None,
        radius_px: tuple[float, float] | None = None,
        mask: np.ndarray | None = None,
        ball_at: tuple[float, ...] | None = None,
        seeks: Literal["any", "same", "nothing"] = "any",
    ) -> None:
        self.appearance = appearance
        self._given_bounds = radius_px
        self._mask = mask
        self._ball_at = ball_at
        self._seeks = seeks
        self._asked = None if appearance is None or appearance.learned else appearance
        self._acquisition = Acquisition(radius_px, mask, colour=self._asked)
        self._motion: ImageMotion | None = None
        self._radius_px = math.nan
        self._distractors: StaticDistractors | None = None
        self._candidates: list[DiscCandidate] = []
        self._lock_px = (math.nan, math.nan)
        self._whole_px = math.nan  # radius when the whole ball was seen last
        self._mirrors = False  # its silhouette was found about an inner outline
        self._proven = False  # has moved since it was locked
        self._told = False  # somebody said where it is
        self._clear = True  # was too evidently round for a finger or a leaf
        self._state = "search"
        self._good_s = self._locked_s = -math.inf
        self._views = 0

    @property
    def radius_px(self) -> float:
        """The ball's usual radius (px), NaN before the first lock."""
        return self._radius_px

    @property
    def proven(self) -> bool:
        """Whether what is tracked has moved since the lock; a still thing has not."""
        return self._proven

    def step(self, frame: Frame) -> Track:
        """The ball's track in this frame, in pixels; frames come in order of time and have one
        size.
        """
        image = frame.image
        if self._distractors is None:
            self._distractors = StaticDistractors((image.shape[0], image.shape[1]))
        told, self._ball_at = self._ball_at, None
        if told is not None:
            track = self.start_at(frame, *told)
            if track is not None:
                return track
        found = self._measure(frame)
        if found is not None and self._motion is not None:
            return self._accept(frame, found)
        if self._motion is not None and frame.t_s - self._good_s <= COAST_S:
            ahead = self._motion.at(frame.t_s, self._radius_px)
            found = self._elsewhere(frame, ahead)
            return self._coast(ahead) if found is None else self._accept(frame, found)
        if self._motion is not None:
            self._motion, self._candidates, self._state = None, [], "lost"
            assert self.appearance is not None
            known = Known(self.appearance, self._radius_px, self._clear, self._is_known_still)
            self._acquisition.lost(known, held_s=self._good_s - self._locked_s)
            found = self._search(frame)
            if found is not None:
                return self._accept(frame, found)
        return Track(self._state)

    def start_at(
        self, frame: Frame, u_px: float, v_px: float, radius_px: float | None = None
    ) -> Track | None:
        """Track the ball from this place on, whatever was tracked before; None, and nothing
        changes, where no disc is there. Without a radius the surest disc about the place is it."""
        image = frame.image
        sighting = surest_disc(image, u_px, v_px, radius_px, bounds_of(image, self._given_bounds))
        if sighting is None:
            return None
        if self._distractors is None:
            self._distractors = StaticDistractors((image.shape[0], image.shape[1]))
        found = self._start(frame, sighting.seen, proven=False)
        self._told = True
        return self._accept(frame, found)

    def from_known(self) -> Tracker:
        """A tracker of the same ball that has not seen it yet and seeks no other."""
        other = Tracker(
            appearance=self.appearance,
            radius_px=self._given_bounds,
            mask=self._mask,
            seeks="nothing",
        )
        other._radius_px, other._distractors = self._radius_px, self._distractors
        return other

    def _start(
        self, frame: Frame, found: Detection, *, proven: bool, clear: bool = True
    ) -> Detection:
        """Lock on a disc that was recognised without the appearance known so far."""
        known, place = self.appearance, (found.u_px, found.v_px, found.radius_px)
        learned = Appearance.learn(frame.image, *place)
        bounds = 0.9 * found.radius_px, 1.1 * found.radius_px
        sharp = locate_ball(frame.image, learned, *place, reach=0.3)
        if found.inside_px == 0.0 and is_plausible(sharp, learned, bounds, strict=True):
            assert sharp is not None
            found = sharp
        if known is not None and known.learned and known.fill >= TELLING_FILL:
            # It may stand in other light for now: what it looked like stays possible.
            learned = replace(learned, table=np.maximum(learned.table, known.table // 2))
        self.appearance = learned
        self._mirrors = found.inside_px > 0.0
        self._radius_px = found.radius_px
        return self._lock(frame, found, proven=proven, clear=clear)

    def _coast(self, ahead: ImageMotion) -> Track:
        self._state = "coast"
        u, v = (float(x) for x in ahead.place)
        return Track("coast", u, v, ahead.sigma_px, self._radius_px)

    def _measure(self, frame: Frame) -> Detection | None:
        if self._motion is None:
            return self._search(frame)
        found = self._follow(frame, self._motion.at(frame.t_s, self._radius_px))
        return found if self._proven and self._clear else self._doubt(frame, found)

    def _accept(self, frame: Frame, found: Detection) -> Track:
        """Update motion, size, appearance and distractors from an accepted detection."""
        motion, appearance, distractors = self._motion, self.appearance, self._distractors
        assert motion is not None
        assert appearance is not None
        assert distractors is not None
        ahead = motion.at(frame.t_s, self._radius_px)
        u, v, sigma = found.u_px, found.v_px, self._sigma_px(found) + 0.02 * found.radius_px
        if math.hypot(*(ahead.place - (u, v))) > gate_radii(ahead, self._radius_px)[0]:
            # A kick or a wrong time stamp: the speed estimated so far no longer holds.
            self._motion = ImageMotion.at_rest(u, v, self._radius_px, sigma, frame.t_s)
        else:
            self._motion = ahead.corrected(u, v, sigma)
        claimed, self._good_s = self._sigma_px(found), frame.t_s
        if claimed > GOOD_SHARE * self._radius_px:
            return self._coast(self._motion)
        self._state = "track"
        if found.inliers > 0.85 and found.coverage == 1.0:
            self._radius_px += ADAPT_SHARE * (found.radius_px - self._radius_px)
            self._views += 1
            if self._views % ADAPT_EVERY == 0:
                place = u, v, found.radius_px
                self.appearance = appearance.adapted(frame.image, *place, APPEARANCE_SHARE)
        if appearance.fill >= TELLING_FILL:
            distractors.update(
                frame.image, appearance, u, v, self._radius_px, frame.t_s - motion.t_s
            )
        if (whole := self._whole(frame, found)) is not None:
            found = self._start(frame, whole, proven=self._proven, clear=self._clear)
            return self._accept(frame, found)
        span = math.hypot(found.u_px - self._lock_px[0], found.v_px - self._lock_px[1])
        self._proven |= span > max(5.0, 0.5 * self._radius_px)
        return Track("track", found.u_px, found.v_px, claimed, found.radius_px)

    def _whole(self, frame: Frame, patch: Detection) -> Detection | None:
        """The ball, where what is tracked has shrunk to a patch of it, such as a half of another
        colour; of a ball that a zoom makes smaller there is no such disc."""
        if self._radius_px > SHRUNK * self._whole_px:
            return None
        before, self._whole_px = self._whole_px, self._radius_px
        bounds = (self._radius_px / SHRUNK**0.5, before / SHRUNK)
        whole = surest_disc(frame.image, patch.u_px, patch.v_px, before, bounds)
        return None if whole is None else whole.seen

    def _lock(
        self, frame: Frame, found: Detection, *, proven: bool, clear: bool = True
    ) -> Detection:
        """Start to track this detection; `proven`: it is known to move, `clear`: see `Acquired`."""
        appearance = self.appearance
        assert appearance is not None
        if not appearance.learned:
            seen = Appearance.learn(frame.image, found.u_px, found.v_px, found.radius_px)
            # What was asked for stays valid: one view does not show the ball in all light.
            table = np.maximum(seen.table, appearance.table // 2)
            self.appearance = replace(seen, table=table)
        if not math.isfinite(self._radius_px):
            self._radius_px = found.radius_px
        self._motion = ImageMotion.at_rest(
            found.u_px, found.v_px, self._radius_px, found.sigma_px, frame.t_s
        )
        self._lock_px, self._proven, self._candidates = (found.u_px, found.v_px), proven, []
        self._locked_s, self._clear, self._told = frame.t_s, clear, False
        self._whole_px = found.radius_px
        self._acquisition.locked(Sighting(found, appearance, 0.0), frame.t_s)
        return found

    def _bounds(self, image: np.ndarray) -> tuple[float, float]:
        if math.isfinite(self._radius_px):
            slack = 1.0 + RADIUS_SLACK
            return self._radius_px / slack, self._radius_px * slack
        return bounds_of(image, self._given_bounds)

    def _sigma_px(self, found: Detection) -> float:
        """Sigma of the detection (px); larger where its outline is rough and not of the usual size.

        Half of it may then be hidden or blurred, and the centre is off by as much as the radius is.
        """
        rough = found.residual_px > ROUGH_SHARE * self._radius_px
        amiss = abs(found.radius_px - self._radius_px) if rough else 0.0
        return math.hypot(found.sigma_px, amiss)

    def _search(self, frame: Frame) -> Detection | None:
        """The ball anywhere in the image, by appearance or, while that is unknown, by motion."""
        appearance = self.appearance
        if self._seeks == "nothing":
            return None
        if appearance is not None and appearance.fill >= TELLING_FILL:
            self._observe(frame)
            pick = choose_candidate(self._candidates, at_once=appearance.learned)
            if pick is not None and (appearance.learned or not self._is_patch(frame, pick.seen)):
                return self._lock(frame, pick.seen, proven=pick.moved)
        if self._seeks == "same":
            return None
        acquired = self._acquisition.step(frame)
        if acquired is None:
            return None
        return self._start(frame, acquired.seen, proven=acquired.moves, clear=acquired.clear)

    def _is_patch(self, frame: Frame, seen: Detection) -> bool:
        """Whether a disc of the colour that was named is a patch on a larger round thing."""
        bounds = bounds_of(frame.image, self._given_bounds)
        whole = surest_disc(frame.image, seen.u_px, seen.v_px, None, bounds)
        return whole is not None and whole.seen.radius_px > LARGER * seen.radius_px

    def _is_known_still(self, seen: Detection) -> bool:
        """Whether a still thing of the ball's colour lies there, which is not the ball."""
        assert self._distractors is not None
        return self._distractors.at(seen.u_px, seen.v_px, seen.radius_px) > DISTRACTOR_LIMIT

    def _observe(self, frame: Frame) -> None:
        appearance = self.appearance
        assert appearance is not None
        bounds = self._bounds(frame.image)
        found = find_discs(frame.image, appearance, bounds, self._mask, self._distractors)
        self._candidates = associate(self._candidates, found)

    def _doubt(self, frame: Frame, found: Detection | None) -> Detection | None:
        """`found`, or another ball that moves or is clearer, or None: what stays is no ball."""
        motion = self._motion
        assert motion is not None
        if self._seeks == "any":
            other = self._acquisition.step(frame, every_s=WATCH_S)
            better = other is not None and (other.moves or (other.clear and not self._clear))
            if other is not None and better and is_apart(other.seen, motion, self._radius_px):
                return self._start(frame, other.seen, proven=other.moves, clear=other.clear)
            at_rest = not (self._proven or self._told)
            if found is not None and at_rest and self._acquisition.doubts(frame, found):
                return self._leave(found)
        return found

    def _leave(self, found: Detection) -> None:
        """Give up a lock: what was tracked is not the ball, and nothing is known of that."""
        assert self._distractors is not None
        self._distractors.add(found.u_px, found.v_px, found.radius_px)
        self.appearance, self._radius_px, self._motion = self._asked, math.nan, None
        self._candidates, self._state = [], "lost"

    def _elsewhere(self, frame: Frame, ahead: ImageMotion) -> Detection | None:
        """The ball beyond all gates, as after a hand or missing frames: where its own colour is
        gone from its place and the only disc of that colour was seen twice."""
        image, appearance = frame.image, self.appearance
        assert appearance is not None
        if self._seeks == "nothing" or appearance.fill < TELLING_FILL:
            return None
        u, v = (float(x) for x in ahead.place)
        left = mean_probability(image, appearance.table, u, v, 0.0, self._radius_px)
        if left > GONE_SHARE * appearance.fill:
            return None
        if self._state == "track":  # the ball itself was one of them
            self._candidates = []
        self._observe(frame)
        pick = choose_candidate(self._candidates, at_once=False)
        return None if pick is None else self._lock(frame, pick.seen, proven=pick.moved)

    def _follow(self, frame: Frame, ahead: ImageMotion) -> Detection | None:
        """The ball near its prediction, by its outline; else from its colour or circle there."""
        image, appearance, distractors = frame.image, self.appearance, self._distractors
        motion, radius, bounds = self._motion, self._radius_px, self._bounds(frame.image)
        assert appearance is not None
        assert distractors is not None
        assert motion is not None
        near, far = gate_radii(ahead, radius)
        last = (float(motion.place[0]), float(motion.place[1]))
        was_on = distractors.at(*last, radius)
        # It may have moved on as predicted, or stopped, or the time stamps are wrong.
        origins = [(float(ahead.place[0]), float(ahead.place[1])), last]

        def seen(u: float, v: float, reach: float = REACH) -> Detection | None:
            found = locate_ball(image, appearance, u, v, radius, reach=reach)
            if not self._mirrors or found is None or found.radius_px > INNER_SHARE * radius:
                return found
            return mirror_silhouette(image, appearance, found)

        def good(found: Detection | None) -> bool:
            if found is None or (self._mirrors and found.radius_px < INNER_SHARE * radius):
                return False
            jump = min(math.hypot(found.u_px - u, found.v_px - v) for u, v in origins)
            same = jump < near and abs(found.radius_px - radius) < SAME_SIZE_SHARE * radius
            strict = jump > near
            if jump > far or not is_plausible(
                found, appearance, bounds, strict=strict, familiar=same
            ):
                return False
            # The ball may roll over a known mark, but a jump onto one is a wrong detection.
            on = distractors.at(found.u_px, found.v_px, radius)
            return is_inside(found, self._mask) and (on <= DISTRACTOR_LIMIT or was_on > 0.1)

        # Where the ball is as predicted, short rays suffice; farther off they see a part of it.
        short = min(0.25 + 3.0 * ahead.sigma_px / radius, REACH)
        found = seen(*origins[0], reach=short)
        if found is not None and found.coverage == 1.0 and found.inliers > 0.85 and good(found):
            return found
        found = seen(*origins[0])
        if good(found):
            return found
        for origin in origins:
            for u, v in rough_centres(image, appearance, origin, radius, far):
                found = seen(u, v)
                if good(found):
                    return found
        for u, v in origins:
            found = locate_streak(image, appearance, u, v, radius)
            if good(found):
                return found
        return None
