"""Which nominal models compete for what brakes the arm."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from calibration.gap import investigate
from calibration.gap.decision_rule import NAME_THRESHOLD
from calibration.gap.model.state import State
from calibration.gap.name.load_friction import (
    friction_models,
    model_of_rigid_shafts,
    unloaded_model,
)
from calibration.gap.name.screen import Screened
from rig.parameters import Drive, Rig, Servo
from tests.support.gap.logs import log_of
from tests.support.worlds.healthy import rubbing_joints

STIFF = Drive(joint_friction_nm=0.02)  # of its joints


@pytest.mark.parametrize(
    ("arm_nm", "joint_nm", "loaded", "coasting"),
    [
        (0.0, 0.0, False, True),
        (0.015, 0.0, True, True),  # friction of the arm alone was not heeded
        (0.0, 0.02, True, False),
        (0.002, 0.02, True, False),
    ],
)
def test_friction_that_the_rig_file_tells_loads_a_model(
    arm_nm: float, joint_nm: float, loaded: bool, coasting: bool
):
    rig = Rig(drive=Drive(arm_friction_nm=arm_nm, joint_friction_nm=joint_nm))
    models = friction_models(rig)
    assert [model.load_friction for model in models].count(True) == loaded
    told_V = (arm_nm + joint_nm) / rig.servo.torque_per_volt_nm
    assert max(model.assumed_friction_V for model in models) == pytest.approx(told_V)
    assert any(model.coasts and not model.load_friction for model in models) == coasting
    assert not models[-1].load_friction
    assert not models[-1].coasts


def test_no_motor_of_a_servo_that_takes_an_angle_feels_a_load():
    rig = replace(Rig(drive=Drive(arm_friction_nm=0.015)), servo=Servo(kind="position"))
    assert [model.load_friction for model in friction_models(rig)] == [False]


@pytest.mark.parametrize(
    ("drive", "model", "screened", "share", "named", "tried"),
    [
        (STIFF, 0, "joint_backlash", 1.0, (), True),
        (STIFF, 0, "joint_backlash", 0.9, (), False),  # the ball does not show it
        (STIFF, 0, "gear_backlash", 1.0, (), False),
        (STIFF, 0, "joint_backlash", 1.0, (("joint_backlash", "y"),), False),  # it has its name
        (STIFF, -1, "joint_backlash", 1.0, (), False),  # no motor is loaded
        (
            Drive(arm_friction_nm=0.02, joint_friction_nm=0.0),
            0,
            "joint_backlash",
            1.0,
            (),
            False,
        ),  # not by a joint
    ],
)
def test_a_play_that_the_ball_shows_and_loaded_motors_deny_is_tried_without_load(
    drive: Drive,
    model: int,
    screened: str,
    share: float,
    named: tuple[tuple[str, str], ...],
    tried: bool,
):
    nominal = friction_models(Rig(drive=drive))[model]
    unused: Any = None  # neither data nor a fit decide
    state = State(unused, nominal, unused, named)
    other = unloaded_model(state, [Screened(screened, "x", share * NAME_THRESHOLD, {}, 0.0, {})])
    assert (other is not None) == tried
    assert other is None or not (other.load_friction or other.coasts)


def test_friction_that_the_rig_file_assumes_is_not_missing_behind_stiffer_shafts():
    """The shafts do not wind up as assumed: the friction is the rig file's. A motor without a plate
    has no joints: there it is missing."""
    columns, _, _ = rubbing_joints(3600, seconds=12.0)
    rig = Rig()
    table = investigate([log_of(columns)], rig, until="add", quick=True).findings
    assert table.verdict == "nothing-missing", table.sentence
    assert any("shafts are less stiff" in note for note in table.notes)
    assert table.rig_after is not None
    drive, given = table.rig_after.drive, rig.drive
    assert drive.arm_friction_nm == given.arm_friction_nm + given.joint_friction_nm
    assert drive.joint_friction_nm == 0.0
    assert "coulomb_friction" not in table.rig_after.effects

    of_motor = {key: columns[key] for key in ("t_s", "voltage_x_V", "theta_x_rad")}
    motor = investigate([log_of(of_motor)], rig, until="name", quick=True).findings
    assert [one.name for one in motor.effects] == ["coulomb_friction"], motor.sentence


@pytest.mark.parametrize(
    ("outputs", "named", "volts", "same"),
    [
        (("servo_x", "servo_y", "ball"), ("x", "y"), (0.18, 0.18), True),
        (("servo_x", "servo_y", "ball"), ("x", "y"), (0.11, 0.18), True),  # x has more beside it
        (("servo_x", "servo_y", "ball"), ("x", "y"), (0.10, 0.10), False),  # another friction
        (("servo_x", "servo_y", "ball"), ("x",), (0.18, 0.18), False),  # y has none
        (("servo_x", "servo_y"), ("x", "y"), (0.18, 0.18), False),  # bare motors
        (("ball",), (), (0.18, 0.18), False),  # no motor is seen
    ],
)
def test_only_friction_of_all_motors_under_a_plate_is_the_rig_files(
    outputs: tuple[str, ...], named: tuple[str, ...], volts: tuple[float, float], same: bool
):
    setting = {f"coulomb_friction.friction_V.{a}": v for a, v in zip("xy", volts, strict=True)}
    held: Any = SimpleNamespace(
        nominal=friction_models(Rig())[-1],
        evidence=SimpleNamespace(outputs=outputs),
        named=tuple(("coulomb_friction", axis) for axis in named),
        fit=SimpleNamespace(setting=setting),
    )
    other = model_of_rigid_shafts(held, held)
    assert (other is not None) == same
    assert other is None or other.rig.drive == Drive(arm_friction_nm=0.022, joint_friction_nm=0.0)
