"""Was the camera knocked since its calibration? Markers that stand still tell.

Fixed markers lie beside the plate, on the frame or the desk, and belong to the plate's dictionary
but not to its layout. Where there are none, the plate's own centre serves: the plate turns about
it, so it does not move sideways either.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np

from calibration.records import FixedRecord
from vision.markers import FoundMarkers, MarkerLayout, detect

FIXED_IDS = (46, 47, 48, 49)  # printed on the sheet of fixed markers; any others will do
LIMIT_MM = 1.0  # of the markers' picture at the plate's distance
PLATE_LIMIT_M = 0.002
_STILL_PX, _SEEN_SHARE = 0.5, 0.8
_EVERY_S, _TIMES = 1.0, 3


@dataclass(frozen=True)
class Knock:
    """How far the fixed markers moved in the picture, and what to tell the user."""

    moved_px: float
    moved_mm: float
    sentence: str


def fixed_markers(
    images: Sequence[np.ndarray], layout: MarkerLayout, mm_per_px: float
) -> FixedRecord | None:
    """The still markers beside the plate in frames (h, w[, 3]) uint8 of a table at rest, or None.

    A marker counts that is seen in four of five frames and keeps its place within half a pixel.
    """
    others = [i for i in range(50) if i not in layout.ids]
    search = _layout(others, layout.dictionary)
    seen: dict[int, list[np.ndarray]] = {}
    for image in images:
        found = detect(image, search)
        for number, corners in zip(found.ids, found.corners_px, strict=True):
            seen.setdefault(int(number), []).append(corners)
    ids, corners_px = [], []
    for number, places in sorted(seen.items()):
        spread = np.ptp(np.array(places), axis=0).max()
        if len(places) >= max(2, _SEEN_SHARE * len(images)) and spread < _STILL_PX:
            ids.append(number)
            corners_px.append(np.mean(places, axis=0).tolist())
    if not ids:
        return None
    return FixedRecord(
        dictionary=layout.dictionary, ids=ids, corners_px=corners_px, mm_per_px=mm_per_px
    )


def knocked(found: FoundMarkers, fixed: FixedRecord, *, limit_mm: float = LIMIT_MM) -> Knock | None:
    """A knock, if most of the fixed markers that are seen moved; None else, or with too few seen.

    A marker that moves alone was pushed itself: it says nothing of the camera.
    """
    before = dict(zip(fixed.ids, np.array(fixed.corners_px), strict=True))
    moves = [
        corners.mean(axis=0) - before[int(number)].mean(axis=0)
        for number, corners in zip(found.ids, found.corners_px, strict=True)
        if int(number) in before
    ]
    if len(moves) < min(2, len(fixed.ids)):
        return None
    far = np.linalg.norm(moves, axis=1)
    moved_px = float(np.median(far))
    moved_mm = moved_px * fixed.mm_per_px
    if moved_mm <= limit_mm or 2 * np.sum(far * fixed.mm_per_px > limit_mm) <= len(far) - 1:
        return None
    return Knock(
        moved_px,
        moved_mm,
        f"moved camera: of {len(fixed.ids)} fixed markers {len(far)} lie {moved_px:.1f} px "
        f"({moved_mm:.1f} mm) from where they were at the calibration: run rig calibrate table "
        "again",
    )


def plate_moved(drift_m: float, *, limit_m: float = PLATE_LIMIT_M) -> str | None:
    """What to say of a plate whose centre moved sideways by `drift_m` (`BallCamera.drift_m`)."""
    if not isfinite(drift_m) or drift_m <= limit_m:
        return None
    return (
        f"moved camera or table: the plate's centre lies {1e3 * drift_m:.1f} mm from where it was "
        "at the calibration: run rig calibrate table again"
    )


class KnockWatch:
    """Looks at a run's frames now and then and says once that the camera was knocked.

    A search of the whole picture takes 5 to 15 ms, so it is made once a second; three sightings in
    a row must agree, so that a hand or a shadow raises no alarm.
    """

    def __init__(self, fixed: FixedRecord | None, *, every_s: float = _EVERY_S) -> None:
        self._fixed, self._every_s = fixed, every_s
        self._layout = None if fixed is None else _layout(fixed.ids, fixed.dictionary)
        self._due_s, self._in_a_row, self._said = -np.inf, 0, False

    def look(self, image: np.ndarray, t_s: float, drift_m: float = float("nan")) -> str | None:
        """What to tell the user after this frame (h, w[, 3]) uint8, mostly None; `drift_m` as the
        ball camera measured it."""
        if self._said or t_s < self._due_s:
            return None
        self._due_s = t_s + self._every_s
        said = None
        if self._fixed is not None and self._layout is not None:
            knock = knocked(detect(image, self._layout), self._fixed)
            said = None if knock is None else knock.sentence
        said = said or plate_moved(drift_m)
        self._in_a_row = self._in_a_row + 1 if said else 0
        if self._in_a_row < _TIMES:
            return None
        self._said = True
        return said


def _layout(ids: Sequence[int], dictionary: str) -> MarkerLayout:
    """A layout that only names markers; where they lie is not asked."""
    square = 0.01 * np.array([(-1, 1), (1, 1), (1, -1), (-1, -1)], float)
    return MarkerLayout(np.array(ids), np.repeat(square[None], len(ids), axis=0), dictionary)
