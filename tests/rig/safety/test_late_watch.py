"""How late a link may be: the margin against the loop itself, and what counts as late."""

from dataclasses import replace
from math import atan, exp, inf, pi

import numpy as np
import pytest

from rig.parameters import Gains, Rig, Servo
from rig.safety.late_watch import (
    ADAPTER_S,
    LONGEST_ROUND_TRIP_S,
    LateWatch,
    delay_margin_s,
    longest_round_trip_s,
)

GAINS = [(21.42, 0.025), (21.42, 0.1), (21.42, 0.5), (5.0, 0.01), (60.0, 0.02), (400.0, 0.025)]


@pytest.mark.parametrize(("gain", "tau"), GAINS)
def test_the_margin_is_where_the_loop_has_no_phase_left(gain: float, tau: float):
    """|L(i w)| = 1 on a fine grid, and the phase that is left there, over w."""
    w = np.geomspace(0.01 * gain, 2.0 * gain, 400_000)
    crossover = w[np.argmin(np.abs(gain / (w * np.hypot(1.0, tau * w)) - 1.0))]
    left = 0.5 * pi - atan(tau * crossover)
    assert delay_margin_s(gain, tau) == pytest.approx(left / crossover, rel=1e-3)


def swing(gain: float, tau: float, delay_s: float, *, step_s: float = 2e-4) -> float:
    """Largest angle in the last second of twenty, over that in the second one, of the loop by
    itself, whose arm begins at 1 rad."""
    past = [1.0] * max(round(delay_s / step_s), 1)
    kept, theta, rate = exp(-step_s / tau), np.empty(round(20.0 / step_s)), 0.0
    angle = 1.0
    for k in range(len(theta)):
        seen = past[k % len(past)]
        past[k % len(past)] = angle
        rate = kept * rate - (1.0 - kept) * gain * seen
        angle += step_s * rate
        theta[k] = angle
    second = round(1.0 / step_s)
    return float(np.ptp(theta[-second:]) / np.ptp(theta[second : 2 * second]))


@pytest.mark.parametrize(("gain", "tau"), GAINS[:3])
def test_below_the_margin_the_loop_comes_to_rest_and_above_it_swings_up(gain: float, tau: float):
    margin_s = delay_margin_s(gain, tau)
    assert swing(gain, tau, 0.5 * margin_s) < 0.5
    assert swing(gain, tau, 0.95 * margin_s) < 1.0
    assert swing(gain, tau, 1.05 * margin_s) > 1.0


def test_a_loop_that_is_open_has_every_margin():
    assert delay_margin_s(0.0, 0.025) == inf
    assert longest_round_trip_s(Rig(gains=Gains(servo_proportional_V_rad=0.0))) == inf


def test_a_link_may_take_half_of_the_margin_and_always_what_an_adapter_keeps():
    rig = Rig()
    servo, gains = rig.servo, rig.gains
    k = servo.gain_rad_s_V * gains.servo_proportional_V_rad
    assert longest_round_trip_s(rig) == LONGEST_ROUND_TRIP_S
    assert pytest.approx(0.5 * delay_margin_s(k, servo.time_constant_s)) == LONGEST_ROUND_TRIP_S
    assert pytest.approx(0.029, abs=2e-4) == LONGEST_ROUND_TRIP_S
    twice = replace(gains, servo_proportional_V_rad=2 * gains.servo_proportional_V_rad)
    slow = Rig(servo=Servo(gain_rad_s_V=2 * servo.gain_rad_s_V), gains=gains)
    assert longest_round_trip_s(replace(rig, gains=twice)) == longest_round_trip_s(slow)
    stiff = replace(rig, gains=replace(gains, servo_proportional_V_rad=1e3))
    assert longest_round_trip_s(stiff) == ADAPTER_S == 0.016


def late_at(trips_ms, *, limit_ms: int = 30, tick_ms: int = 2) -> list[int]:
    """The ticks [ms] at which a link with these round trips, a tick each, counts as late."""
    watch = LateWatch(1e-3 * limit_ms)
    ticks = [k * tick_ms for k in range(len(trips_ms))]
    return [
        now for now, trip in zip(ticks, trips_ms, strict=True)
        if watch.is_late(1e-3 * trip, 1e-3 * now)
    ]  # fmt: skip


def test_late_is_above_the_limit_at_every_tick_of_as_long_a_time():
    assert late_at([31] * 17, limit_ms=32) == []
    assert late_at([30] * 100) == []  # at the limit
    assert late_at([3] * 5 + [33] * 17, limit_ms=32) == [42]  # 10 + 32
    assert late_at([33] * 18, limit_ms=32) == [32, 34]
    assert late_at([70] * 15 + [29] + [70] * 15) == []  # once in time
    assert late_at([70] * 15 + [29] + [70] * 17)[0] == 62
    assert late_at([500] + [3] * 100) == []
    assert LateWatch(inf).is_late(1e9, 1.0) is False


def test_it_says_how_late_and_what_is_allowed_and_the_cure_in_one_line():
    why = LateWatch(2.0).why(4.0, "use a wire")
    assert why == (
        "the round trip takes 4000 ms or more, longer than the 2000 ms that the servo loop's delay "
        "margin allows: use a wire"
    )
