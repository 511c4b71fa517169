"""The inverse of play: behind the right operator it gives back what was wanted."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.control import compensation
from rig.plant.shaft import play_operator

LEAST = 0.003
ANGLE = st.floats(-0.4, 0.4)
PLAY = st.just(0.0) | st.floats(1e-12, 0.1)  # half of the smallest double is no play


@given(st.lists(ANGLE, min_size=1, max_size=30), PLAY)
def test_joint_inverse_undoes_the_play_for_an_ideal_servo(wanted, play):
    """theta = reference at once: the plate is where it was asked to be, within `least`."""
    inverse, theta, plate = compensation.start(), 0.0, 0.0
    for want in wanted:
        reference = compensation.joint_reference(inverse, 0, want, theta, play, LEAST)
        theta = reference
        plate = play_operator(plate, theta, play / 2, -play / 2)
        assert abs(plate - want) <= LEAST + 1e-12
        assert abs(reference - want) <= play / 2 + 1e-15


@given(st.lists(ANGLE, min_size=1, max_size=10), st.lists(ANGLE, min_size=10, max_size=10))
def test_joint_inverse_of_no_play_is_nothing(wanted, thetas):
    inverse = compensation.start()
    for want, theta in zip(wanted, thetas, strict=False):
        assert compensation.joint_reference(inverse, 1, want, theta, 0.0, LEAST) == want


@given(st.lists(st.tuples(ANGLE, ANGLE), min_size=1, max_size=10), PLAY)
def test_joint_inverse_is_odd_and_its_axes_are_apart(pairs, play):
    up, down = compensation.start(), compensation.start()
    for want, theta in pairs:
        a = compensation.joint_reference(up, 0, want, theta, play, LEAST)
        b = compensation.joint_reference(down, 1, -want, -theta, play, LEAST)
        assert a == -b
    assert up["plate"][1] == up["shift"][1] == down["plate"][0] == down["shift"][0] == 0.0


def test_joint_inverse_does_not_chatter_near_the_wanted_angle():
    """Noise of a wanted angle below `least` never changes the side."""
    inverse = compensation.start()
    compensation.joint_reference(inverse, 0, 0.1, 0.0, 0.04, LEAST)
    compensation.joint_reference(inverse, 0, 0.1, 0.12, 0.04, LEAST)
    rng = np.random.default_rng(0)
    for noise in rng.uniform(-0.9 * LEAST, 0.9 * LEAST, 200):
        reference = compensation.joint_reference(inverse, 0, 0.1 + noise, 0.12, 0.04, LEAST)
        assert reference == pytest.approx(0.12 + noise)


def test_joint_inverse_crosses_at_a_reversal():
    """Pushed up to 0.1 the servo stands at 0.12; going back to 0.05 it must stand at 0.03."""
    inverse = compensation.start()
    assert compensation.joint_reference(inverse, 0, 0.1, 0.0, 0.04, LEAST) == pytest.approx(0.12)
    assert compensation.joint_reference(inverse, 0, 0.05, 0.12, 0.04, LEAST) == pytest.approx(0.03)


@given(st.floats(-0.3, 0.3), st.floats(-0.1, 0.1), PLAY, st.floats(0.1, 50))
def test_gear_volts_carry_the_motor_to_the_pushing_side_and_no_further(error, twist, play, gain):
    volts = compensation.gear_volts(error, twist, play, gain, LEAST)
    assert abs(volts) <= gain * play
    if abs(error) <= LEAST or play == 0.0:
        assert volts == 0.0
    elif error > 0:
        assert volts >= 0.0
        assert (volts == 0.0) == (twist >= play / 2)
    else:
        assert volts <= 0.0
        assert (volts == 0.0) == (twist <= -play / 2)


@given(st.floats(-0.3, 0.3), st.floats(-0.1, 0.1), PLAY)
def test_gear_volts_are_odd(error, twist, play):
    volts = compensation.gear_volts(error, twist, play, 14.0, LEAST)
    assert compensation.gear_volts(-error, -twist, play, 14.0, LEAST) == -volts


def test_gear_volts_ask_for_the_missing_part_of_the_gap():
    assert compensation.gear_volts(0.1, -0.02, 0.04, 14.0, LEAST) == pytest.approx(14.0 * 0.04)
    assert compensation.gear_volts(0.1, 0.0, 0.04, 14.0, LEAST) == pytest.approx(14.0 * 0.02)
    assert compensation.gear_volts(-0.1, 0.0, 0.04, 14.0, LEAST) == pytest.approx(-14.0 * 0.02)
