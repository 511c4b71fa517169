"""Report pages in a real browser: on a phone, in the dark, sorted and filtered, and on A4 paper."""

import re
import zlib
from pathlib import Path

import numpy as np
import pytest

from experiments.reports.report import (
    RUN_HEAD,
    Picture,
    Pictures,
    Section,
    Table,
    write_page,
)
from tests.support.in_browser.page import expect

PRINTED_PX = 703  # width of A4 less two margins of 12 mm, at 96 pixels an inch
LONG = "none | harmonic kinematic error | hold"


def every_kind_of_page(folder: Path) -> Path:
    """A page with what the reports have: a wide table, a long one to sort, figures, a code."""
    import cv2

    picture = folder / "picture.png"
    cv2.imwrite(str(picture), np.full((660, 960, 3), 255, np.uint8))
    logs = [f"20261122T15010{i}-sine-sweep-without" for i in range(3)]
    wide = [
        [f"run {i}", logs[i % 3], "completed", *(f"{i}.{j} [{j}, {j + 1}]" for j in range(11))]
        for i in range(8)
    ]
    head = ("cell", "arm", "gain [cm]", "p (Holm)", "verdict", "at equal activity")
    agree = [["joint_backlash", *("1.99 [1.89, 2.09] deg" for _ in logs), "yes"]]
    rest = ("-", "helps", "+0.1 vs retuned 4.5, 5: ha")
    cells = [[f"{LONG} kind{i % 7}", "with", f"{(i * 37) % 101:+d}", *rest] for i in range(120)]
    return write_page(
        folder / "report.html",
        title="2 recorded runs",
        source="virtual rig",
        answer="The ball stays 3.2 times nearer to its target.",
        summary=["a note"],
        sections=[
            Section(
                "Figures",
                ["Pushes are drawn.", Pictures([Picture(picture, "a"), Picture(picture, "b")])],
            ),
            Section("A run", [Pictures([Picture(picture, n) for n in "abc"], beside=True)]),
            Section("Sizes", [Table(("effect", *logs, "agree"), agree)]),
            Section("Seven", [Table([f"column {j}" for j in range(7)], [["1.5 mm"] * 7])]),
            Section("Every run", [Table(RUN_HEAD, wide)]),
            Section("Every cell", [Table(head, cells, words=2, folded=True)]),
        ],
    )


@pytest.fixture(scope="module")
def page_file(tmp_path_factory) -> Path:
    return every_kind_of_page(tmp_path_factory.mktemp("report"))


def opened(chromium, file: Path, width: int, **settings):
    page = chromium.new_context(viewport={"width": width, "height": 900}, **settings).new_page()
    page.goto(file.as_uri())
    return page


CUT = """() => [...document.querySelectorAll("td, th, img, p")].filter(one =>
  one.getBoundingClientRect().width && one.getBoundingClientRect().right > innerWidth + 1).length"""


def test_nothing_is_cut_off_on_a_phone_or_on_paper(chromium, page_file):
    phone = opened(chromium, page_file, 390)
    assert phone.evaluate("document.documentElement.scrollWidth") <= 390
    box = phone.locator(".scroll").first
    assert box.evaluate("one => one.scrollWidth > one.clientWidth")  # it scrolls by itself
    paper = opened(chromium, page_file, PRINTED_PX)
    paper.emulate_media(media="print")
    assert paper.evaluate(CUT) == 0
    assert paper.get_by_text("+0.1 vs retuned 4.5, 5: ha").last.is_visible()  # folded on the screen


def test_the_letters_of_a_large_figure_are_read_on_a_phone(chromium, tmp_path):
    import cv2

    figures = []
    widths_px = (720, 1290, 1770)  # of half a page, a whole one and more, at 150 pixels an inch
    for width_px in widths_px:
        file = tmp_path / f"{width_px}.png"
        cv2.imwrite(str(file), np.full((400, width_px, 3), 255, np.uint8))
        figures.append(Pictures([Picture(file, f"{width_px}")]))
    report = tmp_path / "report.html"
    write_page(
        report, title="f", source="virtual rig", summary=[], sections=[Section("F", figures)]
    )
    phone = opened(chromium, report, 390)
    assert phone.evaluate("document.documentElement.scrollWidth") <= 390
    small, *large = (phone.locator("img").nth(i).bounding_box()["width"] for i in range(3))
    assert small <= 360
    for shown, width_px in zip(large, widths_px[1:], strict=True):
        assert 9 / 72 * shown / (width_px / 150) > 9  # pixels of letters of 9 points
    box = phone.locator(".large .scroll").first
    assert box.evaluate("one => one.scrollWidth > one.clientWidth")
    paper = opened(chromium, report, PRINTED_PX)
    paper.emulate_media(media="print")
    assert paper.evaluate(CUT) == 0


def fades(page, box, left_px: int, right_px: int) -> None:
    """Asserts how far the left and the right edge of a box come to fade out, once it is drawn."""
    page.wait_for_timeout(200)
    for name, wanted_px in (("--fade-start", left_px), ("--fade-end", right_px)):
        expect(box).to_have_css(name, f"{wanted_px}px")


def test_a_figure_wider_than_a_sheet_fills_it(chromium, tmp_path):
    """The map of the shipped comparison had letters of 2.3 points, as a figure of half a sheet."""
    import cv2

    file = tmp_path / "map.png"
    cv2.imwrite(str(file), np.full((1800, 1770, 3), 255, np.uint8))
    blocks = [Pictures([Picture(file, "map")], wide=True)]
    report = write_page(
        tmp_path / "report.html",
        title="f",
        source="virtual rig",
        summary=[],
        sections=[Section("F", blocks)],
    )
    paper = opened(chromium, report, PRINTED_PX)
    paper.emulate_media(media="print")
    assert paper.locator("img").bounding_box()["width"] > 0.97 * PRINTED_PX
    assert paper.evaluate(CUT) == 0


@pytest.mark.parametrize("touch", [False, True])
def test_a_table_that_goes_on_fades_out_there(chromium, page_file, touch):
    phone = opened(chromium, page_file, 390, is_mobile=touch, has_touch=touch)
    box = phone.locator(".scroll", has_text="run 0").first
    assert "linear-gradient" in box.evaluate("one => getComputedStyle(one).maskImage")
    fades(phone, box, 0, 64)
    box.evaluate("one => one.scrollLeft = one.scrollWidth / 2 - one.clientWidth / 2")
    fades(phone, box, 64, 64)
    box.evaluate("one => one.scrollLeft = one.scrollWidth")
    fades(phone, box, 64, 0)
    wide = opened(chromium, page_file, 1280)
    fades(wide, wide.locator(".scroll", has_text="column 0"), 0, 0)  # all of it is seen


LINES = """one => { const text = document.createRange(); text.selectNodeContents(one);
  return new Set([...text.getClientRects()].map(box => Math.round(box.top))).size; }"""


def test_words_are_whole_on_paper_and_borders_lie_inside(chromium, page_file):
    paper = opened(chromium, page_file, PRINTED_PX)
    paper.emulate_media(media="print")
    for word in ("agree", "joint_backlash"):
        assert paper.get_by_text(word, exact=True).evaluate(LINES) == 1
    right = "one => one.getBoundingClientRect().right"
    assert max(paper.locator("table").evaluate_all(f"all => all.map({right})")) <= PRINTED_PX - 0.5


def test_a_head_and_its_sentence_stay_with_what_they_are_of_on_paper(chromium, page_file):
    paper = opened(chromium, page_file, PRINTED_PX)
    paper.emulate_media(media="print")
    after = "one => getComputedStyle(one).breakAfter"
    assert paper.get_by_role("heading", name="Figures", exact=True).evaluate(after) == "avoid"
    assert paper.get_by_text("Pushes are drawn.").evaluate(after) == "avoid"
    assert paper.get_by_text("completed", exact=True).first.evaluate(LINES) == 1


def test_the_three_figures_of_a_run_share_half_a_sheet(chromium, page_file):
    paper = opened(chromium, page_file, PRINTED_PX)
    paper.emulate_media(media="print")
    boxes = [paper.locator(".beside figure").nth(i).bounding_box() for i in range(3)]
    (first, second, third) = (box for box in boxes if box)
    assert third["y"] == first["y"] < second["y"]
    assert third["x"] >= first["x"] + first["width"]
    half_px = (297 - 24) / 25.4 * 96 / 2
    assert second["y"] + second["height"] - first["y"] < half_px - 40  # less the run's head


def test_dark_by_preference_with_the_same_hues(chromium, page_file):
    looks = {}
    for scheme in ("light", "dark"):
        page = opened(chromium, page_file, 800, color_scheme=scheme)
        style = "one => [getComputedStyle(one).backgroundColor, getComputedStyle(one).color]"
        paper, ink = page.locator("body").evaluate(style)
        looks[scheme] = [sum(map(int, re.findall(r"\d+", one)[:3])) for one in (paper, ink)]
        turned = page.locator("figure img").first.evaluate("one => getComputedStyle(one).filter")
        assert ("invert" in turned) == (scheme == "dark")
    assert looks["light"][0] > 3 * 240 > looks["light"][1] + 3 * 100
    assert looks["dark"][0] < 3 * 60 < looks["dark"][1]


def test_a_long_table_is_folded_sorted_and_filtered(chromium, page_file):
    page = opened(chromium, page_file, 1280)
    table = page.locator("table.sorts")
    assert not table.is_visible()
    page.locator("summary").click()
    gains = "one => [...one.rows].slice(1).filter(r => !r.hidden).map(r => +r.cells[2].innerText)"
    page.get_by_role("columnheader", name="gain").click()
    found = table.evaluate(gains)
    assert found == sorted(found)
    page.get_by_role("columnheader", name="gain").click()
    assert table.evaluate(gains) == found[::-1]
    page.get_by_role("searchbox").fill("hold kind3 with")
    assert len(table.evaluate(gains)) == sum(1 for i in range(120) if i % 7 == 3)


@pytest.mark.slow
def test_the_pdf_is_a4_and_has_every_column(chromium, page_file):
    page = opened(chromium, page_file, 1280)
    content = page.pdf(prefer_css_page_size=True)
    boxes = re.findall(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", content)
    assert {(round(float(w)), round(float(h))) for w, h in boxes} == {(595, 842)}
    assert 3 <= len(boxes) <= 20
    right = [_rightmost(zlib.decompress(s)) for s in _streams(content)]
    assert 450 < max(right) <= 595 - 30  # points: to the margin of 12 mm, and not beyond


@pytest.mark.slow
def test_no_sheet_but_the_last_is_left_half_empty(chromium, tmp_path):
    """Lone figures, runs and tables that do not fit on what is left of a sheet. A run's head and
    figures stay together and take 43 % of one: so much may be white above them, and no more.
    """
    import cv2

    picture = tmp_path / "picture.png"
    cv2.imwrite(str(picture), np.full((660, 960, 3), 255, np.uint8))
    rows = [["joint_backlash", f"{i}.5 mm"] for i in range(24)]
    alone, many = Pictures([Picture(picture, "a")]), [Picture(picture, n) for n in "abc"]
    kinds = [[alone], [Pictures(many, beside=True)], [Table(("effect", "size"), rows)]]
    file = write_page(
        tmp_path / "report.html",
        title="9 recorded runs",
        source="virtual rig",
        summary=[],
        sections=[Section(f"{i}", kinds[i % len(kinds)]) for i in range(9)],
    )
    page = opened(chromium, file, 1280)
    sheet, margin = (mm / 25.4 * 96 for mm in (297, 12))
    content = page.pdf(prefer_css_page_size=True)
    lowest = [  # words on each sheet, from the top of the first one
        max(map(float, re.findall(rb"1 0 0 -1 [\d.]+ ([\d.]+) Tm", drawn)))
        for drawn in map(zlib.decompress, _streams(content))
    ]
    filled = [y / (sheet - 2 * margin) - i for i, y in enumerate(lowest)]
    assert len(filled) > 3
    assert min(filled[:-1]) > 0.55, filled


def _streams(content: bytes) -> list[bytes]:
    found = re.findall(rb"/FlateDecode[^>]*>>\s*stream\r?\n(.*?)endstream", content, re.S)
    kept = []
    for one in found:
        try:
            text = zlib.decompress(one)
        except zlib.error:
            continue
        if b" Tf" in text and b" Tm" in text:
            kept.append(one)
    return kept


def _rightmost(drawn: bytes) -> float:
    """Largest x at which a page begins a piece of text [points]; Chromium draws in CSS pixels."""
    scale = 72 / 96
    places = re.findall(rb"1 0 0 -1 ([\d.]+) [\d.]+ Tm", drawn)
    return max((scale * float(x) for x in places), default=0.0)
