"""What the linkage tells of its servos and the plate's axes: both ways, limits, tilts."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.linkage import Linkage
from rig.rigfile import read_rig
from tests.support import ROOT

RIGS = ROOT / "experiments/rigs"
RODS = read_rig(RIGS / "hobby-two-servos.toml").linkage
ARMS = read_rig(RIGS / "three-arms.toml").linkage
LIMIT_RAD = 0.2
tilts = st.tuples(st.floats(-LIMIT_RAD, LIMIT_RAD), st.floats(-LIMIT_RAD, LIMIT_RAD))
BOTH = pytest.mark.parametrize("linkage", [RODS, ARMS], ids=["two rods", "three arms"])


@BOTH
@given(angles=tilts)
def test_servos_and_axes_are_each_others_inverse(linkage: Linkage, angles: tuple[float, float]):
    assert linkage.table_angles(linkage.servo_angles(angles)) == pytest.approx(angles, abs=1e-9)


@BOTH
@given(angles=tilts)
def test_no_servo_goes_beyond_its_limit(linkage: Linkage, angles: tuple[float, float]):
    turned = np.abs(linkage.servo_angles(angles))
    assert np.all(turned <= linkage.servo_limits_rad(LIMIT_RAD))


@BOTH
def test_level_is_exactly_zero_of_every_servo(linkage: Linkage):
    assert linkage.servo_angles((0.0, 0.0)) == (0.0,) * linkage.servos
    assert len(linkage.servo_names) == len({*linkage.servo_names}) == linkage.servos


def test_one_arm_that_rises_tilts_the_plate_away_from_it_and_all_three_lift_it():
    columns = np.array(ARMS.tilt_per_servo)
    away = -columns / np.linalg.norm(columns, axis=1, keepdims=True)
    azimuths = np.array([0.0, 2 * np.pi / 3, 4 * np.pi / 3])
    assert away == pytest.approx(np.column_stack([np.cos(azimuths), np.sin(azimuths)]), abs=1e-6)
    assert columns.sum(axis=0) == pytest.approx([0.0, 0.0], abs=1e-9)
    assert ARMS.table_angles((0.2, 0.2, 0.2)) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_tilts_per_servo_undo_what_a_small_tilt_asks_of_the_arms():
    for angles in product((-0.01, 0.01), repeat=2):
        tilt = np.array(ARMS.servo_angles(angles)) @ np.array(ARMS.tilt_per_servo)
        assert tilt == pytest.approx(np.sin(angles), abs=1e-4)


def test_a_tilt_out_of_reach_is_none():
    assert np.isnan(ARMS.servo_angles((1.5, 1.5))).any()
    assert RODS.servo_rates((7.0, 5.0)) == (7.0, 5.0)
    assert ARMS.servo_rates((7.0, 5.0)) == (5.0, 5.0, 5.0)
