"""Where is the ball in each frame of a film that can be read again?

A film is looked at as a whole first: some frames, spread evenly, are searched for round things, and
the one thing that is most like a ball in all of them is chosen (`things`), so that neither the
first convincing mover nor a colour's name decides. Tracking then runs forwards from a place where
it was seen, is put right wherever it has lost it while that look saw it, and what is still missing
is tracked backwards from where it was found again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from vision.detection.appearance import Appearance
from vision.frames import Frame, Track
from vision.tracking.acquisition import LEAST_EVIDENCE, NAMED, STANDS_OUT, STIRRED_S, fits
from vision.tracking.camera_motion import CameraMotion
from vision.tracking.gate import is_inside
from vision.tracking.sightings import Sighting, bounds_of, round_things
from vision.tracking.stir import Stir
from vision.tracking.things import TRAVEL, UNLIKE_COLOUR, UNLIKE_SIZE, Thing, Things
from vision.tracking.tracker import SAME_SIZE_SHARE, Tracker

Frames = Callable[[], Iterable[Frame]]

LOOK_S = 0.1  # between two looks of the first pass, doubled where that gives more than `LOOKS`
LOOKS = 120
AT_MOST = 6  # circles of an octave that a look examines
RANKED = 8  # things that are compared in the end
GOOD = 0.5  # of its usual evidence, from which a sighting counts against the tracker's own place
KEPT_BYTES = 3e8  # of images kept to be tracked backwards


@dataclass(frozen=True, eq=False)
class Survey:
    """The ball's sightings by frame index, and whether it moves; empty where none was found."""

    sightings: dict[int, Sighting]
    moves: bool


def survey(
    frames: Frames,
    *,
    radius_px: tuple[float, float] | None = None,
    mask: np.ndarray | None = None,
    colour: Appearance | None = None,
) -> Survey:
    """Look at a film and choose its ball; the arguments are those of `Tracker`."""
    looks = _looks(frames, radius_px, mask)
    return _ball_in(looks, colour)


@dataclass
class _Looks:
    """What was seen of a film: (index of the frame, sightings) every `every_s`; `longer`: the
    image's longer side (px); `alone`: of the sightings (by `id`) those at which nothing stirred
    while something did elsewhere."""

    seen: list[tuple[int, list[Sighting]]]
    every_s: float
    longer: int
    alone: set[int]


def _looks(
    frames: Frames, radius_px: tuple[float, float] | None, mask: np.ndarray | None
) -> _Looks:
    looks, stir, last_s = _Looks([], LOOK_S, 0, set()), Stir(), -np.inf
    camera = CameraMotion()
    for frame in frames():
        if 0.0 <= frame.t_s - last_s < looks.every_s:
            continue
        image, last_s = frame.image, frame.t_s
        looks.longer = max(looks.longer, *image.shape[:2])
        seen = round_things(image, bounds_of(image, radius_px), at_most=AT_MOST)
        camera.add(image)
        seen = [replace(s, settled=camera.home(s.place)) for s in seen if is_inside(s.seen, mask)]
        looks.seen.append((frame.index, seen))
        stir.add(frame.t_s * LOOK_S / looks.every_s, image)  # as many looks back in a long film
        looks.alone |= {id(s) for s in seen if stir.elsewhere(s.place, s.seen.radius_px)}
        if len(looks.seen) > LOOKS:
            looks.seen, looks.every_s = looks.seen[::2], 2.0 * looks.every_s
    return looks


def _ball_in(looks: _Looks, colour: Appearance | None) -> Survey:
    """The ball among what was seen, with the places where it is sure."""
    things = Things()
    for number, (_, seen) in enumerate(looks.seen):
        things.add(number * looks.every_s, seen)
    reach = TRAVEL * looks.longer
    for thing in things.all:
        alone = looks.every_s * sum(id(s) in looks.alone for s in thing.sightings)
        thing.other = thing.travel(reach) <= 1.0 and alone > STIRRED_S
    ranked = sorted(things.all, key=lambda t: -_score(t, reach, colour))
    ranked = [thing for thing in ranked[:RANKED] if things.may_be_ball(thing, reach)]
    best = ranked[0] if ranked else None
    if best is None or not _sure(best, len(looks.seen)):
        return Survey({}, moves=False)
    moves = best.travel(reach) > 1.0
    if best.other:  # something that no circle showed may have been the ball
        return Survey({}, moves=False)
    if not moves and len(ranked) > 1:
        lead = _score(best, reach, colour) / _score(ranked[1], reach, colour)
        if lead < STANDS_OUT:
            return Survey({}, moves=False)
    places = {looks.seen[round(t_s / looks.every_s)][0]: s for t_s, s in _usual(best)}
    return Survey(places, moves)


def _score(thing: Thing, reach_px: float, colour: Appearance | None) -> float:
    named = colour is not None and fits(colour, thing.last)
    return thing.score(reach_px) * (NAMED if named else 1.0)


def _usual(best: Thing) -> list[tuple[float, Sighting]]:
    """Its sightings (time, sighting) that have its usual size, and its usual colour unless the size
    is the very same: a fingertip that was met while a hand held the ball has neither, a ball under
    another lamp or in another palette of a GIF has its size. A ball of two colours has a wide usual
    colour."""
    colours = np.array([s.appearance.ball_bgr for s in best.sightings])
    off = np.linalg.norm(colours - np.median(colours, 0), axis=1)
    sizes = np.abs(np.log([s.seen.radius_px / best.radius_px for s in best.sightings]))
    coloured = off < max(UNLIKE_COLOUR, 3.0 * float(np.median(off)))
    fits_in = (sizes < 2.0 * UNLIKE_SIZE) & (coloured | (sizes < SAME_SIZE_SHARE))
    pairs = zip(best.times, best.sightings, strict=True)
    return [pair for pair, usual in zip(pairs, fits_in, strict=True) if usual]


def _sure(best: Thing, looks: int) -> bool:
    """Whether it was seen often and well enough to be more than grain."""
    return best.evidence > LEAST_EVIDENCE and len(best.times) >= min(3, looks)


class WholeFilm:
    """The tracks of a film, by frame: `step` gives them in any order, as a `Tracker` does in time.

    `frames` opens the film anew at each call; the others as for `Tracker`. `ball_at` (u, v) or
    (u, v, radius) px: where the ball is in the first frame.
    """

    def __init__(
        self,
        frames: Frames,
        *,
        appearance: Appearance | None = None,
        radius_px: tuple[float, float] | None = None,
        mask: np.ndarray | None = None,
        ball_at: tuple[float, ...] | None = None,
    ) -> None:
        self._frames = frames
        self.tracks: dict[int, Track] = {}
        found = Survey({}, moves=False)
        if ball_at is None:
            found = survey(frames, radius_px=radius_px, mask=mask, colour=appearance)
        self._tracker = Tracker(
            appearance=None if found.sightings else appearance,
            radius_px=radius_px,
            mask=mask,
            ball_at=ball_at,
            seeks="same" if found.sightings else "any",
        )
        self._moves = found.moves
        self._forwards(found.sightings)
        self._backwards()

    @property
    def appearance(self) -> Appearance | None:
        """The ball's appearance, see `Tracker`."""
        return self._tracker.appearance

    @property
    def radius_px(self) -> float:
        """The ball's usual radius (px), NaN where it was not found."""
        return self._tracker.radius_px

    @property
    def proven(self) -> bool:
        """Whether the ball moved."""
        return self._moves or self._tracker.proven

    def step(self, frame: Frame) -> Track:
        """The track of a frame of the film."""
        return self.tracks.get(frame.index, Track("search"))

    def _forwards(self, sightings: dict[int, Sighting]) -> None:
        usual = float(np.median([s.evidence for s in sightings.values()])) if sightings else 0.0
        tracker = self._tracker
        for frame in self._frames():
            s = sightings.get(frame.index)
            track = tracker.step(frame)
            if s is not None and s.evidence > GOOD * usual and not _at(track, s):
                track = tracker.start_at(frame, *s.place, s.seen.radius_px) or track
            self.tracks[frame.index] = track

    def _backwards(self) -> None:
        """Track the frames before every lock backwards, as many of them as may be kept."""
        gaps = _gaps(self.tracks)
        if not gaps:
            return
        kept: list[Frame] = []
        for frame in self._frames():
            if frame.index not in gaps:
                continue
            kept.append(frame)
            while len(kept) > max(2, KEPT_BYTES / max(frame.image.nbytes, 1)):
                kept.pop(0)
            if self.tracks[frame.index].state == "track":
                self._rewind(kept)
                kept = []

    def _rewind(self, kept: list[Frame]) -> None:
        """Track from the last of these frames, in which the ball was found, back to the first."""
        last = self.tracks[kept[-1].index]
        back = self._tracker.from_known()
        end_s = kept[-1].t_s
        for frame in reversed(kept):
            mirrored = replace(frame, t_s=end_s - frame.t_s)
            if frame is kept[-1]:
                track = back.start_at(mirrored, last.u_px, last.v_px, last.radius_px)
            else:
                track = back.step(mirrored)
            if track is None or track.state == "lost":
                break
            if track.state == "track" and self.tracks[frame.index].state != "track":
                self.tracks[frame.index] = track


def _at(track: Track, s: Sighting) -> bool:
    """Whether a track is where the ball was sighted."""
    off = np.hypot(track.u_px - s.seen.u_px, track.v_px - s.seen.v_px)
    return track.state == "track" and bool(off < s.seen.radius_px)


def _gaps(tracks: dict[int, Track]) -> set[int]:
    """Frames without a measured place that end in one with, and those ends."""
    frames: set[int] = set()
    waiting: list[int] = []
    for index in sorted(tracks):
        if tracks[index].state != "track":
            waiting.append(index)
        elif waiting:
            frames |= {*waiting, index}
            waiting = []
    return frames
