"""Sheets at true size: read back with OpenCV from the PDF's own drawing and from the pixels."""

import re
import signal
import sys
from dataclasses import replace
from functools import partial

import cv2
import numpy as np
import pytest

from calibration.camera.pages import MM_PER_POINT, Page, write_pdf, write_png
from calibration.camera.prints import board_page, plate_pages, sheet_files
from calibration.camera.sheet import Sheet, sheet_view
from vision.plate.markers import MarkerLayout, default_layout, detect

SHEET, SIDE_M = Sheet(), 0.275
LAYOUT = default_layout(SIDE_M)
DPI = 200.0
PX_PER_MM = DPI / 25.4


def pages_of_pdf(data: bytes) -> list[Page]:
    """The rectangles as a viewer would draw them: from the file alone."""
    boxes = re.findall(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", data)
    streams = re.findall(rb"stream\n(.*?)\nendstream", data, re.DOTALL)
    pages = []
    for (width, height), body in zip(boxes, streams, strict=True):
        page = Page(float(width) * MM_PER_POINT, float(height) * MM_PER_POINT)
        scale = float(body.split()[0]) * MM_PER_POINT  # millimetres a unit of the drawing
        for x, y, w, h in re.findall(rb"([-\d.]+) ([-\d.]+) ([-\d.]+) ([-\d.]+) re", body):
            x, y, w, h = (scale * float(v) for v in (x, y, w, h))
            page.rectangles.append((x, page.height_mm - y - h, w, h))
        pages.append(page)
    return pages


def test_the_board_is_read_back_at_its_true_size(tmp_path):
    write_pdf([board_page(SHEET)], tmp_path / "board.pdf")
    (page,) = pages_of_pdf((tmp_path / "board.pdf").read_bytes())
    assert (page.width_mm, page.height_mm) == pytest.approx((297, 210), abs=0.01)
    found = sheet_view(page.pixels(DPI), SHEET)
    assert found is not None
    assert len(found.points_m) == (SHEET.columns - 1) * (SHEET.rows - 1)
    told = 1e3 * found.points_m[:, :2]
    there = found.corners_px / PX_PER_MM
    assert np.abs((there - there[0]) - (told - told[0])).max() < 0.03
    assert found.marker_share == pytest.approx(0.75, abs=0.01)


def test_the_print_is_opencvs_own_board():
    """A magnification at which every cell is a whole number of pixels: only then can they agree."""
    page, own = board_page(SHEET), SHEET.image(112)
    x, y = (min(r[i] for r in page.rectangles) for i in (0, 1))
    page.rectangles = [(a - x, b - y, w, h) for a, b, w, h in page.rectangles]
    page.lines.clear()
    whole = page.pixels(25.4 * 112 / 24)
    cut = whole[: own.shape[0], : own.shape[1]]
    assert np.array_equal(cut < 128, own < 128)


@pytest.mark.parametrize(("paper", "strips"), [("a4", 2), ("a3", 1), ("legal", 2)])
def test_the_plates_markers_are_read_back_where_the_layout_says(paper, strips, tmp_path):
    pages = plate_pages(LAYOUT, SIDE_M, paper)
    assert len(pages) == strips
    write_pdf(pages, tmp_path / "plate.pdf")
    seen = {}
    for page, drawn in zip(pages_of_pdf((tmp_path / "plate.pdf").read_bytes()), pages, strict=True):
        found = detect(page.pixels(DPI), LAYOUT)
        frame = min(min(x1, x2) for x1, _, x2, _ in drawn.lines[103:]) + 1e3 * SIDE_M / 2
        for number, corners in zip(found.ids, found.corners_px / PX_PER_MM, strict=True):
            seen[int(number)] = corners * (1, -1) - (frame, 0)
    assert sorted(seen) == LAYOUT.ids.tolist()
    for number, corners in seen.items():
        told = 1e3 * LAYOUT.corners_m[number]
        assert np.abs((corners - told)[:, 0]).max() < 0.15
        assert np.abs(np.diff(corners - told, axis=0)).max() < 0.15


def test_strips_cut_no_marker():
    for page in plate_pages(LAYOUT, SIDE_M, "a4"):
        for x, y, w, h in page.rectangles:
            assert x > 4
            assert y > 4
            assert x + w < page.width_mm - 4
            assert y + h < page.height_mm - 4


def test_a_ruler_and_the_sizes_stand_on_every_page():
    for pages in sheet_files(SHEET, LAYOUT, SIDE_M, "a4", (46, 47)).values():
        for page in pages:
            texts = " ".join(text for *_, text in page.texts)
            assert "100 mm" in texts
            assert "mm" in texts.replace("100 mm", "")
            ticks = [line for line in page.lines if line[0] == line[2] and line[1] - line[3] <= 4]
            assert len(ticks) >= 101


def test_png_has_the_pages_pixels(tmp_path):
    write_png(board_page(SHEET), tmp_path / "board.png", 100)
    image = cv2.imread(str(tmp_path / "board.png"), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    assert image.shape == (827, 1169)


@pytest.mark.skipif(sys.platform == "win32", reason="file size limits are POSIX")
@pytest.mark.parametrize("name", ["board.png", "board.pdf"])
def test_a_page_is_written_whole_or_not_at_all(tmp_path, name: str):
    import resource

    write = (
        partial(write_png, dpi=100)
        if name == "board.png"
        else lambda page, path: write_pdf([page], path)
    )
    path = tmp_path / name
    path.write_text("an older one")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (500, hard))
    try:
        with pytest.raises(OSError, match="large"):
            write(board_page(SHEET), path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, before)
    assert path.read_text() == "an older one"
    assert list(tmp_path.iterdir()) == [path]


def test_what_does_not_fit_is_said():
    with pytest.raises(ValueError, match="letter paper cannot hold"):
        plate_pages(LAYOUT, SIDE_M, "letter")
    with pytest.raises(ValueError, match="known papers: a4"):
        board_page(SHEET, "a9")
    with pytest.raises(ValueError, match="cannot hold"):
        board_page(replace(SHEET, square_m=0.04))
    turned = MarkerLayout(LAYOUT.ids, np.roll(LAYOUT.corners_m, 1, axis=1))
    with pytest.raises(ValueError, match="upright"):
        plate_pages(turned, SIDE_M, "a3")


@pytest.mark.parametrize("change", [{"columns": 2}, {"marker_m": 0.03}, {"dictionary": "DICT_X"}])
def test_a_sheet_that_is_none_is_refused(change):
    with pytest.raises(ValueError, match=r"sheet|dictionary"):
        replace(SHEET, **change)


def test_a_sheet_with_more_markers_than_its_dictionary():
    with pytest.raises(ValueError, match="holds 50"):
        Sheet(14, 10)
