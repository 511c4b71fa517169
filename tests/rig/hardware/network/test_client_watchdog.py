"""The guard over a served table, tick by tick, without a network: when volts flow and when not."""

from math import inf, nan

import pytest

from rig.hardware.network.client_watchdog import ClientWatchdog
from rig.hardware.network.remote_wire import DriveRequest
from rig.hardware.wiring import Wiring

T = 0.0  # the server's clock, so that differences are exact; the user's shows a second less
ODD = Wiring(swap=True)


def watchdog(*, homed: bool = True, armed: bool = True, limit_V: float = 6.0) -> ClientWatchdog:
    one = ClientWatchdog(limit_V, 0.5)
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
    unheard_of = ClientWatchdog(6.0, 0.5)  # armed before anybody said what its channels mean
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
    for volts, theta, expected in ((2, 0.57, 2), (2, 0.59, 0), (-2, 0.59, -2), (2, -0.59, 2)):
        told(one, side * volts)
        told(raw, side * volts)
        assert one.volts((side * theta, 0.0), T) == (side * expected, 0.0)
        assert raw.volts((side * theta, 0.0), T) == (side * volts, 0.0)
        one, raw = watchdog(), watchdog(homed=False)


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


def test_a_new_user_has_a_clock_of_their_own():
    one = watchdog()
    assert one.hear(T - 51.0, T) == inf
    one.meet()
    assert one.hear(T - 51.0, T) == 0.0
    assert one.hear(T - 51.0, T) == inf
    assert one.hear(T - 50.96, T + 0.06) == pytest.approx(0.02)
