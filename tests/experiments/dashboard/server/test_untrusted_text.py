"""Text of others on the page: no HTML, no Markdown, in one line."""

import html

import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.dashboard.server.untrusted_text import LONGEST, measured, plain, words_of
from rig.files import as_unicode


@given(st.text(alphabet=st.characters(codec="ascii"), max_size=200))
def test_nothing_of_a_text_means_anything_and_all_of_it_is_shown(text):
    shown = plain(text)
    left = shown.replace("&#", "").replace(";", "")
    assert all(one.isalnum() or one == " " or not one.isprintable() for one in left)
    assert html.unescape(shown) == " ".join(text.split())


@pytest.mark.parametrize(
    ("said", "lines"),
    [
        ("the ball stays 0.29 cm away", ["the", "ball", "stays", "0.29 cm", "away"]),
        ("2.00 [1.94, 2.06] deg, 95 %", ["2.00 [1.94, 2.06] deg,", "95 %"]),
        ("run 2 of 2 is next", ["run", "2", "of", "2", "is", "next"]),
    ],
)
def test_a_number_and_its_unit_stay_on_one_line(said, lines):
    assert html.unescape(measured(said)).split(" ") == [x.replace(" ", "\u00a0") for x in lines]


def test_a_name_cannot_turn_the_words_beside_it():
    assert html.unescape(plain("a\u202egnp.exe\u2066\u200d")) == "a?gnp.exe?\u200d"


def test_a_long_text_is_cut_off():
    assert html.unescape(plain("a<" * LONGEST)).endswith("a…")
    assert len(html.unescape(plain("a<" * LONGEST))) == LONGEST


def test_half_a_surrogate_pair_is_shown_as_a_question_mark():
    """No message with one could be sent, and no new page would open any more."""
    assert html.unescape(plain("a\ud800b\udcff")) == as_unicode("a\ud800b\udcff") == "a?b?"


def test_an_error_without_words_is_named_by_its_kind():
    assert words_of(OSError("no room")) == "no room"
    assert words_of(KeyError()) == "KeyError"
