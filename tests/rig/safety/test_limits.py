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
from rig.parameters import Gains, Rig, Servo
from rig.plant import plant, plant_record
from rig.safety import limits
from rig.safety.limits import STALE_S, TAPER_RAD, Braking, braking, free_rate, limit
from tests.support import limiter_laws
from tests.support.limiter_laws import laws
from tests.support.simulated import run

STOPS = Braking(*limiter_laws.STOPS)


def clip(wish, theta, volts, angle):
    """The limiter at rest, without a slew limit: volts and angle alone."""
    return limit(wish, theta, 0.0, 0.0, volts, angle, math.inf, STOPS)


ANY = st.floats(allow_nan=True, allow_infinity=True, width=64)
VOLTAGE_LIMIT = st.floats(1e-3, 1e3)
ANGLE_LIMIT = st.floats(1e-3, 1.5)


@given(ANY, ANY, VOLTAGE_LIMIT, ANGLE_LIMIT)
@example(math.nan, 0.0, 6.0, 0.5)
@example(math.inf, 0.0, 6.0, 0.5)
@example(1.0, math.nan, 6.0, 0.5)
@example(1.0, -math.inf, 6.0, 0.5)
def test_what_comes_out_is_finite_and_within_the_clip(wish, theta, volts, angle):
    out = clip(wish, theta, volts, angle)
    assert math.isfinite(out)
    assert abs(out) <= volts


@given(ANY, ANY, VOLTAGE_LIMIT, ANGLE_LIMIT)
def test_anything_unclear_is_zero(wish, theta, volts, angle):
    if not (math.isfinite(wish) and math.isfinite(theta)):
        assert clip(wish, theta, volts, angle) == 0.0


@given(st.floats(-1e9, 1e9), st.floats(-2, 2), st.floats(-30, 30), VOLTAGE_LIMIT, ANGLE_LIMIT)
def test_more_than_was_asked_is_given_for_braking_alone(wish, theta, rate, volts, angle):
    out = limit(wish, theta, rate, 0.0, volts, angle, math.inf, STOPS)
    if out * wish < 0.0 or abs(out) > abs(wish):
        outwards = -math.copysign(1.0, out)
        assert outwards * theta + max(outwards * rate, 0.0) > angle - TAPER_RAD
        assert outwards * out < 0.0


@given(st.floats(allow_nan=False, allow_infinity=False), st.floats(-1.4, 1.4), VOLTAGE_LIMIT)
def test_inside_the_angle_limit_it_is_the_plain_clip(wish, theta, volts):
    assert clip(wish, theta, volts, 1.5) == min(max(wish, -volts), volts)


@given(st.floats(-1e9, 1e9), st.floats(-1e9, 1e9), VOLTAGE_LIMIT, st.floats(TAPER_RAD, 1.5))
def test_beyond_the_angle_limit_only_volts_that_lead_back(wish, theta, volts, angle):
    out = clip(wish, theta, volts, angle)
    if abs(theta) > angle:
        back = -math.copysign(1.0, theta)
        assert back * out >= 0.0
        assert back * out >= min(back * wish, volts)


@given(ANY, ANY, VOLTAGE_LIMIT, ANGLE_LIMIT)
def test_mirrored_question_gives_the_mirrored_answer(wish, theta, volts, angle):
    assert clip(-wish, -theta, volts, angle) == -clip(wish, theta, volts, angle)


@given(st.floats(-1e9, 1e9), ANY, VOLTAGE_LIMIT, ANGLE_LIMIT)
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
        (2.5, 0.46, 2.5),
        (9.0, 0.48, 3.0),  # half of the last 0.04 rad: half the volts
        (9.0, 0.5, 0.0),
        (9.0, 0.51, -1.5),  # led back
        (-2.5, 0.51, -2.5),
        (-9.0, 0.51, -6.0),
        (9.0, 0.54, -6.0),
        (9.0, 0.9, -6.0),
        (-9.0, -0.48, -3.0),
        (2.5, -0.51, 2.5),
        (-2.5, -0.51, 1.5),
        (0.0, 0.51, -1.5),
    ],
)
def test_every_branch(wish, theta, expected):
    assert clip(wish, theta, 6.0, 0.5) == pytest.approx(expected)
    plain = getattr(limit, "py_func")  # noqa: B009, the same without the compiler
    assert plain(wish, theta, 0.0, 0.0, 6.0, 0.5, math.inf, STOPS) == pytest.approx(expected)


def test_ticks_that_come_late_are_reckoned_with():
    limiter_laws.late_laws(limits)


def test_the_whole_promise_on_a_grid_compiled_and_plain():
    laws(limit, STOPS)
    laws(getattr(limit, "py_func"), STOPS)  # noqa: B009


@given(ANY, ANY, ANY, ANY, ANY.filter(lambda age_s: not age_s <= STALE_S))
def test_a_stale_estimate_is_zero(wish, theta, rate, last, age_s):
    assert limit(wish, theta, rate, last, 6.0, 0.5, 3.0, STOPS, age_s) == 0.0


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
        laws(plain, STOPS)
    finally:
        sys.settrace(before)
    source, first = inspect.getsourcelines(plain)
    body = {line for line in lines if line > first + source.index('    """\n')}
    assert body <= seen
    branches = [first + i for i, text in enumerate(source) if text.strip().startswith("if ")]
    assert len(branches) == 1
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
        self.now = limit(wish, theta, rate, self.before, *bounds, STOPS, age_s)
        clear = math.isfinite(wish) and math.isfinite(theta) and math.isfinite(rate)
        if not (clear and age_s <= STALE_S):
            assert self.now == 0.0

    @invariant()
    def within(self):
        if hasattr(self, "now"):
            assert math.isfinite(self.now)
            assert abs(self.now) <= self.most
            same = self.now * self.before > 0
            assert abs(self.now) <= (abs(self.before) if same else 0.0) + self.slew


AnySequence.TestCase.settings = settings(max_examples=60, stateful_step_count=40)
TestAnySequence = AnySequence.TestCase


FINITE = st.floats(-1e6, 1e6)


@given(ANY, FINITE, FINITE, FINITE, VOLTAGE_LIMIT, ANGLE_LIMIT, st.floats(1e-3, 100))
def test_size_grows_by_the_slew_at_most_and_may_always_fall(w, theta, rate, last, v, angle, slew):
    out = limit(w, theta, rate, last, v, angle, slew, STOPS)
    assert abs(out) <= max(abs(last), 0.0) + slew
    if out * last < 0:
        assert abs(out) <= slew


@given(FINITE, FINITE, FINITE, FINITE, st.sampled_from([math.nan, math.inf, -math.inf]))
def test_an_unknown_rate_or_last_voltage_is_zero(wish, theta, rate, last, bad):
    assert limit(wish, theta, bad, last, 6.0, 0.5, 3.0, STOPS) == 0.0
    assert limit(wish, theta, rate, bad, 6.0, 0.5, 3.0, STOPS) == 0.0


def beyond_deg(tau_s: float, asked, seconds: float, gear_deg: float, joint_deg: float = 0.0):
    """How far arm x passes its limit [degrees] on the plant, with the loop's own encoder and rates,
    while asked(t) volts are wished for; gear_deg, joint_deg: play, unknown to the limiter."""
    effects = {
        "gear_backlash": {"x": {"play_rad": math.radians(gear_deg)}},
        "joint_backlash": {"x": {"play_rad": math.radians(joint_deg)}},
    }
    rig = Rig(servo=Servo(time_constant_s=tau_s), effects=effects)
    p, s, history = plant_record.pack(rig), plant.rest(), plant_record.no_volts(rig)
    tick_s, count = 1 / rig.control_rate_hz, 2 * math.pi / rig.servo.encoder_counts_per_rev
    stops = braking(rig.servo, tick_s, rig.gains.torque_filter_s)
    gain, kept = rig.servo.gain_rad_s_V, math.exp(-tick_s / tau_s)
    decay = math.exp(-tick_s / rig.gains.torque_filter_s)
    last = rate = angle = widest = free = 0.0
    for k in range(round(seconds / tick_s)):
        was, angle = angle, count * round(s[plant.ARM, 0] / count)
        rate = decay * rate + (1 - decay) * (angle - was) / tick_s
        free = free_rate(free, last, gain, kept)
        limits = 6.0, rig.servo.angle_limit_rad, 3.0, stops, 0.0, free
        last = limit(asked(k * tick_s), angle, rate, last, *limits)
        history[1:] = history[:-1].copy()
        history[0] = last, 0.0
        plant.advance(s, p, history, k * tick_s, tick_s, 0.0, 0.0, True, np.inf, np.full(7, np.nan))
        widest = max(widest, abs(s[plant.ARM, 0]))
    return math.degrees(widest - rig.servo.angle_limit_rad)


@pytest.mark.parametrize("tau_s", [0.01, 0.025, 0.04, 0.06, 0.1, 0.2, 0.5])
@pytest.mark.parametrize("swing", [False, True])
@pytest.mark.parametrize("play_deg", [0.0, 1.0, 3.0])
def test_full_volts_pass_the_angle_limit_by_half_a_degree_at_most(tau_s, swing, play_deg):
    """Asked for ever, or turned about. In the play of its gears the motor gathers speed that no
    encoder shows."""
    half_s = 0.002 * int(max(60, 3000 * tau_s))

    def asked(t_s: float) -> float:
        return -1e308 if swing and int(t_s / half_s + 1e-6) % 2 else 1e308

    over_deg = beyond_deg(tau_s, asked, 3.0, play_deg)
    assert over_deg < 0.5
    assert over_deg > -1.0 or swing  # the angles up to the limit can be used


@pytest.mark.slow
@pytest.mark.parametrize("tau_s", [0.01, 0.025, 0.06, 0.1, 0.2, 0.5])
@pytest.mark.parametrize("plays_deg", [(0.0, 3.0), (1.0, 0.0), (3.0, 0.0), (3.0, 3.0)])
def test_no_sine_and_no_square_of_full_volts_passes_it_by_more(tau_s, plays_deg):
    for hertz in (0.0, 0.3, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0):

        def sine(t_s: float, hertz: float = hertz) -> float:
            return 6.0 * math.sin(2 * math.pi * hertz * t_s) if hertz else 6.0

        def square(t_s: float, hertz: float = hertz) -> float:
            return math.copysign(6.0, sine(t_s, hertz))

        assert beyond_deg(tau_s, sine, 5.0, *plays_deg) < 0.5, hertz
        assert beyond_deg(tau_s, square, 5.0, *plays_deg) < 0.5, hertz


def test_full_volts_end_before_the_stop():
    """Whatever is asked, the servo does not reach its mechanical stop."""
    n = 1500
    wild = np.where((np.arange(n)[:, None] // 300) % 2 == 0, 30.0, -30.0) * np.ones((n, 2))
    way = Course(wild, np.zeros((n, 2)), (0.0, 0.0), 0.0, True)
    play = {"gear_backlash": {axis: {"play_rad": math.radians(3.0)} for axis in "xy"}}
    log = run(Rig(gains=Gains(servo_proportional_V_rad=1e3), effects=play), 0, way, 0).log
    assert np.abs(log["theta_x_rad"]).max() > 0.4
    assert np.abs(log["theta_x_rad"]).max() < Rig().servo.angle_limit_rad + math.radians(0.5)
