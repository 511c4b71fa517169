"""The product's physics against another engine that shares no dynamics with it.

Tolerances come from reasons. Both engines are of first order with steps of 0.1 ms: half a step at
the servo's 6 rad/s is 0.3 mrad. The product keeps the plate's inertia, seen at the servo, constant;
a mechanism's falls with cos^2 theta, 12 % at 0.35 rad, which is 0.4 % of the drive's: 0.4 % of
tau = 25 ms at 6 rad/s is 0.6 mrad. Together 1 mrad, less than the encoder's count of 1.5 mrad;
through the linkage 0.25 mrad at the plate. An angle that is wrong by 0.13 mrad all the time takes
the ball (1.09 m/s2/rad) 0.28 mm away in 2 s, 0.13 mm RMS: 0.15 mm. MuJoCo's contacts creep by
1e-8 m/s and its limits are a spring to 0.1 %: far below.
"""

from dataclasses import replace

import numpy as np
import pytest

from experiments.benchmark.engines.mujoco_engine.mechanism import Build
from rig.parameters import GRAVITY_M_S2, Walls
from tests.support.mujoco_engine.ball_windows import residuals, rms_mm
from tests.support.mujoco_engine.comparison import (
    DEGREE,
    TABLES,
    TICK_S,
    Gap,
    Start,
    by_mujoco,
    by_product,
    gap,
    multisine,
    steps,
    table_with,
)

SERVO_RAD, PLATE_RAD, BALL_RMS_M = 1e-3, 2.5e-4, 1.5e-4
SIGNALS = {"multi-sine": multisine(), "steps": steps(), "one axis": multisine(both=False)}


def agree(g: Gap) -> bool:
    return (
        g.motor_rad[1] < SERVO_RAD
        and g.arm_rad[1] < SERVO_RAD
        and g.plate_rad[1] < PLATE_RAD
        and g.ball_m[0] < BALL_RMS_M
    )


@pytest.mark.parametrize("signal", ["multi-sine", "steps"])
@pytest.mark.parametrize("case", TABLES)
def test_same_volts_same_motion(case: str, signal: str):
    ours = by_product(TABLES[case], SIGNALS[signal], Start())
    theirs = by_mujoco(TABLES[case], SIGNALS[signal], Start())
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
    theirs = by_mujoco(TABLES["both plays"], volts, Start())
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


def test_a_loose_plate_drops_to_the_balls_side_in_the_same_time():
    """No joint friction: the ball's weight takes the plate across the play, and it bounces there.

    What is left are the two simplifications of a drive with constant loads: the plate's constant
    inertia and the ball's weight where a ball pushes as it moves (1 % of the plate's inertia).
    """
    rig = table_with(joint_deg=2.0)
    rig = replace(rig, drive=replace(rig.drive, joint_friction_nm=0.0))
    start, volts = Start((0.06, -0.08)), np.zeros((400, 2))
    ours, theirs = by_product(rig, volts, start), by_mujoco(rig, volts, start)
    assert np.abs(ours.plate_rad[-1]).min() > 0.9 * DEGREE * rig.linkage.ratio
    assert agree(gap(ours, theirs)), gap(ours, theirs)


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


def circling(volts: float = 4.0, hz: float = 2.3) -> np.ndarray:
    """Volts (1000, 2) that tilt the plate round and round, nearly as fast as a servo can."""
    t = TICK_S * (np.arange(1000) + 0.5)
    x, y = np.cos(2 * np.pi * hz * t), np.sin(2 * np.pi * hz * t) * np.minimum(1, t / 0.3)
    return volts * np.column_stack([x, y])


@pytest.mark.parametrize("hollow", [True, False])
def test_a_spinning_ball_on_a_fast_plate(hollow: bool):
    """60 rad/s about the normal: the gyroscopic terms alone move the ball by millimetres.

    With the plate's inertia at the crank the drives agree to 0.1 mrad: 0.1 mm of ball at most.
    """
    rig = table_with(hollow=hollow, dry=False)
    build = Build(step_s=5e-5, crank_share=0.98)
    still, turning = Start((-0.04, 0.03)), Start((-0.04, 0.03), spin_rad_s=60.0)
    theirs = by_mujoco(rig, circling(), turning, build=build)
    found = gap(by_product(rig, circling(), turning, step_s=5e-5), theirs)
    assert found.ball_m[1] < 1.5e-4
    assert found.spin_rad_s[1] < 0.02
    assert np.ptp(theirs.spin_rad_s) > 0.5  # the tilting itself turns the ball about the normal
    assert gap(by_product(rig, circling(), still), theirs).ball_m[0] > 3e-3


@pytest.mark.parametrize("case", ["friction", "both plays", "solid ball"])
def test_the_moving_plates_terms_leave_micrometres_where_eq_15_leaves_half_a_millimetre(case: str):
    """Heun's steps of 2 ms against the plate's fastest motion (5 Hz): error below 1 um."""
    run = by_mujoco(TABLES[case], SIGNALS["multi-sine"], Start((0.03, -0.03)))
    ball = TABLES[case].ball
    assert rms_mm(residuals(run, ball, moving_plate=True)) < 0.003
    assert rms_mm(residuals(run, ball, moving_plate=False)) > 0.3


def test_a_universal_joint_differs_by_its_heading():
    """The product's plate does not turn about its normal; on a universal joint it does, a little.

    Second order: tilts of 0.07 rad about both axes turn it by up to 0.01 rad, so a ball 7 cm from
    the centre is seen 0.7 mm aside. Neither the drives nor the tilt feel it.
    """
    rig, volts = table_with(dry=False), SIGNALS["multi-sine"]
    theirs = by_mujoco(rig, volts, Start(), build=Build(universal=True))
    found = gap(by_product(rig, volts, Start()), theirs)
    assert found.arm_rad[1] < SERVO_RAD
    assert found.plate_rad[1] < PLATE_RAD
    assert BALL_RMS_M < found.ball_m[0] < 7e-4


@pytest.mark.parametrize("restitution", [0.2, 0.5, 0.8])
def test_walls_give_back_their_share_of_a_gripping_balls_speed(restitution: float):
    """A wall is a spring of 600 rad/s: 5 ms of contact at 0.3 m/s are 1.5 mm.

    First order: 600 rad/s times the step of 50 us is 3 % of the speed at the wall.
    """
    rig = replace(table_with(), walls=Walls(True, restitution))
    start, volts = Start((0.05, 0.02), velocity_m_s=(0.3, 0.12)), np.zeros((250, 2))
    ours = by_product(rig, volts, start)
    build = Build(step_s=5e-5, grip=100.0)
    theirs = by_mujoco(rig, volts, start, build=build)
    after = round(0.4 / TICK_S)
    assert ours.velocity_m_s[after, 0] == pytest.approx(-restitution * 0.3)
    np.testing.assert_allclose(theirs.velocity_m_s[after], ours.velocity_m_s[after], atol=0.009)
    assert gap(ours, theirs).ball_m[1] < 1.5e-3


def test_on_a_slippery_plate_a_wall_nearly_stops_a_hollow_ball():
    """What `Walls.restitution` is not: the wall turns the speed, not the spin, which eats it up.

    Sliding ends at k (-e v) + (1 - k) v = 0.1 v for e = 0.5, k = 3/5: no rebound at all.
    """
    rig = replace(table_with(), walls=Walls(True, 0.5))
    start = Start((0.05, 0.0), velocity_m_s=(0.3, 0.0))
    build = Build(step_s=5e-5, grip=0.3)
    theirs = by_mujoco(rig, np.zeros((300, 2)), start, build=build)
    assert np.abs(theirs.velocity_m_s[-50:, 0]).max() < 0.05 * 0.3 + 1e-3
