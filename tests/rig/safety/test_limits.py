"""The one clamp: properties that hold for every float there is."""

import inspect
import math
import sys

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from rig.course import Course
from rig.parameters import Gains, Rig
from rig.safety.limits import LOOK_AHEAD_S, STALE_S, limit
from tests.support.limiter_laws import laws
from tests.support.simulated import run


def clip(wish, theta, volts, angle):
    """The limiter at rest, without a slew limit: volts and angle alone."""
    return limit(wish, theta, 0.0, 0.0, volts, angle, math.inf)


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
def test_what_comes_out_is_finite_and_within_the_clip(wish, theta, volts, angle):
    out = clip(wish, theta, volts, angle)
    assert math.isfinite(out)
    assert abs(out) <= volts


@NO_DEADLINE
@given(ANY, ANY, VOLTAGE_LIMIT, ANGLE_LIMIT)
def test_anything_unclear_is_zero(wish, theta, volts, angle):
    if not (math.isfinite(wish) and math.isfinite(theta)):
        assert clip(wish, theta, volts, angle) == 0.0


@NO_DEADLINE
@given(ANY, ANY, VOLTAGE_LIMIT, ANGLE_LIMIT)
def test_sign_never_turns_and_size_never_grows(wish, theta, volts, angle):
    out = clip(wish, theta, volts, angle)
    if math.isfinite(wish):
        assert out == 0.0 or math.copysign(1, out) == math.copysign(1, wish)
        assert abs(out) <= abs(wish)
    else:
        assert out == 0.0


@NO_DEADLINE
@given(st.floats(allow_nan=False, allow_infinity=False), st.floats(-1.5, 1.5), VOLTAGE_LIMIT)
def test_inside_the_angle_limit_it_is_the_plain_clip(wish, theta, volts):
    assert clip(wish, theta, volts, 1.5) == min(max(wish, -volts), volts)


@NO_DEADLINE
@given(
    st.floats(allow_nan=False, allow_infinity=False).filter(lambda v: abs(v) > SMALLEST_V),
    st.floats(allow_nan=False, allow_infinity=False),
    VOLTAGE_LIMIT,
    ANGLE_LIMIT,
)
def test_beyond_the_angle_limit_only_volts_that_lead_back(wish, theta, volts, angle):
    out = clip(wish, theta, volts, angle)
    if abs(theta) > angle:
        away = (wish > 0) == (theta > 0)
        assert out == (0.0 if away else min(max(wish, -volts), volts))


@NO_DEADLINE
@given(ANY, ANY, VOLTAGE_LIMIT, ANGLE_LIMIT)
def test_mirrored_question_gives_the_mirrored_answer(wish, theta, volts, angle):
    assert clip(-wish, -theta, volts, angle) == -clip(wish, theta, volts, angle)


@NO_DEADLINE
@given(ANY, ANY, VOLTAGE_LIMIT, ANGLE_LIMIT)
def test_limiting_twice_changes_nothing(wish, theta, volts, angle):
    once = clip(wish, theta, volts, angle)
    assert clip(once, theta, volts, angle) == once


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
    assert clip(wish, theta, 6.0, 0.5) == expected
    plain = getattr(limit, "py_func")  # noqa: B009, the same without the compiler
    assert plain(wish, theta, 0.0, 0.0, 6.0, 0.5, math.inf) == expected


def test_the_whole_promise_on_a_grid_compiled_and_plain():
    laws(limit)
    laws(getattr(limit, "py_func"))  # noqa: B009


@NO_DEADLINE
@given(ANY, ANY, ANY, ANY, ANY.filter(lambda age_s: not age_s <= STALE_S))
def test_a_stale_estimate_is_zero(wish, theta, rate, last, age_s):
    assert limit(wish, theta, rate, last, 6.0, 0.5, 3.0, age_s) == 0.0


def test_the_grid_runs_every_line_and_both_ways_of_every_branch():
    plain = getattr(limit, "py_func")  # noqa: B009
    lines = {line for *_, line in plain.__code__.co_lines() if line}
    seen, steps, last = set(), set(), [0]

    def trace(frame, what, _):
        if frame.f_code is not plain.__code__:
            return None
        if what == "line":
            steps.add((last[0], frame.f_lineno))
            seen.add(frame.f_lineno)
        last[0] = frame.f_lineno if what == "line" else 0
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        laws(plain)
    finally:
        sys.settrace(before)
    source, first = inspect.getsourcelines(plain)
    body = {line for line in lines if line > first + source.index('    """\n')}
    assert body <= seen
    branches = [first + i for i, text in enumerate(source) if text.strip().startswith("if ")]
    assert len(branches) == 3
    for line in branches:
        assert len({to for at, to in steps if at == line}) == 2


class AnySequence(RuleBasedStateMachine):
    """Any sequence of wishes, angles, rates and ages: the volts obey every limit at every step."""

    @initialize(volts=VOLTAGE_LIMIT, angle=ANGLE_LIMIT, slew=st.floats(1e-3, 100))
    def begin(self, volts, angle, slew):
        self.most, self.angle, self.slew = volts, angle, slew
        self.now = self.before = 0.0
        self.beyond = False

    @rule(wish=ANY, theta=ANY, rate=ANY, age_s=st.floats(0.0, 2 * STALE_S) | ANY)
    def anything(self, wish, theta, rate, age_s):
        self.step(wish, theta, rate, age_s)

    @rule(wish=st.floats(-20, 20), theta=st.floats(-2, 2), rate=st.floats(-30, 30))
    def likely(self, wish, theta, rate):
        self.step(wish, theta, rate, 0.0)

    def step(self, wish, theta, rate, age_s):
        bounds = self.most, self.angle, self.slew
        self.before = self.now
        self.now = limit(wish, theta, rate, self.before, *bounds, age_s)
        clear = math.isfinite(wish) and math.isfinite(theta) and math.isfinite(rate)
        if not (clear and age_s <= STALE_S):
            assert self.now == 0.0
        elif self.now != 0.0:
            assert (self.now > 0) == (wish > 0)
            assert abs(self.now) <= abs(wish)
            ahead = theta + LOOK_AHEAD_S * rate
            assert max(math.copysign(1, self.now) * a for a in (theta, ahead)) <= self.angle

    @invariant()
    def within(self):
        if hasattr(self, "now"):
            assert math.isfinite(self.now)
            assert abs(self.now) <= self.most
            same = self.now * self.before > 0
            assert abs(self.now) <= (abs(self.before) if same else 0.0) + self.slew


AnySequence.TestCase.settings = settings(deadline=None, max_examples=60, stateful_step_count=40)
TestAnySequence = AnySequence.TestCase


FINITE = st.floats(-1e6, 1e6)


@NO_DEADLINE
@given(ANY, FINITE, FINITE, FINITE, VOLTAGE_LIMIT, ANGLE_LIMIT, st.floats(1e-3, 100))
def test_size_grows_by_the_slew_at_most_and_may_always_fall(w, theta, rate, last, v, angle, slew):
    out = limit(w, theta, rate, last, v, angle, slew)
    assert abs(out) <= max(abs(last), 0.0) + slew
    if out * last < 0:
        assert abs(out) <= slew
    assert limit(0.0, theta, rate, last, v, angle, slew) == 0.0


@NO_DEADLINE
@given(FINITE, FINITE, FINITE, FINITE, st.sampled_from([math.nan, math.inf, -math.inf]))
def test_an_unknown_rate_or_last_voltage_is_zero(wish, theta, rate, last, bad):
    assert limit(wish, theta, bad, last, 6.0, 0.5, 3.0) == 0.0
    assert limit(wish, theta, rate, bad, 6.0, 0.5, 3.0) == 0.0


@NO_DEADLINE
@given(st.floats(-0.5, 0.5), st.floats(-30, 30), st.floats(-6, 6))
def test_an_arm_that_is_about_to_pass_the_limit_is_not_pushed_further(theta, rate, wish):
    out = limit(wish, theta, rate, 0.0, 6.0, 0.5, 12.0)
    ahead = theta + LOOK_AHEAD_S * rate
    if ahead > 0.5:
        assert out <= 0.0
    elif ahead < -0.5:
        assert out >= 0.0
    else:
        assert out == wish


def test_full_volts_end_before_the_stop():
    """Whatever is asked, the servo does not reach its mechanical stop."""
    n = 1500
    wild = np.where((np.arange(n)[:, None] // 300) % 2 == 0, 30.0, -30.0) * np.ones((n, 2))
    way = Course(wild, np.zeros((n, 2)), (0.0, 0.0), 0.0, True)
    log = run(Rig(gains=Gains(servo_proportional_V_rad=1e3)), 0, way, 0).log
    assert np.abs(log["theta_x_rad"]).max() > 0.4
    assert np.abs(log["theta_x_rad"]).max() < Rig().servo.stop_rad - 0.02
