"""One line about the first fault in a file."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field, ValidationError

from rig.validation import StrictModel, first_error_line, printable


class Inner(StrictModel):
    size_m: float = Field(default=1.0, gt=0)


class Outer(StrictModel):
    title: str
    one: Inner | None = None
    many: list[Inner] = Field(default_factory=list)
    named: dict[str, Inner] = Field(default_factory=dict)


@pytest.mark.parametrize(
    ("data", "line"),
    [
        ({"title": "a", "tilte": "b"}, "unknown key 'tilte'; known: title, one, many, named"),
        ({"title": "a", "one": {"size": 1}}, "unknown key 'one.size'; known: size_m"),
        ({"title": "a", "many": [{}, {"size": 1}]}, "unknown key 'many.1.size'; known: size_m"),
        ({"title": "a", "named": {"b": {"c": 1}}}, "unknown key 'named.b.c'; known: size_m"),
        ({"one": {"size_m": -1}, "x": 1}, "unknown key 'x'; known: title, one, many, named"),
        ({}, "key 'title' is missing; known: title, one, many, named"),
        (
            {"title": "a", "one": {"size_m": -1}},
            "one.size_m = -1: Input should be greater than 0",
        ),
        ({"title": ["a"]}, "title: Input should be a valid string"),
    ],
)
def test_the_line_names_place_value_and_known_keys(data: dict[str, Any], line: str):
    with pytest.raises(ValidationError) as caught:
        Outer.model_validate(data)
    assert first_error_line(caught.value, Outer) == line
    assert "\n" not in line


def test_a_section_checked_alone_is_named():
    with pytest.raises(ValidationError) as caught:
        Inner.model_validate({"size_m": "wide"})
    assert first_error_line(caught.value, within="ball").startswith("ball.size_m = 'wide': ")


@given(st.text() | st.text(st.characters(categories=["Cc", "Cf", "Cs", "Zl", "Zp"])))
def test_a_text_from_elsewhere_becomes_one_printable_line_of_unicode(text: str):
    found = printable(text)
    assert found.isprintable()
    assert found.encode() is not None
    assert printable(found) == found
    assert printable("a \x1b[1m\n b\ud800") == "a ?[1m b?"
