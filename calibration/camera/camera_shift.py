"""Detects that the camera was moved since its calibration, by markers that stand still.

Fixed markers lie beside the plate, on the frame or the desk; they belong to the plate's dictionary
but not to its layout. Where there are none, the plate's centre serves: the plate turns about it, so
it does not move sideways either.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np

from calibration.records import FixedRecord
from vision.plate.markers import FoundMarkers, MarkerLayout, detect

FIXED_IDS = (46, 47, 48, 49)  # printed on the sheet of fixed markers; any others will do
# Chosen: a shift that matters beside an uncertainty of some 0.1 mm, at the plate's distance; the
# plate's centre is less sure, its linkage has play.
LIMIT_MM, PLATE_LIMIT_M = 1.0, 0.002
_STILL_PX, _SEEN_SHARE = 0.5, 0.8
_EVERY_S, _TIMES = 1.0, 3  # chosen: a search costs 5 to 15 ms; a hand passes within 3 s


@dataclass(frozen=True)
class CameraShift:
    """How far the fixed markers moved (median), in the picture [px] and at the plate [mm], and a
    `sentence` that tells the user."""

    moved_px: float
    moved_mm: float
    sentence: str


def fixed_markers(
    images: Sequence[np.ndarray], layout: MarkerLayout, mm_per_px: float
) -> FixedRecord | None:
    """The markers beside the plate that stand still in `images` (h, w[, 3]) uint8 of a table at
    rest; None where there are none.

    A marker counts if it is not in the plate's `layout`, is seen in four of five frames, and stays
    within half a pixel. `mm_per_px`: scale of the picture at the plate.
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


def camera_shift(
    found: FoundMarkers, fixed: FixedRecord, *, limit_mm: float = LIMIT_MM
) -> CameraShift | None:
    """The camera's shift where most of the fixed markers that are seen moved by over `limit_mm`;
    otherwise None.

    A single marker that moved among several that did not was pushed itself. Where under 2 of
    several markers are seen the answer is None.
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
    return CameraShift(
        moved_px,
        moved_mm,
        f"moved camera: of {len(fixed.ids)} fixed markers {len(far)} lie {moved_px:.1f} px "
        f"({moved_mm:.1f} mm) from where they were at the calibration: run rig calibrate table "
        "again",
    )


def plate_moved(drift_m: float, *, limit_m: float = PLATE_LIMIT_M) -> str | None:
    """A warning for the user where the plate's centre moved sideways by `drift_m` [m]
    (`BallCamera.drift_m`) over `limit_m`; None within the limit or where the drift is not known
    (NaN)."""
    if not isfinite(drift_m) or drift_m <= limit_m:
        return None
    return (
        f"moved camera or table: the plate's centre lies {1e3 * drift_m:.1f} mm from where it was "
        "at the calibration: run rig calibrate table again"
    )


class ShiftMonitor:
    """Checks a run's frames every `every_s` seconds and reports a moved camera once, after three
    checks in a row that agree: a hand or a shadow raises no alarm. `fixed` None: only the plate's
    drift is checked."""

    def __init__(self, fixed: FixedRecord | None, *, every_s: float = _EVERY_S) -> None:
        self._fixed, self._every_s = fixed, every_s
        self._layout = None if fixed is None else _layout(fixed.ids, fixed.dictionary)
        self._due_s, self._in_a_row, self._reported = -np.inf, 0, False

    def check(self, image: np.ndarray, t_s: float, drift_m: float = float("nan")) -> str | None:
        """A warning for the user after this frame (h, w[, 3]) uint8 of time `t_s`, at most once;
        otherwise None. `drift_m`: as in `plate_moved`."""
        if self._reported or t_s < self._due_s:
            return None
        self._due_s = t_s + self._every_s
        sentence = None
        if self._fixed is not None and self._layout is not None:
            shift = camera_shift(detect(image, self._layout), self._fixed)
            sentence = None if shift is None else shift.sentence
        sentence = sentence or plate_moved(drift_m)
        self._in_a_row = self._in_a_row + 1 if sentence else 0
        if self._in_a_row < _TIMES:
            return None
        self._reported = True
        return sentence


def _layout(ids: Sequence[int], dictionary: str) -> MarkerLayout:
    """A layout with the right names; the corners are not used."""
    square = 0.01 * np.array([(-1, 1), (1, 1), (1, -1), (-1, -1)], float)
    return MarkerLayout(np.array(ids), np.repeat(square[None], len(ids), axis=0), dictionary)
