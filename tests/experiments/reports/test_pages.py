"""Whose page a report replaces, and whose pictures it holds."""

import base64
import os
from pathlib import Path

from experiments.reports.report import Picture, Section, write_page


def test_a_page_of_ones_own_is_kept_and_an_earlier_report_is_replaced(tmp_path: Path):
    page = tmp_path / "report.html"
    page.write_text("<p>my notes on the table</p>")
    for summary in ("first", "second"):
        write_page(page, title="A report", summary=[summary], sections=[Section("One", ["words"])])
    assert "second" in page.read_text()
    assert (tmp_path / "report.html.1").read_text() == "<p>my notes on the table</p>"
    assert len(list(tmp_path.iterdir())) == 2


def test_a_title_cannot_turn_the_words_beside_it(tmp_path: Path):
    page = write_page(tmp_path / "a.html", title="a\u202elmth", summary=["\u2067b"], sections=[])
    text = page.read_text(encoding="utf-8")
    assert "a?lmth" in text
    assert "?b" in text


def test_a_folder_whose_name_is_no_text_has_a_page(tmp_path: Path):
    name = os.fsdecode(b"u-\xff")
    page = write_page(tmp_path / "report.html", title=name, summary=[], sections=[])
    assert "u-?" in page.read_text(encoding="utf-8")


def test_a_page_holds_the_pictures_that_were_drawn_for_it(tmp_path: Path):
    """Another program's of the same name, made in the same folder meanwhile, stood in it."""
    path = tmp_path / "both-ball.png"
    path.write_bytes(b"mine")
    mine = Picture(path, "Ball")
    path.write_bytes(b"another's")
    assert base64.b64decode(mine.png) == b"mine"
