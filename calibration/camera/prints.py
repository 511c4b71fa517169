"""Sheets to print: the ChArUco board for the lens, the markers for the plate, all at true size."""

from collections.abc import Sequence
from itertools import pairwise

import cv2
import numpy as np

from calibration.camera.pages import PAPERS_MM, Page
from calibration.camera.sheet import Sheet
from vision.plate.markers import MarkerLayout, dictionary_of

MARGIN_MM, FOOT_MM = 5.0, 7.0


def board_page(sheet: Sheet, paper: str = "a4") -> Page:
    """The calibration sheet on `paper` (a key of PAPERS_MM), upright or turned, with its sizes in
    mm and a ruler. `ValueError`: unknown paper, or the sheet does not fit."""
    width, height = (1e3 * size for size in sheet.size_m)
    page = _fitting(paper, width, height, "the sheet: take smaller squares or larger paper")
    x, y = (page.width_mm - width) / 2, MARGIN_MM
    _squares(page, sheet, x, y)
    page.ruler(x, page.height_mm - MARGIN_MM)
    text = (
        f"{sheet.columns}x{sheet.rows} squares of {1e3 * sheet.square_m:g} mm, markers "
        f"{1e3 * sheet.marker_m:g} mm, {sheet.dictionary}; print at 100 %"
    )
    page.texts.append((x + 140, page.height_mm - MARGIN_MM, 3.0, text))
    return page


def _squares(page: Page, sheet: Sheet, x: float, y: float) -> None:
    """The board's squares and markers, cell by cell as OpenCV draws them."""
    square, marker = 1e3 * sheet.square_m, 1e3 * sheet.marker_m
    book = sheet.board.getDictionary()
    cells = book.markerSize + 2
    objects, ids = sheet.board.getObjPoints(), np.asarray(sheet.board.getIds()).reshape(-1)
    white = set()
    for corners, number in zip(objects, ids, strict=True):
        left, top = 1e3 * np.asarray(corners).reshape(-1, 3)[:, :2].min(axis=0)
        drawn = cv2.aruco.generateImageMarker(book, int(number), cells)
        page.pattern(np.asarray(drawn) < 128, x + float(left), y + float(top), marker / cells)
        white.add((int(left / square), int(top / square)))
    for column in range(sheet.columns):
        for row in range(sheet.rows):
            if (column, row) not in white:
                page.rectangles.append((x + column * square, y + row * square, square, square))


def plate_pages(layout: MarkerLayout, plate_side_m: float, paper: str = "a4") -> list[Page]:
    """The plate's markers at their places: one page, or strips to be laid edge to edge, cut between
    markers.

    The thin frame is the plate's edge, the thin cross its centre. `paper`: a key of PAPERS_MM.
    `ValueError`: unknown paper, paper too small even for strips, or a marker that is turned.
    """
    side, half = 1e3 * plate_side_m, 500 * plate_side_m
    tallest = _fitting(paper, side, 10.0, "a strip of the plate: take larger paper").height_mm
    room = tallest - 2 * MARGIN_MM - FOOT_MM
    cuts = [half]
    while cuts[-1] > -half + 1e-6:
        cuts.append(_next_cut(1e3 * layout.corners_m, cuts[-1], half, room))
    pages = []
    for number, (top, bottom) in enumerate(pairwise(cuts), 1):
        page = _fitting(paper, side, top - bottom, "a strip of the plate")
        x, y = (page.width_mm - side) / 2, MARGIN_MM
        _plate_strip(page, layout, (x + half, y + top), top, bottom, half)
        page.ruler(x, page.height_mm - MARGIN_MM)
        text = f"plate of {side:g} mm, strip {number} of {len(cuts) - 1}, +y is up; print at 100 %"
        page.texts.append((x + 140, page.height_mm - MARGIN_MM, 3.0, text))
        pages.append(page)
    return pages


def _fitting(paper: str, width: float, height: float, what: str) -> Page:
    if paper not in PAPERS_MM:
        raise ValueError(f"--paper {paper}: known papers: {', '.join(PAPERS_MM)}")
    for w, h in (PAPERS_MM[paper][::-1], PAPERS_MM[paper]):
        if w >= width + 2 * MARGIN_MM and h >= height + 2 * MARGIN_MM + FOOT_MM:
            return Page(w, h)
    raise ValueError(
        f"{paper} paper cannot hold {width:g} x {height:g} mm with margins of {MARGIN_MM:g} mm for "
        f"{what}"
    )


def _next_cut(corners_mm: np.ndarray, top: float, half: float, room: float) -> float:
    """How far down the next strip reaches: to the plate's edge, or to where no marker is cut."""
    if top + half <= room:
        return -half
    cut = top - room
    for low, high in sorted((float(c[:, 1].min()), float(c[:, 1].max())) for c in corners_mm):
        if low - 1.0 < cut < high + 1.0:
            cut = high + 1.0
    if cut >= top - 1.0:
        raise ValueError("the plate's markers leave no room to cut the sheet: take larger paper")
    return cut


def _plate_strip(page: Page, layout: MarkerLayout, origin, top: float, bottom: float, half: float):
    book = dictionary_of(layout.dictionary)
    cells = book.markerSize + 2
    x0, y0 = origin
    for number, corners in zip(layout.ids, 1e3 * layout.corners_m, strict=True):
        centre = corners.mean(axis=0)
        if not bottom < centre[1] <= top:
            continue
        left, upper = corners[:, 0].min(), corners[:, 1].max()
        side = float(np.ptp(corners[:, 0]))
        square = np.array([(left, upper), (left + side, upper), (left + side, upper - side)])
        if np.abs(square - corners[:3]).max() > 1e-6:
            raise ValueError(f"marker {number} is turned: only upright markers can be printed")
        drawn = np.asarray(cv2.aruco.generateImageMarker(book, int(number), cells)) < 128
        page.pattern(drawn, x0 + float(left), y0 - float(upper), side / cells)
        text = f"{number}: ({centre[0]:+.1f}, {centre[1]:+.1f}) mm, side {side:g} mm"
        page.texts.append((x0 + float(left), y0 - float(upper) + side + 3.0, 2.0, text))
    for x in (-half, half):
        page.lines.append((x0 + x, y0 - top, x0 + x, y0 - bottom))
    page.lines += [(x0 - half, y0 - y, x0 + half, y0 - y) for y in (top, bottom)]
    if bottom < 0 < top:
        page.lines += [(x0 - 5, y0, x0 + 5, y0), (x0, y0 - 5, x0, y0 + 5)]


def fixed_page(ids: Sequence[int], dictionary: str, side_m: float, paper: str = "a4") -> Page:
    """Markers with these `ids` of an OpenCV dictionary (its name) and side `side_m` to be cut out
    and glued beside the plate, where they stand still. `ValueError`: unknown paper, or it is too
    small.
    """
    side, gap = 1e3 * side_m, 26.0
    page = _fitting(paper, len(ids) * side + (len(ids) - 1) * gap, side, "the fixed markers")
    book = dictionary_of(dictionary)
    cells = book.markerSize + 2
    for i, number in enumerate(ids):
        x, y = 20.0 + i * (side + gap), 20.0
        drawn = np.asarray(cv2.aruco.generateImageMarker(book, int(number), cells)) < 128
        page.pattern(drawn, x, y, side / cells)
        page.texts.append((x, y + side + 6.0, 2.5, f"fixed {number}, side {side:g} mm"))
    page.ruler(20.0, page.height_mm - MARGIN_MM)
    text = "glue flat beside the plate with 12 mm of white all round; they must not move"
    page.texts.append((20.0, 12.0, 3.0, text))
    return page


def sheet_files(
    sheet: Sheet, layout: MarkerLayout, plate_side_m: float, paper: str, fixed: Sequence[int]
) -> dict[str, Sequence[Page]]:
    """File name (without suffix) -> pages of everything that a calibration needs printed:
    "charuco", "plate" and "fixed" (markers with the ids `fixed`). `ValueError`: unknown or too
    small paper, or a marker that is turned."""
    marker_m = float(np.ptp(layout.corners_m[0, :, 0]))
    return {
        "charuco": [board_page(sheet, paper)],
        "plate": plate_pages(layout, plate_side_m, paper),
        "fixed": [fixed_page(fixed, layout.dictionary, marker_m, paper)],
    }
