"""Both methods side by side: numbers that the logs were made with, and words that follow."""

from pathlib import Path

import numpy as np
import pytest

from experiments.analysis.comparison import comparison_rows, comparison_sentence, ratio_words
from experiments.analysis.numbers import recorded
from rig.log import Log

SECONDS, RATE = 20, 200


def run(amplitude_cm: float, seed: int = 1):
    """A settled ball that swings about the centre on both axes, a quarter period apart."""
    t = np.arange(SECONDS * RATE) / RATE
    rng = np.random.default_rng(seed)
    swing = 1e-2 * amplitude_cm * np.exp(2j * np.pi * t / 2.5)
    noise = 1e-4 * rng.standard_normal((2, len(t)))
    columns = {
        "t_s": t,
        "ball_x_m": swing.real + noise[0],
        "ball_y_m": swing.imag + noise[1],
        "ball_exposed_s": t,
        "target_x_m": 0 * t,
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


def test_every_row_has_units_and_says_what_is_missing(two):
    rows = {row[0]: row[1:] for row in comparison_rows(*two)}
    assert rows["limit cycle, amplitude"] == ["0.90 cm", "0.30 cm", "3.0 times smaller"]
    assert rows["servo activity, settled"][0].endswith(" deg")
    assert all("-" not in cell for row in rows.values() for cell in row)
    alone = {row[0]: row[1:] for row in comparison_rows([run(0.0)], [])}
    assert alone["limit cycle, amplitude"] == ["fewer than 2 cycles", "", ""]


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


@pytest.mark.parametrize("pair", [(np.nan, 1.0), (1.0, np.inf), (0.0, 1.0)])
def test_no_ratio_is_made_of_what_is_missing(pair):
    assert ratio_words(*pair) == ""
