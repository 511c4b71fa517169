"""Faults of pictures of a calibration sheet that are found by name before anything is fitted."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from calibration.camera.sharpness import picture_blur_px
from calibration.camera.sheet import CalibrationError, Sheet, SheetView
from vision.plate.markers import dictionary_of

MAX_BLUR_PX = 1.8  # of a sharp picture 0.5 to 1.2
MAX_SHARE_ERROR = 0.03
_LOOKED_AT = 6
_MIN_MARKERS = 6
_OFF_SQUARES = 0.3  # a marker further from its place than this is not on this board
_BOOKS = (  # the sets of 50 are the beginnings of those of 100, 250 and 1000
    "DICT_4X4_50 DICT_5X5_50 DICT_6X6_50 DICT_7X7_50 DICT_4X4_250 DICT_5X5_250 DICT_6X6_250 "
    "DICT_7X7_250 DICT_APRILTAG_36h11 DICT_ARUCO_ORIGINAL DICT_ARUCO_MIP_36h12"
).split()


def refuse_wrong_sheet(images: Sequence[np.ndarray], sheet: Sheet) -> None:
    """Raise `CalibrationError` where the pictures show a sheet other than `sheet` (dictionary,
    number of squares, marker ids), or a mirror image of it.

    Up to 6 of the pictures (h, w[, 3]) uint8 are examined; where none shows any marker nothing is
    raised, because there may be no sheet at all.
    """
    some = [_grey(images[i]) for i in _spread(len(images))]
    own = [_markers(image, sheet.dictionary) for image in some]
    if sum(len(ids) >= _MIN_MARKERS for ids, _ in own) >= 1:
        _refuse_other_board(own, sheet, some)
        return
    flipped = [_markers(image[:, ::-1], sheet.dictionary) for image in some]
    if sum(len(ids) >= _MIN_MARKERS for ids, _ in flipped) >= 1:
        raise CalibrationError(
            "mirrored image: the sheet's markers are only read in a mirror: switch off the mirror "
            "(flip) of the camera or its program"
        )
    for name in _BOOKS:
        # The pose of a small board's corners can hold chance patterns, but not in most pictures.
        counts = [len(set(_markers(image, name)[0].tolist())) for image in some[::2]]
        if np.median(counts) >= _MIN_MARKERS:
            raise CalibrationError(
                f"wrong dictionary: the pictures show markers of {name}, none of "
                f"{sheet.dictionary}: name the sheet that was printed (--dictionary)"
            )


def refuse_blurred_pictures(images: Sequence[np.ndarray], found: int) -> None:
    """Raise `CalibrationError` where a quarter or more of the pictures (h, w[, 3]) uint8 is blurred
    by over MAX_BLUR_PX. To be called when the sheet was read in too few of them: `found`, for the
    message."""
    blurs = np.array([picture_blur_px(_grey(image)) for image in images])
    bad = int(np.sum(blurs > MAX_BLUR_PX))
    if 4 * bad >= len(blurs):
        raise CalibrationError(
            f"blur: {bad} of {len(blurs)} pictures have edges over {MAX_BLUR_PX} px wide (up to "
            f"{np.nanmax(blurs):.1f} px), the sheet was read in {found}: hold it still, focus"
        )


def _spread(count: int) -> list[int]:
    return sorted({int(i) for i in np.linspace(0, count - 1, min(count, _LOOKED_AT)).round()})


def _grey(image: np.ndarray) -> np.ndarray:
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)


def _markers(grey: np.ndarray, dictionary: str) -> tuple[np.ndarray, np.ndarray]:
    """Ids (k,) and corners (k, 4, 2) px of one dictionary's markers."""
    book = dictionary_of(dictionary)
    corners, ids, _ = cv2.aruco.ArucoDetector(book).detectMarkers(np.ascontiguousarray(grey))
    if ids is None:
        return np.zeros(0, int), np.zeros((0, 4, 2))
    return np.asarray(ids).reshape(-1), np.asarray(corners, float).reshape(-1, 4, 2)


def _refuse_other_board(
    found: list[tuple[np.ndarray, np.ndarray]], sheet: Sheet, images: Sequence[np.ndarray]
) -> None:
    misplaced = [off for ids, px in found if (off := _off_squares(ids, px, sheet)) is not None]
    on_board = set(np.asarray(sheet.board.getIds()).reshape(-1).tolist())
    strangers = {int(i) for ids, _ in found for i in ids} - on_board
    if len(strangers) < 3 and (not misplaced or np.median(misplaced) < _OFF_SQUARES):
        return
    for name in _BOOKS[:4]:  # the plate's own markers may be of the dictionary that was told
        other = replace(sheet, dictionary=name) if sheet.columns * sheet.rows <= 101 else sheet
        offs = [_off_squares(*_markers(image, name), other) for image in images[::2]]
        if name != sheet.dictionary and sum(o is not None and o < _OFF_SQUARES for o in offs) >= 2:
            raise CalibrationError(
                f"wrong dictionary: the sheet in the pictures has markers of {name}, not of "
                f"{sheet.dictionary}: name the sheet that was printed (--dictionary)"
            )
    turned = Sheet(sheet.rows, sheet.columns, sheet.square_m, sheet.marker_m, sheet.dictionary)
    offs = [off for ids, px in found if (off := _off_squares(ids, px, turned)) is not None]
    guess = (
        f"a sheet of {turned.columns}x{turned.rows} squares fits"
        if offs and np.median(offs) < _OFF_SQUARES
        else "the markers lie otherwise, or have other numbers"
    )
    raise CalibrationError(
        f"swapped board: the pictures do not show the sheet of {sheet.columns}x{sheet.rows} "
        f"squares with {sheet.dictionary}: {guess}; name the sheet that was printed (--squares)"
    )


def _off_squares(ids: np.ndarray, corners_px: np.ndarray, sheet: Sheet) -> float | None:
    """75th percentile of the markers' distances from their places, in squares; None: too few."""
    board_ids = np.asarray(sheet.board.getIds()).reshape(-1).tolist()
    known = [k for k, i in enumerate(ids) if int(i) in board_ids]
    if len(known) < _MIN_MARKERS:
        return None
    objects = sheet.board.getObjPoints()
    places = [np.asarray(objects[board_ids.index(int(ids[k]))])[:, :2] for k in known]
    points, seen = np.concatenate(places) / sheet.square_m, corners_px[known].reshape(-1, 2)
    to_board, _ = cv2.findHomography(seen, points, cv2.RANSAC, _OFF_SQUARES / 2)
    if to_board is None:
        return np.inf
    flat = cv2.perspectiveTransform(seen[None], to_board)[0]
    return float(np.percentile(np.linalg.norm(flat - points, axis=1), 75))


def leave_out_blurred(views: Sequence[SheetView]) -> tuple[list[SheetView], list[str]]:
    """The views with a blur up to MAX_BLUR_PX, and a list of one warning about the others (empty:
    none). Views of unknown blur are kept."""
    kept = [view for view in views if not view.blur_px > MAX_BLUR_PX]
    blurred = [view for view in views if view.blur_px > MAX_BLUR_PX]
    if not blurred:
        return kept, []
    worst = max(blurred, key=lambda view: view.blur_px)
    return kept, [
        f"blur: {len(blurred)} of {len(views)} pictures left out, edges up to {worst.blur_px:.1f} "
        f"px wide (picture {worst.index}; limit {MAX_BLUR_PX} px): hold the sheet still, focus"
    ]


def refuse_wrong_print(views: Sequence[SheetView], sheet: Sheet) -> None:
    """Raise `CalibrationError` where the median ratio of the markers' side to the squares' side
    differs from the sheet's by over 3 %. Nothing is raised where no view has the ratio."""
    shares = [view.marker_share for view in views if np.isfinite(view.marker_share)]
    if not shares:
        return
    seen, said = float(np.median(shares)), sheet.marker_m / sheet.square_m
    if abs(seen / said - 1) > MAX_SHARE_ERROR:
        raise CalibrationError(
            f"wrong square size: the markers' side is {seen:.3f} of a square, "
            f"{1e3 * sheet.marker_m:g} mm in {1e3 * sheet.square_m:g} mm would be {said:.3f}: "
            "measure both on the print (--square-mm, --marker-mm)"
        )
