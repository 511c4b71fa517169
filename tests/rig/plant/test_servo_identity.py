"""The simulated servo against K/(tau s + 1) and against what friction must do to it.

Shafts are not rigid (30 N m/rad): the plate rings at some 100 Hz, damped within 50 ms, by up to 6 %
of the final speed. So the motor is compared from one time constant on, all three from two on.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import curve_fit

from rig.parameters import Drive, Rig, Servo, torque_per_volt
from rig.plant.plant import ARM, ARM_RATE, MOTOR, MOTOR_RATE, PLATE, PLATE_RATE
from tests.support.simulated import SMOOTH, TICK_S, constant_volts, moved, smooth_rig
from tests.support.srv02 import nominal_servo

MEASURED = Servo(gain_rad_s_V=1.735, time_constant_s=0.046)
SERVOS = [Servo(), MEASURED]


def first_order(t, gain, tau, volts):
    """Speed after a step of `volts` at t = 0."""
    return gain * volts * (1 - np.exp(-t / tau))


@pytest.mark.parametrize("servo", SERVOS)
@pytest.mark.parametrize("volts", [0.5, -1.0])
def test_constant_volts_give_the_first_order_response(servo, volts):
    states = moved(smooth_rig(servo=servo), constant_volts(volts, 0.0, 0.2))
    t = TICK_S * np.arange(len(states))
    expected = first_order(t, servo.gain_rad_s_V, servo.time_constant_s, volts)
    final = abs(servo.gain_rad_s_V * volts)
    for row, wait, share in ((MOTOR_RATE, 1, 0.003), (ARM_RATE, 2, 0.005), (PLATE_RATE, 2, 0.005)):
        late = t > wait * servo.time_constant_s
        assert np.abs(states[late, row, 0] - expected[late]).max() < share * final
    assert np.all(states[:, MOTOR_RATE, 1] == 0.0)  # the other axis does not move


@pytest.mark.parametrize("servo", SERVOS)
def test_angle_is_the_integral_of_the_speed(servo):
    states = moved(smooth_rig(servo=servo), constant_volts(0.5, 0.0, 0.2))
    t, tau = TICK_S * np.arange(len(states)), servo.time_constant_s
    expected = servo.gain_rad_s_V * 0.5 * (t - tau * (1 - np.exp(-t / tau)))
    # 0.1 ms Euler steps shift the angle by half a step's travel, the shafts by their wind-up.
    assert np.abs(states[:, ARM, 0] - expected).max() < 5e-4


@pytest.mark.parametrize("servo", SERVOS)
def test_gain_and_time_constant_identified_from_a_step(servo):
    states = moved(smooth_rig(servo=servo), constant_volts(0.6, 0.0, 0.3))
    t = TICK_S * np.arange(len(states))
    (gain, tau), _ = curve_fit(
        lambda t, gain, tau: first_order(t, gain, tau, 0.6), t, states[:, ARM_RATE, 0], (1, 0.03)
    )
    assert gain == pytest.approx(servo.gain_rad_s_V, rel=0.005)
    assert tau == pytest.approx(servo.time_constant_s, rel=0.03)


@pytest.mark.parametrize("servo", SERVOS)
@pytest.mark.parametrize("hz", [1.0, 3.0, 8.0])
def test_gain_and_phase_identified_from_sines(servo, hz):
    n, omega = round(4 / TICK_S), 2 * np.pi * hz
    t = TICK_S * np.arange(n)
    volts = np.zeros((n, 2))
    volts[:, 1] = np.cos(omega * (t + TICK_S / 2))  # held volts: the mid of each tick counts
    rate = moved(smooth_rig(servo=servo), volts, held=True)[1:, MOTOR_RATE, 1]
    later = t >= 4 - 3 / hz - 1e-9
    after = t[later] + TICK_S
    design = np.column_stack([np.cos(omega * after), np.sin(omega * after)])
    (a, b), *_ = np.linalg.lstsq(design, rate[later], rcond=None)
    expected = servo.gain_rad_s_V / (1 + 1j * omega * servo.time_constant_s)
    assert abs((a - 1j * b) - expected) < 0.015 * abs(expected)


def test_nominal_servo_is_what_the_manual_gives():
    """FACTS: 1.53 rad/s/V and 0.025 s with the tachometer, 0.021 s without."""
    assert nominal_servo() == pytest.approx((1.53, 0.025), rel=0.02)
    assert nominal_servo(tachometer_kg_m2=0.0)[1] == pytest.approx(0.021, rel=0.03)


def test_inertia_of_the_nominal_servo_is_the_manuals():
    gain, tau = nominal_servo()
    assert tau * torque_per_volt() / gain == pytest.approx(2.084e-3, rel=0.001)


def breakaway(rig: Rig, axis: int, sign: int) -> float:
    """Volts of a slow ramp (0.05 V/s) at which the plate leaves its place (by 0.1 mrad)."""
    n = round(8 / TICK_S)
    volts = np.zeros((n, 2))
    volts[:, axis] = sign * 0.05 * TICK_S * np.arange(n)
    states = moved(rig, volts, held=True)
    left = np.abs(states[:, PLATE, axis]) > 1e-4
    assert left.any()
    return float(volts[np.argmax(left) - 1, axis])


@pytest.mark.parametrize("sign", [1, -1])
def test_breakaway_is_coulomb_plus_arm_and_joint_friction(sign):
    drive = Drive()
    rig = Rig(drive=drive, effects={"coulomb_friction": {"x": {"friction_V": 0.15}}})
    dry = (drive.arm_friction_nm + drive.joint_friction_nm) / torque_per_volt()
    # The ramp goes on for the hundredths of a second that the plate needs to be seen moving.
    assert breakaway(rig, 0, sign) == pytest.approx(sign * (0.15 + dry), abs=0.005)
    assert breakaway(rig, 1, sign) == pytest.approx(sign * dry, abs=0.005)


def test_breakaway_is_asymmetric_by_twice_the_offset():
    """FACTS D, x: -0.093 and +0.354 V on a real table = friction 0.2235 V, offset -0.1305 V."""
    rig = smooth_rig(
        effects={
            "coulomb_friction": {"x": {"friction_V": 0.2235}},
            "voltage_offset": {"x": {"offset_V": -0.1305}},
        }
    )
    assert breakaway(rig, 0, 1) == pytest.approx(0.354, abs=0.005)
    assert breakaway(rig, 0, -1) == pytest.approx(-0.093, abs=0.005)


def test_the_realistic_table_breaks_away_as_measured():
    """Coulomb friction of the motor plus the default drive's bearings make the measured volts."""
    rig = Rig(
        effects={
            "coulomb_friction": {"x": {"friction_V": 0.0522}, "y": {"friction_V": 0.0092}},
            "voltage_offset": {"x": {"offset_V": -0.1305}, "y": {"offset_V": -0.0995}},
        }
    )
    measured = {(0, 1): 0.354, (0, -1): -0.093, (1, 1): 0.280, (1, -1): -0.081}
    for (axis, sign), volts in measured.items():
        assert breakaway(rig, axis, sign) == pytest.approx(volts, abs=0.005)


def test_gear_play_leaves_the_inertia_of_the_motor_alone_until_contact():
    """Inside the gap the motor turns without arm and plate: tau is shorter by their share."""
    rig = smooth_rig(effects={"gear_backlash": {"x": {"play_rad": 0.2}}})
    servo, load = rig.servo, 5.282e-5 + SMOOTH.plate_inertia_kg_m2
    states = moved(rig, constant_volts(0.5, 0.0, 0.1))
    t = TICK_S * np.arange(len(states))
    free = states[:, MOTOR, 0] < 0.08
    tau = servo.time_constant_s * (1 - load / servo.inertia_kg_m2)
    expected = first_order(t[free], servo.gain_rad_s_V, tau, 0.5)
    assert free.sum() > 20
    np.testing.assert_allclose(states[free, MOTOR_RATE, 0], expected, atol=0.005)
    assert np.all(states[free, ARM, 0] == 0.0)


def test_stiffer_shafts_come_closer_to_the_first_order_model():
    gaps = []
    for k in (3.0, 30.0):
        drive = replace(SMOOTH, gear_stiffness_nm_rad=k, joint_stiffness_nm_rad=k)
        states = moved(smooth_rig(drive=drive), constant_volts(0.5, 0.0, 0.2))
        t = TICK_S * np.arange(len(states))
        gaps.append(np.abs(states[:, ARM_RATE, 0] - first_order(t, 1.53, 0.025, 0.5)).max())
    assert gaps[1] < 0.5 * gaps[0]
