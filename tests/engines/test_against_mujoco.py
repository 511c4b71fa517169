"""The product's physics against another engine that shares no dynamics with it.

Tolerances come from reasons, not from what was found. Both engines are of first order with steps of 0.1 ms: half a
step at the servo's 6 rad/s is 0.3 mrad. The product keeps the plate's inertia, seen at the servo,
constant; a mechanism's falls with cos^2 theta, 12 % at 0.35 rad, which is 0.4 % of the drive's:
0.4 % of tau = 25 ms at 6 rad/s is 0.6 mrad. Together 1 mrad, less than the encoder's count of
1.5 mrad; through the linkage 0.25 mrad at the plate. An angle that is wrong by 0.13 mrad all the
time takes the ball (1.09 m/s2/rad) 0.28 mm away in 2 s, 0.13 mm RMS: 0.15 mm. Contacts that never
slip and play's walls are softer by 0.1 % at most, far below.
"""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the other engine is not installed: uv sync --group dev")

from comparison import (
    Gap,
    Start,
    by_mujoco,
    by_product,
    gap,
    multisine,
    steps,
    table_with,
)
from mujoco_mechanism import Build

from rig.parameters import GRAVITY_M_S2

SERVO_RAD, PLATE_RAD, BALL_RMS_M = 1e-3, 2.5e-4, 1.5e-4
CASES = {
    "no friction": table_with(dry=False),
    "friction": table_with(),
    "gear play 1": table_with(gear_deg=1.0),
    "gear play 2": table_with(gear_deg=2.0),
    "joint play 1.5": table_with(joint_deg=1.5),
    "joint play 2": table_with(joint_deg=2.0),
    "both plays": table_with(gear_deg=1.0, joint_deg=1.5),
    "solid ball": table_with(hollow=False),
}
SIGNALS = {"multi-sine": multisine(), "steps": steps(), "one axis": multisine(both=False)}


def agree(g: Gap) -> bool:
    return (
        g.motor_rad[1] < SERVO_RAD
        and g.arm_rad[1] < SERVO_RAD
        and g.plate_rad[1] < PLATE_RAD
        and g.ball_m[0] < BALL_RMS_M
    )


@pytest.mark.parametrize("signal", ["multi-sine", "steps"])
@pytest.mark.parametrize("case", CASES)
def test_same_volts_same_motion(case: str, signal: str):
    ours = by_product(CASES[case], SIGNALS[signal], Start())
    theirs = by_mujoco(CASES[case], SIGNALS[signal], Start())
    assert len(ours.t_s) > 900
    assert np.ptp(ours.ball_m, axis=0).min() > 0.02
    assert agree(gap(ours, theirs)), gap(ours, theirs)


WRONG = {
    "gear play wider by a fifth": (table_with(gear_deg=1.2, joint_deg=1.5), SIGNALS["steps"]),
    "joint play wider by a fifth": (table_with(gear_deg=1.0, joint_deg=1.8), SIGNALS["steps"]),
    "another ball": (
        table_with(gear_deg=1.0, joint_deg=1.5, hollow=False),
        SIGNALS["multi-sine"],
    ),
    "no dry friction": (
        table_with(gear_deg=1.0, joint_deg=1.5, dry=False),
        SIGNALS["multi-sine"],
    ),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_the_comparison_would_notice(wrong: str):
    rig, volts = WRONG[wrong]
    theirs = by_mujoco(CASES["both plays"], volts, Start())
    assert not agree(gap(by_product(rig, volts, Start()), theirs))


def test_what_is_left_is_the_plates_inertia():
    """With nearly all of it at the crank, where it is constant, the engines come closer."""
    rig, volts = table_with(dry=False), SIGNALS["multi-sine"]
    ours = by_product(rig, volts, Start(), step_s=2.5e-5)
    fine = Build(step_s=5e-5)
    plate = gap(ours, by_mujoco(rig, volts, Start(), build=fine))
    crank = gap(ours, by_mujoco(rig, volts, Start(), build=replace(fine, crank_share=0.98)))
    assert crank.arm_rad[0] < 0.6 * plate.arm_rad[0]
    assert crank.ball_m[0] < 0.5 * plate.ball_m[0]
    assert crank.ball_m[0] < 2e-5


@pytest.mark.parametrize("hollow", [True, False])
def test_a_constant_slope_is_the_closed_form_in_both(hollow: bool):
    """x = k g s t^2/2; dry friction holds the plate (creep of MuJoCo's friction: 1e-5 rad)."""
    slope = {"x": {"slope_rad": 0.03}, "y": {"slope_rad": -0.02}}
    rig = replace(table_with(hollow=hollow), effects={"level_offset": slope})
    t = 0.002 * np.arange(401)
    sines = np.array([0.03, -0.02])
    expected = 0.5 * rig.ball.rolling_factor * GRAVITY_M_S2 * sines * t[:, None] ** 2
    volts = np.zeros((400, 2))
    for found in (by_product(rig, volts, Start()), by_mujoco(rig, volts, Start())):
        np.testing.assert_allclose(found.ball_m, expected, atol=3e-5)
        assert found.ball_m[-1, 0] == pytest.approx(expected[-1, 0], rel=1e-3)
