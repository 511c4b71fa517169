"""Which nominal models compete for what brakes the arm."""

from dataclasses import replace

import pytest

from calibration.gap.name.load_friction import friction_models
from rig.parameters import Drive, Rig, Servo


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
