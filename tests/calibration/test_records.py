"""Numbers with their intervals."""

import pytest

from calibration.records import Value


@pytest.mark.parametrize(
    ("value", "expected"),
    [(1e-10, (0.0, 0.0, 0.007)), (0.02, (0.02, 0.013, 0.027)), (-0.001, (0.0, 0.0, 0.006))],
)
def test_what_a_fit_left_just_inside_a_bound_is_the_bound(value: float, expected: tuple):
    found = Value.within(value, 0.007, at_least=0.0)
    assert (found.value, found.low, found.high) == pytest.approx(expected, abs=1e-9)
    assert found.value == 0.0 or found.value == value
