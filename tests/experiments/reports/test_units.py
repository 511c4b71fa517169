"""No line of a report ends between a number and its unit."""

import pytest

from experiments.dashboard.server.untrusted_text import measured
from experiments.reports.report import Code, Section, write_page
from experiments.reports.units import unbroken

GLUED = [
    "5~mm", "0.21~[0.20,~0.22]~cm", "3~s of 10 students", "1.5~degrees of play", "20~% more",
    "12 masses", "seeds 11, 12 and 13", "[x](y) and", "no 5 minds",
]  # fmt: skip


@pytest.mark.parametrize("shown", GLUED)
def test_a_blank_before_a_unit_does_not_break_and_others_do(shown: str):
    assert unbroken(shown.replace("~", " ")) == shown.replace("~", "\u00a0")


def test_the_dashboard_glues_what_it_has_escaped():
    assert measured("0.2 [0.1, 0.3] cm <b>") == (
        "0&#46;2\u00a0&#91;0&#46;1&#44;\u00a00&#46;3&#93;\u00a0cm &#60;b&#62;"
    )


def test_sentences_of_a_page_are_glued_and_code_is_not(tmp_path):
    section = Section("Title", ["off by 5 mm", Code("wait 5 s")], question="How many mm of 7 mm?")
    page = write_page(tmp_path / "p.html", title="Page", summary=["in 3 s"], sections=[section])
    text = page.read_text(encoding="utf-8")
    for glued in ("by 5\u00a0mm", "of 7\u00a0mm?", "in 3\u00a0s"):
        assert glued in text
    assert "wait 5 s" in text
