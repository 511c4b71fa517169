"""The guard over a served table, tick by tick, without a network: when volts flow and when not."""

from contextlib import suppress
from math import degrees, exp, inf, isnan, nan, pi, sin

import numpy as np
import pytest

from rig.hardware.network.client_watchdog import ClientWatchdog
from rig.hardware.network.remote_wire import DriveRequest
from rig.hardware.wiring import Wiring
from rig.parameters import Rig, Servo
from rig.plant import plant, plant_record
from rig.safety.monitor import MonitorLimits
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
    assert one.volts((0.2, 0.2), T + 0.03) == (0.0, 0.0)


def test_channels_are_named_while_the_table_rests():
    """Else a user who names them anew would set a flying arm free, and the monitor's watch back."""
    one = watchdog()
    told(one, 1.0)
    one.volts((0.1, 0.1), T)
    for _ in range(2):
        with pytest.raises(ValueError, match="named while the table moved"):
            one.configure(ODD, False)
        one.disarm()
    assert (one.wiring, one.homed) == (Wiring(), True)
    caught_s = 0.5 + 5 * SERVO.time_constant_s
    assert not one.rests(T + 0.999 * caught_s)
    assert one.rests(T + caught_s)
    one.volts((0.1, 0.1), T + caught_s)
    one.disarm()  # who holds nothing ends nothing
    one.configure(ODD, True)
    assert (one.armed, one.homed, one.wiring) == (False, True, ODD)
    one.configure(ODD, False)
    assert not one.homed


@pytest.mark.parametrize("zero_rad", [0.46, -25.0])
def test_another_zero_is_no_motion(zero_rad: float):
    """Else the first armed ticks brake an arm that stands still, with 6 V."""
    one = ClientWatchdog(6.0, Rig().servo, 0.002)
    for k in range(5):
        one.volts((zero_rad, 0.0), T + 0.002 * k)
    one.configure(Wiring(), True)
    one.arm(T + 0.01)
    for k in range(5, 60):
        assert told(one, 0.0, at_s=T + 0.002 * k)
        assert one.volts((0.0, 0.0), T + 0.002 * k) == (0.0, 0.0)


@pytest.mark.parametrize("beyond", [0.77, -1.59, 3e6, nan])
def test_zeros_by_which_an_arm_is_beyond_its_stops_give_no_volts(beyond: float):
    """Else it is "led back" by full volts, into its stop."""
    one = watchdog()
    for k in range(3):
        assert told(one, 0.0, at_s=T + 0.002 * k)
        assert one.volts((0.0, beyond), T + 0.002 * k) == (0.0, 0.0)
    fault = one.watch(Reading(T + 0.006, (beyond, 0.0), None, None), T + 0.006)
    assert fault is not None
    assert not fault.level
    assert isnan(beyond) or "zero was named: home" in fault.reason
    for k in range(4, 500):
        assert one.volts((beyond, 0.0), T + 0.002 * k) == (0.0, 0.0)
    assert not one.armed


def test_an_arm_at_the_edge_of_what_can_be_is_led_back():
    one, edge_rad = watchdog(), MonitorLimits.of_servo(SERVO, 0.002).angle_rad
    assert one.volts((edge_rad, 0.0), T) == (-6.0, 0.0)


def test_other_zeros_have_to_prove_true_anew():
    one = watchdog(armed=False)
    one.volts((0.1, 0.0), T)
    one.configure(ODD, True)
    one.arm(T + 0.002)
    assert told(one, 1.0, at_s=T + 0.002)
    assert one.volts((0.0, -0.9), T + 0.002) == (0.0, 0.0)


def test_a_motor_in_the_play_of_its_gears_is_braked_unseen():
    """Its arm rests where 6 V may be had; after 30 ms it would be struck at more than 4 rad/s."""
    one, given = watchdog(), []
    for k in range(16):
        assert told(one, 6.0, at_s=T + 0.002 * k)
        given.append(one.volts((0.36, 0.0), T + 0.002 * k)[0])
    assert given[:6] == [6.0] * 6
    w, kept = 0.0, exp(-0.002 / SERVO.time_constant_s)
    for volts in given[:-1]:
        w = kept * w + (1 - kept) * SERVO.gain_rad_s_V * volts
    assert w > 4.0
    top, delay_s = SERVO.gain_rad_s_V * 6.0, 0.02 + 1.5 * 0.002
    room = 0.5 - 0.36 - w * delay_s - SERVO.time_constant_s * w**2 / (2 * top + w)
    assert given[-1] == pytest.approx(6.0 * room / 0.04)


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
    braked = ((2, 0.46, 2), (2, 0.49, 1.5), (2, 0.51, -1.5), (-2, 0.51, -2), (2, -0.51, 2))
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
    assert one.volts((0.36, -0.36), T) == (0.0, 0.0)
    first = share * 25.0
    second = (1 - share) * first + share * 5.0
    for k, (theta, rate) in enumerate(((0.41, first), (0.42, second)), 1):
        told(one, 6.0, -6.0, at_s=T + 0.002 * k)
        way = rate * stops[0] + stops[1] * rate**2 / (2 * stops[2] + rate)
        right = 6.0 * max(min((0.50 - theta - way) / 0.04, 1.0), -1.0)
        assert one.volts((theta, -theta), T + 0.002 * k) == pytest.approx((right, -right))
        assert -6.0 < right < 6.0
    again = one.volts((0.42, -0.42), T + 0.004)  # the same moment: no rate of its own
    assert again == pytest.approx((right, -right))


def named_anew(one: ClientWatchdog, homed: bool) -> None:
    """As the server does it: who names channels while the table moves is sent away."""
    with suppress(ValueError):
        one.configure(Wiring(), homed)
    one.stop(one._now_s)


LEAVES = {
    "goes on": lambda one: None,
    "falls silent": lambda one: None,
    "says goodbye": lambda one: one.disarm(),
    "stops": lambda one: one.stop(one._now_s),
    "names the channels": lambda one: named_anew(one, True),
    "says that nothing is homed": lambda one: named_anew(one, False),
    "arms again": lambda one: one.arm(one._now_s),
}


def beyond_deg(tau_s: float, hertz: float, leaves: str, at_s: float) -> float:
    """How far [degrees] beyond its limit an arm of the plant, seen by its encoder, goes under full
    volts to and fro (hertz; 0: one way) by a user who leaves at `at_s` [s], the wildest way there
    is, or not at all."""
    servo = Servo(time_constant_s=tau_s)
    rig, one = Rig(servo=servo), ClientWatchdog(6.0, servo, 0.002)
    one.configure(Wiring(), True)
    one.arm(T)
    p, s, history = plant_record.pack(rig), plant.rest(), plant_record.no_volts(rig)
    widest = 0.0
    for k in range(round((at_s + 1.0 + 6 * tau_s) / 0.002)):
        now_s = T + 0.002 * k
        if leaves == "goes on" or now_s < T + at_s:
            assert told(one, 6.0 if sin(2 * pi * hertz * k * 0.002) >= 0.0 else -6.0, at_s=now_s)
        elif not one.rests(now_s):
            LEAVES[leaves](one)
        theta = 2 * pi / 4096 * round(s[plant.ARM, 0] / (2 * pi / 4096))
        one.watch(Reading(now_s, (theta, 0.0)), now_s)
        history[1:] = history[:-1].copy()
        history[0] = one.volts((theta, 0.0), now_s)
        plant.advance(s, p, history, now_s, 0.002, 0.0, 0.0, True, np.inf, np.full(7, np.nan))
        widest = max(widest, abs(s[plant.ARM, 0]))
    return degrees(widest - servo.angle_limit_rad)


# Of a search over 0.3 to 4 Hz: where an arm that nobody caught went furthest, up to its stop.
FURTHEST_HZ = {0.01: 0.3, 0.025: 1.5, 0.06: 2.0, 0.2: 1.2, 0.5: 0.7}


@pytest.mark.parametrize("leaves", LEAVES)
@pytest.mark.parametrize("tau_s", FURTHEST_HZ)
def test_whatever_a_user_does_the_angle_limit_holds(tau_s: float, leaves: str):
    for hertz in (0.0, FURTHEST_HZ[tau_s]):
        worst = max(beyond_deg(tau_s, hertz, leaves, 0.4 + 0.11 * k) for k in range(8))
        assert worst < 0.5


@pytest.mark.parametrize("ends", ["says goodbye", "stops"])
def test_an_arm_that_is_blocked_while_it_is_caught_gets_volts_for_100_ms(ends: str):
    one = watchdog()
    given = watched(one, [0.03 * k for k in range(18)], 6.0)
    LEAVES[ends](one)
    for k in range(18, 200):  # beyond its limit, where braking pulls it back, and nothing moves
        now_s = T + 0.002 * k
        one.watch(Reading(now_s, (0.54, 0.0)), now_s)
        given.append(one.volts((0.54, 0.0), now_s)[0])
    assert min(given[18:]) < -3.0
    assert given[18 + 52 :] == [0.0] * (182 - 52)
    one.arm(T + 0.4)
    assert not one.armed  # it rests


def test_an_arm_that_is_led_back_from_far_beyond_is_watched_on():
    """Being there is no fault of a table that is levelled already; a jump of its encoder is."""
    one, found, given = watchdog(), [], []
    out = [0.019 * k for k in range(32)]
    back = [0.589 - 0.004 * k for k in range(60)]
    for k, theta in enumerate([*out, *back, -0.4, -0.4]):
        now_s = T + 0.002 * k
        told(one, 1.0, at_s=now_s)
        found.append(one.watch(Reading(now_s, (theta, 0.0)), now_s))
        given.append(one.volts((theta, 0.0), now_s)[0])
    named = {k: fault.name for k, fault in enumerate(found) if fault is not None}
    assert named == {31: "limit", 92: "encoder jump"}
    assert max(given[31:92]) < 0.0
    assert given[92:] == [0.0, 0.0]


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
    assert watched(one, [0.003 * k for k in range(90)], 3.0)[-1] == (3.0, 0.0)
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


MOVES = ((0.5, 0.25), (0.5, 0.25))


@pytest.mark.parametrize("volts", [1.0, -0.6])
def test_a_still_arm_under_weak_volts_that_surely_move_it_gets_no_more(volts: float):
    """Frozen or blocked; below 2 V it was never seen. The user's next wiring knows other volts."""
    one = ClientWatchdog(6.0, SERVO, 0.002)
    one.configure(Wiring(), True, MOVES)
    one.arm(T)
    given = watched(one, [0.1] * 500, volts)
    assert given[50] == (volts, 0.0)
    assert given[-1] == (0.0, 0.0)
    assert not one.armed
    for sure_V, homed in ((((2.0, 2.0), (0.1, 0.1)), True), (MOVES, False)):
        other = ClientWatchdog(6.0, SERVO, 0.002)
        other.configure(Wiring(), True, MOVES)
        other.configure(Wiring(), homed, sure_V)
        other.arm(T)
        assert watched(other, [0.1] * 500, volts)[-1] == (volts, 0.0)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("fault", [0.4, nan])
def test_the_arm_whose_encoder_is_right_is_braked_when_the_other_ones_is_lost(axis, fault):
    """Both at 0 V, it flew on up to its stop."""
    one, given = watchdog(), []
    lost_s = T + 0.002 * 25
    for k in range(200):
        now_s = T + 0.002 * k
        flies = min(0.016 * k, 0.55)
        angles = [fault if now_s >= lost_s else -0.005 * k] * 2
        angles[1 - axis] = flies
        told(one, 6.0, 6.0, at_s=now_s)
        one.watch(Reading(now_s, (angles[0], angles[1])), now_s)
        given.append(one.volts((angles[0], angles[1]), now_s))
    lost, right = [v[axis] for v in given], [v[1 - axis] for v in given]
    assert lost[24] == 6.0
    assert not np.any(lost[25:])
    assert min(right[25:36]) < -3.0  # 0.4 rad and more, at 8 rad/s
    assert right[-1] == 0.0
    assert not one.armed
    one.arm(T + 2.0)
    told(one, 1.0, 1.0, at_s=T + 2.0)
    assert one.volts((0.0, 0.0), T + 2.0) == (1.0, 1.0)


def test_two_lost_encoders_brake_nothing():
    one = watchdog()
    watched(one, [0.016 * k for k in range(26)], 6.0)
    now_s = T + 0.052
    assert one.watch(Reading(now_s, (nan, nan)), now_s) is not None
    assert one.volts((0.416, 0.0), now_s) == (0.0, 0.0)
    other = watchdog()
    watched(other, [0.016 * k for k in range(26)], 6.0)
    assert other.watch(Reading(now_s, (0.416, nan)), now_s) is not None
    assert other.volts((0.43, 0.0), now_s)[0] < -1.0
    later_s = now_s + 0.002
    fault = other.watch(Reading(later_s, (nan, 0.0)), later_s)
    assert fault is not None
    assert other.volts((0.43, 0.0), later_s) == (0.0, 0.0)


@pytest.mark.parametrize("side", [1, -1])
def test_angles_that_were_no_numbers_are_no_motion_afterwards(side: int):
    one = watchdog(armed=False)
    for k, theta in enumerate((nan, side * 0.49, side * 0.49)):
        if k == 2:
            one.arm(T + 0.002)
            told(one, side * 6.0, -side * 6.0, at_s=T + 0.002)
        given = one.volts((theta, -theta), T + 0.002 * min(k, 1))
    assert given == pytest.approx((side * 1.5, -side * 1.5))


def test_an_arm_beside_a_lost_encoder_is_not_levelled():
    one = watchdog()
    assert one.watch(Reading(T, (0.0, 0.2)), T) is None
    one.volts((0.0, 0.2), T)
    assert one.watch(Reading(T + 0.002, (nan, 0.2)), T + 0.002) is not None
    for k in range(1, 20):
        assert one.volts((0.0, 0.2), T + 0.002 * k) == (0.0, 0.0)
