"""The one clamp: properties that hold for every float there is."""

import math

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rig.limits import limit

NO_DEADLINE = settings(deadline=None)  # a first call may have to compile
ANY = st.floats(allow_nan=True, allow_infinity=True, width=64)
VOLTAGE_LIMIT = st.floats(1e-3, 1e3)
ANGLE_LIMIT = st.floats(1e-3, 1.5)
# Below this a product with an angle can underflow; no amplifier knows such volts.
SMALLEST_V = 1e-200


@NO_DEADLINE
@given(ANY, ANY, VOLTAGE_LIMIT, ANGLE_LIMIT)
@example(math.nan, 0.0, 6.0, 0.5)
@example(math.inf, 0.0, 6.0, 0.5)
@example(1.0, math.nan, 6.0, 0.5)
@example(1.0, -math.inf, 6.0, 0.5)
def test_what_comes_out_is_finite_and_within_the_limit(wish, theta, volts, angle):
    out = limit(wish, theta, volts, angle)
    assert math.isfinite(out)
    assert abs(out) <= volts


@NO_DEADLINE
@given(ANY, ANY, VOLTAGE_LIMIT, ANGLE_LIMIT)
def test_anything_unclear_is_zero(wish, theta, volts, angle):
    if not (math.isfinite(wish) and math.isfinite(theta)):
        assert limit(wish, theta, volts, angle) == 0.0


@NO_DEADLINE
@given(ANY, ANY, VOLTAGE_LIMIT, ANGLE_LIMIT)
def test_sign_never_turns_and_size_never_grows(wish, theta, volts, angle):
    out = limit(wish, theta, volts, angle)
    if math.isfinite(wish):
        assert out == 0.0 or math.copysign(1, out) == math.copysign(1, wish)
        assert abs(out) <= abs(wish)
    else:
        assert out == 0.0


@NO_DEADLINE
@given(st.floats(allow_nan=False, allow_infinity=False), st.floats(-1.5, 1.5), VOLTAGE_LIMIT)
def test_inside_the_angle_limit_it_is_the_plain_clip(wish, theta, volts):
    assert limit(wish, theta, volts, 1.5) == min(max(wish, -volts), volts)


@NO_DEADLINE
@given(
    st.floats(allow_nan=False, allow_infinity=False).filter(lambda v: abs(v) > SMALLEST_V),
    st.floats(allow_nan=False, allow_infinity=False),
    VOLTAGE_LIMIT,
    ANGLE_LIMIT,
)
def test_beyond_the_angle_limit_only_volts_that_lead_back(wish, theta, volts, angle):
    out = limit(wish, theta, volts, angle)
    if abs(theta) > angle:
        away = (wish > 0) == (theta > 0)
        assert out == (0.0 if away else min(max(wish, -volts), volts))


@NO_DEADLINE
@given(ANY, ANY, VOLTAGE_LIMIT, ANGLE_LIMIT)
def test_mirrored_question_gives_the_mirrored_answer(wish, theta, volts, angle):
    assert limit(-wish, -theta, volts, angle) == -limit(wish, theta, volts, angle)


@NO_DEADLINE
@given(ANY, ANY, VOLTAGE_LIMIT, ANGLE_LIMIT)
def test_limiting_twice_changes_nothing(wish, theta, volts, angle):
    once = limit(wish, theta, volts, angle)
    assert limit(once, theta, volts, angle) == once


@pytest.mark.parametrize(
    ("wish", "theta", "expected"),
    [
        (math.nan, 0.0, 0.0),
        (-math.inf, 0.0, 0.0),
        (3.0, math.inf, 0.0),
        (3.0, math.nan, 0.0),
        (9.0, 0.0, 6.0),
        (-9.0, 0.0, -6.0),
        (2.5, 0.5, 2.5),  # exactly at the limit is inside
        (2.5, 0.51, 0.0),
        (-2.5, 0.51, -2.5),
        (-9.0, 0.51, -6.0),
        (2.5, -0.51, 2.5),
        (-2.5, -0.51, 0.0),
        (0.0, 0.51, 0.0),
    ],
)
def test_every_branch(wish, theta, expected):
    assert limit(wish, theta, 6.0, 0.5) == expected
    plain = getattr(limit, "py_func")  # noqa: B009, the same without the compiler
    assert plain(wish, theta, 6.0, 0.5) == expected
