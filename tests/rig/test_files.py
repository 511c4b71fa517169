"""One line about the first fault in a file."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field, ValidationError

from rig.files import StrictModel, first_error_line, printable, read_json, read_toml


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


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("9" * 5000, "a number has too many digits"),
        ('{"a": -' + "9" * 301 + "}", "a number has too many digits"),  # which no float holds
        ("[" * 100_000, "its brackets are too deep"),
        ('"\\ud800"', "no Unicode"),
        ("{", "line 1 column 2"),
    ],
)
def test_a_bad_json_file_is_one_line(text: str, words: str):
    with pytest.raises(ValueError, match=words) as caught:
        read_json(text)
    assert str(caught.value).startswith("not a JSON file (")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a = " + "9" * 5000, "a number has too many digits"),
        ("a = " + "9" * 19, "beyond 64 bits"),
        ("a = " + "[" * 5000, "too deep"),
        (".".join("a" * 2500) + " = 1", "dotted keys are too deep"),
        (".".join("a" * 20_000) + " = 1", "dotted keys are too many"),  # took 1.7 GB
        ("[" + ".".join("a" * 2000) + "]\n" + "b = 1\n" * 10_000, "dotted keys are too many"),
    ],
)
def test_a_bad_toml_file_is_one_line(text: str, words: str):
    with pytest.raises(ValueError, match=words) as caught:
        read_toml(text)
    assert str(caught.value).startswith("not a TOML file (")


def test_long_lists_of_numbers_are_no_dotted_keys():
    line = "a = [" + ", ".join(["0.5"] * 1000) + "]\n"
    assert len(read_toml(line + "".join(f"b{i} = 1\n" for i in range(1000)))["a"]) == 1000
