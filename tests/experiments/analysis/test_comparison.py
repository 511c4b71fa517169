"""Both methods side by side: numbers that the logs were made with, and words that follow."""

from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

from experiments.analysis.comparison import (
    comparison_rows,
    comparison_sentence,
    ratio_words,
    told_words,
)
from experiments.analysis.limit_cycle import FEW
from experiments.analysis.numbers import recorded, run_numbers
from experiments.reports.report import RUN_HEAD, run_row
from rig.log import Log

SECONDS, RATE = 20, 200


def run(amplitude_cm: float, seed: int = 1, target_cm: float = 0.0):
    """A settled ball that swings about the centre on both axes, a quarter period apart, while the
    target goes to and fro by `target_cm` in x."""
    t = np.arange(SECONDS * RATE) / RATE
    rng = np.random.default_rng(seed)
    swing = 1e-2 * amplitude_cm * np.exp(2j * np.pi * t / 2.5)
    noise = 1e-4 * rng.standard_normal((2, len(t)))
    columns = {
        "t_s": t,
        "ball_x_m": swing.real + noise[0],
        "ball_y_m": swing.imag + noise[1],
        "ball_exposed_s": t,
        "target_x_m": 1e-2 * target_cm * np.sin(t),
        "target_y_m": 0 * t,
        "phase": 2 + 0 * t,
        "theta_x_rad": 0.1 * swing.real,
        "theta_y_rad": 0.1 * swing.imag,
    }
    return recorded(Path("run"), Log.from_columns(columns), "completed")


@pytest.fixture(scope="module")
def two():
    return [run(0.9)], [run(0.3)]


def test_the_sentence_says_what_the_logs_were_made_with(two):
    said = comparison_sentence(*two)
    assert "3.0 times nearer to its target: 0.30 cm instead of 0.90 cm" in said
    assert "one run of each" in said
    assert "3.0 times farther from" in comparison_sentence(*two[::-1])
    assert "as near to its target as without" in comparison_sentence(two[0], two[0])
    assert comparison_sentence(two[0], []) == ""


def test_a_table_without_play_is_called_so(two):
    """Not where the compensation found some, looked for none, or changed something."""
    still = run(0.3)

    def looked(of, gear_deg: float):
        widths = {"gear_play_rad": np.radians([0.0, gear_deg]), "joint_play_rad": np.zeros(2)}
        stds = {f"{name[:-4]}_std_rad": np.radians([0.1, 0.1]) for name in widths}
        return replace(of, metrics=replace(of.metrics, **widths, **stds))

    said = comparison_sentence([still], [looked(still, 0.15)])
    assert "found no play in this table, so runs with and without it are alike: 0.30 and" in said
    for with_ in (still, looked(still, 1.0), looked(run(0.1), 0.1)):
        assert "found no play" not in comparison_sentence([still], [with_])


def test_every_row_has_units_and_says_what_is_missing(two):
    rows = {row[0]: row[1:] for row in comparison_rows(*two)}
    assert rows["limit cycle, amplitude"] == ["0.90 cm", "0.30 cm", "3.0 times smaller"]
    assert rows["servo activity"][0].endswith(" deg")
    assert all("-" not in cell for row in rows.values() for cell in row)
    alone = {row[0]: row[1:] for row in comparison_rows([run(0.0)], [])}
    assert alone["limit cycle, amplitude"] == [FEW, "", ""]


def test_a_limit_cycle_that_is_not_told_has_one_wording_which_is_explained():
    short = run(0.0)
    row = dict(zip(RUN_HEAD, run_row("a", run_numbers(short)), strict=True))
    assert row["limit cycle x, y [cm]"] == FEW
    assert "the protocol hold runs long enough" in told_words(comparison_rows([short], []))
    assert told_words([list(row.values())]) == told_words(comparison_rows([short], []))
    assert told_words(comparison_rows([run(0.9)], [run(0.3)])) == ""


def test_of_a_target_that_moves_nothing_is_said_that_has_no_meaning():
    """5 cm to and fro (RMS 3.5 cm) about a ball that swings by 0.3 cm: it never comes nearer."""
    moving = [run(0.3, target_cm=5.0)]
    rows = {row[0]: row[1] for row in comparison_rows(moving, [])}
    for name in ("spread about its own mean", "limit cycle, amplitude"):
        assert rows.pop(name) == "the target moves"
    assert rows.pop("settling time") == "the target moves"
    assert float(rows.pop("distance from the target, RMS").split()[0]) == pytest.approx(
        3.5, rel=0.1
    )
    assert rows.pop("servo activity").endswith(" deg")
    assert not rows
    assert "RMS in the last half of each run" in comparison_sentence(moving, moving)
    page_row = dict(zip(RUN_HEAD, run_row("a", run_numbers(moving[0])), strict=True))
    assert page_row["settling [s]"] == "the target moves"
    assert page_row["centroid (x, y) [cm]"] == page_row["centroid's distance [cm]"] == "-"
    assert float(page_row["settled distance, RMS [cm]"]) == pytest.approx(3.5, rel=0.1)


def test_repeats_tell_a_clear_difference_from_their_own_scatter():
    apart = comparison_sentence(
        [run(a, i) for i, a in enumerate((0.9, 0.92, 0.91))],
        [run(a, i) for i, a in enumerate((0.3, 0.31, 0.29))],
    )
    assert "a clear difference" in apart
    mixed = comparison_sentence(
        [run(a, i) for i, a in enumerate((0.5, 0.9, 0.6))],
        [run(a, i) for i, a in enumerate((0.9, 0.5, 0.9))],
    )
    assert "within what repeats differ by" in mixed


def test_runs_of_unlike_seeds_are_no_pairs():
    """Three and four runs, in any order: the same scatter, the same answer."""
    without, with_ = (0.5, 0.9, 0.6), (0.45, 0.85, 0.55, 0.5)
    for order in permutations(without):
        said = comparison_sentence(
            [run(a, i) for i, a in enumerate(order)], [run(a, i) for i, a in enumerate(with_)]
        )
        assert "within what repeats differ by" in said


@pytest.mark.parametrize("pair", [(np.nan, 1.0), (1.0, np.inf), (0.0, 1.0)])
def test_no_ratio_is_made_of_what_is_missing(pair):
    assert ratio_words(*pair) == ""
