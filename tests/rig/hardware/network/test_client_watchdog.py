"""The guard over a served table, tick by tick, without a network: when volts flow and when not."""

from math import exp, inf, nan, pi, radians

import numpy as np
import pytest

from rig.hardware.network.client_watchdog import ClientWatchdog
from rig.hardware.network.remote_wire import DriveRequest
from rig.hardware.wiring import Wiring
from rig.parameters import ANGLE_MARGIN_RAD, Rig, Servo
from rig.plant import plant, plant_record
from rig.table import Reading

T = 0.0  # the server's clock, so that differences are exact; the user's shows a second less
SERVO = Servo(angle_limit_rad=0.5)
ODD = Wiring(order=(1, 0))


def watchdog(*, homed: bool = True, armed: bool = True, limit_V: float = 6.0) -> ClientWatchdog:
    one = ClientWatchdog(limit_V, SERVO, 0.002)
    one.hear(T - 1.5, T - 0.5)
    one.configure(Wiring(), homed)
    if armed:
        one.arm(T)
    return one


def told(
    one: ClientWatchdog, x_V: float, y_V: float = 0.0, *, at_s: float = T, way_s: float = 0.0
) -> bool:
    """A command that arrives at `at_s`."""
    return one.obey(DriveRequest(0, at_s - 1.0 - way_s, 50, x_V, y_V), at_s)


def test_volts_flow_when_armed_and_told_and_last_50_ms():
    one = watchdog()
    assert one.volts((0.0, 0.0), T) == (0.0, 0.0)
    assert told(one, 1.0, -2.0)
    assert one.volts((0.0, 0.0), T) == (1.0, -2.0)
    assert one.volts((0.0, 0.0), T + 0.05) == (1.0, -2.0)
    assert one.volts((0.0, 0.0), T + 0.051) == (0.0, 0.0)
    assert one.armed
    assert told(one, 3.0, at_s=T + 0.06)
    assert one.volts((0.0, 0.0), T + 0.06) == (3.0, 0.0)


def test_none_flow_before_arming_after_disarming_and_of_an_arming_before():
    one = watchdog(armed=False)
    assert (one.armed, one.latched) == (False, False)
    told(one, 1.0)
    assert one.volts((0.2, 0.2), T) == (0.0, 0.0)
    one.arm(T + 0.01)
    assert one.volts((0.2, 0.2), T + 0.01) == (0.0, 0.0)
    told(one, 1.0, at_s=T + 0.02)
    one.disarm()
    assert one.volts((0.2, 0.2), T + 0.02) == (0.0, 0.0)
    assert not one.latched
    one.arm(T + 0.03)
    told(one, 1.0, at_s=T + 0.03)
    one.configure(ODD, True)
    assert (one.armed, one.homed, one.wiring) == (False, True, ODD)
    one.configure(ODD, False)
    assert not one.homed


@pytest.mark.parametrize("homed", [True, False])
def test_silence_of_100_ms_levels_for_half_a_second_and_latches(homed: bool):
    one = watchdog(homed=homed)
    told(one, 2.0)
    assert one.volts((0.1, -0.5), T + 0.1) == (0.0, 0.0)
    assert one.armed
    level = (pytest.approx(-1.4), 3.0) if homed else (0.0, 0.0)
    assert one.volts((0.1, -0.5), T + 0.101) == level
    assert (one.armed, one.latched) == (False, True)
    assert one.volts((0.1, -0.4), T + 0.13) == level
    told(one, 2.0, at_s=T + 0.14)
    assert one.volts((0.1, -0.3), T + 0.14) == level
    one.volts((0.1, 0.0), T + 0.2)
    assert one.volts((0.1, 0.0), T + 0.6) == ((pytest.approx(-1.4), 0.0) if homed else (0.0, 0.0))
    assert one.volts((0.1, 0.0), T + 0.602) == (0.0, 0.0)
    one.arm(T + 1.0)
    assert (one.armed, one.latched) == (True, False)
    assert one.volts((0.1, 0.0), T + 1.0) == (0.0, 0.0)


def test_arming_counts_as_a_word_and_goodbye_ends_levelling():
    one = watchdog()
    assert one.volts((0.1, 0.0), T + 0.1) == (0.0, 0.0)
    assert one.armed
    assert one.volts((0.1, 0.0), T + 0.101)[0] < 0.0
    one.disarm()
    assert one.volts((0.1, 0.0), T + 0.102) == (0.0, 0.0)
    one.stop(T + 0.2)  # nobody is armed: nothing to stop
    assert one.volts((0.1, 0.0), T + 0.2) == (0.0, 0.0)
    other = watchdog(armed=False)
    other.stop(T)
    assert not other.latched
    # Armed before anybody said what its channels mean.
    unheard_of = ClientWatchdog(6.0, SERVO, 0.002)
    assert unheard_of.wiring == Wiring()
    assert unheard_of.volts((0.2, 0.2), T) == (0.0, 0.0)
    unheard_of.arm(T)
    unheard_of.stop(T)
    assert unheard_of.volts((0.2, 0.2), T) == (0.0, 0.0)


def test_levelling_keeps_to_the_tables_limit_and_gives_up_on_an_arm_that_does_not_follow():
    one = watchdog(limit_V=2.5)
    one.stop(T)
    given = [one.volts((0.4, 0.0), T + 0.002 * k)[0] for k in range(60)]
    assert given[0] == given[30] == -2.5
    assert given[45:] == [0.0] * 15
    one.arm(T)
    one.stop(T)  # another stop, another try
    assert one.volts((0.4, 0.0), T + 0.499)[0] == -2.5
    assert one.volts((0.4, 0.0), T + 0.5)[0] == 0.0


@pytest.mark.parametrize(
    ("homed", "limit_V", "most"),
    [(True, 6.0, 6.0), (False, 6.0, 3.0), (False, 2.0, 2.0), (True, 2.0, 2.0)],
)
def test_volts_are_clamped(homed: bool, limit_V: float, most: float):
    one = watchdog(homed=homed, limit_V=limit_V)
    told(one, 9.0, -9.0)
    assert one.volts((0.0, 0.0), T) == (most, -most)


@pytest.mark.parametrize("side", [1, -1])
def test_beyond_the_limit_of_angle_only_volts_that_lead_back_pass(side: int):
    one, raw = watchdog(), watchdog(homed=False)
    braked = ((2, 0.5, 2), (2, 0.53, 1.5), (2, 0.55, -1.5), (-2, 0.55, -2), (2, -0.55, 2))
    for volts, theta, expected in braked:
        told(one, side * volts)
        told(raw, side * volts)
        assert one.volts((side * theta, 0.0), T) == pytest.approx((side * expected, 0.0))
        assert raw.volts((side * theta, 0.0), T) == (side * volts, 0.0)
        one, raw = watchdog(), watchdog(homed=False)


def test_an_arm_that_moves_is_braked_by_its_filtered_rate():
    """25 rad/s for a tick, then 5: what remains of 6 V is the room over 0.04 rad."""
    one = watchdog()
    stops, share = (0.023, 0.025, 9.18), 1 - exp(-0.002 / 0.02)
    assert one.volts((0.40, -0.40), T) == (0.0, 0.0)
    first = share * 25.0
    second = (1 - share) * first + share * 5.0
    for k, (theta, rate) in enumerate(((0.45, first), (0.46, second)), 1):
        told(one, 6.0, -6.0, at_s=T + 0.002 * k)
        way = rate * stops[0] + stops[1] * rate**2 / (2 * stops[2] + rate)
        right = 6.0 * max(min((0.54 - theta - way) / 0.04, 1.0), -1.0)
        assert one.volts((theta, -theta), T + 0.002 * k) == pytest.approx((right, -right))
        assert -6.0 < right < 6.0
    again = one.volts((0.46, -0.46), T + 0.004)  # the same moment: no rate of its own
    assert again == pytest.approx((right, -right))


def test_full_volts_asked_for_ever_never_reach_the_stop():
    """On the plant, with an encoder: whatever the user's program allows itself."""
    rig, one = Rig(), ClientWatchdog(6.0, Servo(), 0.002)
    one.configure(Wiring(), True)
    one.arm(T)
    p, s, history = plant_record.pack(rig), plant.rest(), plant_record.no_volts(rig)
    widest = 0.0
    for k in range(1000):
        now_s = T + 0.002 * k
        assert told(one, 6.0, at_s=now_s)
        theta = 2 * pi / 4096 * round(s[plant.ARM, 0] / (2 * pi / 4096))
        history[1:] = history[:-1].copy()
        history[0] = one.volts((theta, 0.0), now_s)
        plant.advance(s, p, history, now_s, 0.002, 0.0, 0.0, True, np.inf, np.full(7, np.nan))
        widest = max(widest, abs(s[plant.ARM, 0]))
    assert widest < rig.servo.angle_limit_rad + ANGLE_MARGIN_RAD / 2 + radians(0.5)
    assert widest < rig.servo.stop_rad - radians(2.0)


def watched(one: ClientWatchdog, angles, volts: float) -> list[tuple[float, float]]:
    """Volts of the ticks of a table whose encoder x shows these angles, armed, told `volts`."""
    given = []
    for k, theta in enumerate(angles):
        now_s = T + 0.002 * k
        one.watch(Reading(now_s, (theta, 0.0)), now_s)
        told(one, volts, at_s=now_s)
        given.append(one.volts((theta, 0.0), now_s))
    return given


@pytest.mark.parametrize("homed", [True, False])
def test_a_frozen_encoder_or_a_blocked_arm_takes_the_volts_within_100_ms(homed: bool):
    """Nor is the plate levelled by such an encoder."""
    one = watchdog(homed=homed)
    given = watched(one, [0.1] * 100, 3.0)
    assert given[10] == (3.0, 0.0)
    assert given[45:] == [(0.0, 0.0)] * 55
    assert (one.armed, one.latched) == (False, True)
    assert one.watch(Reading(T + 0.2, (0.1, 0.0)), T + 0.2) is None  # said once
    one.arm(T + 0.3)
    assert not one.armed  # it rests
    one.arm(T + 1.3)
    assert one.watch(Reading(T + 1.3, (0.1, 0.0)), T + 1.3) is None  # the watch begins anew
    assert one.armed


@pytest.mark.parametrize("every", [1, 10, 49])
def test_a_user_who_arms_again_and_again_takes_nothing_from_the_monitor(every: int):
    """A blocked arm got full volts for ever: every arming began the watch anew."""
    one, given = watchdog(), []
    for k in range(500):
        now_s = T + 0.002 * k
        if k % every == 0:
            one.arm(now_s)
        one.watch(Reading(now_s, (0.1, 0.0)), now_s)
        told(one, 6.0, at_s=now_s)
        given.append(one.volts((0.1, 0.0), now_s)[0])
    assert given[10] == 6.0
    assert np.count_nonzero(given) <= 50  # 100 ms of a second


def test_a_table_that_showed_a_fault_rests_for_a_second():
    one, now_s, fault = watchdog(), T, None
    while fault is None:
        now_s += 0.002
        fault = one.watch(Reading(now_s, (0.1, 0.0)), now_s)
        told(one, 6.0, at_s=now_s)
        one.volts((0.1, 0.0), now_s)
    one.arm(now_s + 0.999)
    assert not one.armed
    one.arm(now_s + 1.0)
    assert one.armed


def test_a_jump_of_the_encoder_takes_the_volts_at_once():
    one = watchdog()
    assert watched(one, [0.0, 0.01, 0.35], 1.0) == [(1.0, 0.0)] * 2 + [(0.0, 0.0)]
    assert (one.armed, one.latched) == (False, True)
    fault = watchdog().watch(Reading(nan, (0.0, 0.0)), T)
    assert fault is not None
    assert fault.name == "no number"


def test_an_arm_far_beyond_its_limit_is_led_back_to_level():
    one, raw = watchdog(), watchdog(homed=False)
    out = [0.019 * k for k in range(32)]
    assert watched(one, out, 1.0)[-1][0] < 0.0
    assert (one.armed, one.latched) == (False, True)
    assert watched(raw, out, 1.0)[-1] == (1.0, 0.0)  # nobody knows where its limit is


def test_an_arm_that_follows_is_left_alone():
    one = watchdog()
    assert watched(one, [0.004 * (k % 100) for k in range(90)], 3.0)[-1] == (3.0, 0.0)
    assert one.armed
    asleep = watchdog(armed=False)
    assert asleep.watch(Reading(T, (0.0, 0.0)), T) is None
    assert asleep.watch(Reading(T + 0.002, (0.4, 0.0)), T + 0.002) is None  # moved by hand
    assert not asleep.latched


def test_what_was_long_on_its_way_is_old_or_no_number_is_not_obeyed():
    one = watchdog()
    assert told(one, 1.0, at_s=T + 0.05, way_s=0.05) is True
    assert told(one, 2.0, at_s=T + 0.06, way_s=0.051) is False
    assert not told(one, 2.0, at_s=T + 0.06, way_s=0.051)  # the same again
    assert not told(one, 2.0, at_s=T + 0.07, way_s=0.069)  # overtaken
    for k, bad in enumerate(((nan, 1.0), (1.0, nan), (inf, 1.0), (1.0, -inf))):
        assert not told(one, *bad, at_s=T + 0.08 + 0.001 * k)
    assert one.stale == 7
    assert one.volts((0.0, 0.0), T + 0.09) == (1.0, 0.0)
    assert one.volts((0.0, 0.0), T + 0.11) == (0.0, 0.0)  # none of these was a word
    one.volts((0.0, 0.0), T + 0.16)
    assert one.latched


@pytest.mark.parametrize("sent_s", [nan, inf, -inf])
def test_a_command_sent_at_no_time_is_not_obeyed_and_leaves_the_clocks_alone(sent_s: float):
    one = watchdog()
    assert not one.obey(DriveRequest(0, sent_s, 50, 5.0, 5.0), T + 0.04)
    assert one.volts((0.0, 0.0), T + 0.041) == (0.0, 0.0)
    assert told(one, 1.0, at_s=T + 0.05)


def test_a_new_user_has_a_clock_of_their_own():
    one = watchdog()
    assert one.hear(T - 51.0, T) == inf
    one.meet()
    assert one.hear(T - 51.0, T) == 0.0
    assert one.hear(T - 51.0, T) == inf
    assert one.hear(T - 50.96, T + 0.06) == pytest.approx(0.02)
