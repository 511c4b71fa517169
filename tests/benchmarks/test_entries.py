"""The benchmark's entries: short, and their answers are in the format of the rules."""

import json
from pathlib import Path

import numpy as np
import pytest

from experiments.benchmark.answers import answer_set, read_answer
from experiments.benchmark.design import Case
from experiments.benchmark.make import make_case
from experiments.blind.seal import seal
from tests.benchmarks.entries import whiteness
from tests.benchmarks.entries.run import ENTRIES
from tests.benchmarks.entries.signals import effect, relay
from tests.support.parts import needs

HERE = Path(__file__).parent / "entries"
NEEDS = {"sparse": needs("pysindy"), "symbolic": needs("gplearn")}


def test_an_entry_is_short_enough_to_be_read():
    lengths = {p.name: len(p.read_text("utf-8").splitlines()) for p in HERE.glob("*.py")}
    assert {f"{name}.py" for name in ENTRIES} <= set(lengths)
    assert max(lengths.values()) <= 150


def test_ljung_and_box_is_uniform_on_white_noise_and_small_on_coloured():
    rng = np.random.default_rng(1)
    white = [whiteness.p_value(rng.standard_normal(2000)) for _ in range(200)]
    # 200 draws of a uniform number: the mean's standard deviation is 0.0204.
    assert abs(np.mean(white) - 0.5) < 0.07
    noise = rng.standard_normal(2000)
    assert whiteness.p_value(noise[1:] + 0.3 * noise[:-1]) < 1e-6


def test_a_relay_changes_side_after_a_motion_of_more_than_a_step():
    theta = np.array([0.0, 0.01, 0.02, 0.015, 0.02, 0.0, 0.001])
    assert relay(theta, 0.006).tolist() == [0, 1, 1, 1, 1, -1, -1]


def test_sizes_are_given_with_95_percent():
    told = effect("joint_backlash", 0.5, {("x", "play_rad"): (0.03, 0.001)})
    size = told["parameters"]["x"]["play_rad"]
    assert size["low"] == pytest.approx(0.03 - 0.00196)
    assert size["high"] == pytest.approx(0.03 + 0.00196)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log whose volts are far off zero, and one of a table whose servos take an angle."""
    out = tmp_path_factory.mktemp("set")
    cases = [Case(1, "foreign", "one effect, real size"), Case(2, "positions", "healthy")]
    seal([make_case(case, 21, out / "cases") for case in cases], out)
    return out


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param(n, marks=NEEDS.get(n, ())) for n in ENTRIES])
def test_an_entry_answers_as_the_rules_have_it(folder: Path, tmp_path: Path, name: str):
    from importlib import import_module

    entry = import_module(f"tests.benchmarks.entries.{name}")
    assert answer_set(folder, tmp_path, answer=entry.answer_of, jobs=1) == 0
    for case in ("case-0001", "case-0002"):
        answer = read_answer(tmp_path / f"{case}.json")
        assert answer["verdict"] in ("named", "nothing-missing", "unknown-effect")
        assert answer == json.loads((tmp_path / "work" / f"{case}.json").read_text())["answer"]
