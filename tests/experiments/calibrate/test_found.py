"""The table of what a calibration found."""

from datetime import UTC, datetime
from math import inf, radians

import pytest

from calibration.bundle import Draft
from calibration.records import BacklashAxis, BacklashRecord, LevelRecord, Value
from experiments.calibrate.found import HEAD, found_table, value_words


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (Value.around(1.7234, 0.0371), "1.72 [1.69, 1.76]"),
        (Value.around(45.1, 1.42), "45.1 [43.7, 46.5]"),
        (Value.around(-200.0, 30.0), "-200 [-230, -170]"),
        (Value(value=1.0, low=0.9, high=2.0), "1.0 [0.9, 2.0]"),
        (Value.around(1.7234, 0.0), "1.72"),
        (Value.around(1.7234, inf), "1.72"),
        (None, "-"),
    ],
)
def test_a_value_has_the_decimals_that_its_interval_deserves(value, words):
    assert value_words(value, 1.0) == words


def test_every_quantity_of_an_axis_is_a_row_with_its_unit():
    both = {"x": Value.around(radians(0.5), radians(0.1)), "y": Value.around(0.0, radians(0.2))}
    gain = {"x": Value.around(0.7, 0.1), "y": Value.around(0.8, 0.1)}
    draft = Draft(
        made=datetime.now(UTC),
        source="measured",
        level=LevelRecord(slope_rad=both, gain_m_s2=gain, play_rad={"x": 0.0, "y": 0.0}),
        play=BacklashRecord(plays={"whole": {"x": BacklashAxis(width_rad=both["x"])}}),
    )
    assert found_table(draft) == [
        ["plate's slope at zero, x", "0.50 [0.40, 0.60] deg"],
        ["plate's slope at zero, y", "0.0 [-0.2, 0.2] deg"],
        ["ball's acceleration, x", "0.70 [0.60, 0.80] m/s² per rad"],
        ["ball's acceleration, y", "0.80 [0.70, 0.90] m/s² per rad"],
        ["play: gear and joint, x", "0.50 [0.40, 0.60] deg"],
        ["play: gear and joint, y", "-"],
    ]
    assert all(len(row) == len(HEAD) for row in found_table(draft))
    assert found_table(Draft(made=datetime.now(UTC), source="measured")) == []
