"""Whose page a report replaces."""

import os
from pathlib import Path

from experiments.reports.report import Section, write_page


def test_a_page_of_ones_own_is_kept_and_an_earlier_report_is_replaced(tmp_path: Path):
    page = tmp_path / "report.html"
    page.write_text("<p>my notes on the table</p>")
    for summary in ("first", "second"):
        write_page(page, title="A report", summary=[summary], sections=[Section("One", ["words"])])
    assert "second" in page.read_text()
    assert (tmp_path / "report.html.1").read_text() == "<p>my notes on the table</p>"
    assert len(list(tmp_path.iterdir())) == 2


def test_a_folder_whose_name_is_no_text_has_a_page(tmp_path: Path):
    name = os.fsdecode(b"u-\xff")
    page = write_page(tmp_path / "report.html", title=name, summary=[], sections=[])
    assert "u-?" in page.read_text(encoding="utf-8")
