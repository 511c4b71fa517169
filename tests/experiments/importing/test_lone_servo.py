"""A servo by itself, as bus servos and motor kits record it; angles that are told late."""

import numpy as np
import pytest

from experiments.importing.import_map import stated
from experiments.importing.proposal import propose
from experiments.importing.recording import Stream

HZ = 50.0
T = np.arange(600) / HZ
RNG = np.random.default_rng(3)
GOAL = np.repeat(RNG.uniform(-0.6, 0.6, 24), 25)


def lagged(told: np.ndarray, tau_s: float) -> np.ndarray:
    """What follows `told` (n,) with a lag."""
    out, share = np.zeros(len(told)), 1 - np.exp(-1 / (HZ * tau_s))
    for k in range(1, len(told)):
        out[k] = out[k - 1] + share * (told[k - 1] - out[k - 1])
    return out


ANGLE = lagged(GOAL, 0.06)


def servo(**more: np.ndarray) -> Stream:
    return Stream({"timestamp": T, "goal_position": GOAL, "position": ANGLE, **more})


def options(stream: Stream, *said: str) -> list[str]:
    return [doubt.option for doubt in propose(stream, stated(said)).doubts]


def test_a_place_beside_its_goal_is_asked_whether_it_is_a_servos():
    found = propose(servo())
    assert found.draft["signals"]["theta_x_rad"]["column"] == "position"
    assert found.draft["signals"]["command_x_rad"]["column"] == "goal_position"
    assert found.doubts[0].option == "--set theta_x_rad.column=position or none"
    told = ("theta_x_rad.column=position", "theta.unit=rad", "command.unit=rad")
    signals = propose(servo(), stated(told)).map().signals
    assert {name: one.column for name, one in signals.items()} == {
        "theta_x_rad": "position",
        "command_x_rad": "goal_position",
    }
    assert [one.sign for one in signals.values()] == [1, 1]


def test_somebody_who_says_that_it_is_no_servo_is_asked_for_the_balls_angle():
    left = options(servo(), "theta_x_rad.column=none")
    assert not any("theta_x_rad.column" in one for one in left)
    assert any(one.startswith("--set command_x_rad.column=") for one in left)


@pytest.mark.parametrize("name", ["ball_position", "position_x", "position_mm"])
def test_a_place_that_says_more_is_a_balls(name: str):
    stream = Stream({"timestamp": T, "goal_position": GOAL, name: ANGLE})
    assert "--set theta_x_rad.column=position or none" not in options(stream)


def test_a_place_beside_an_angle_is_a_balls():
    stream = servo(tilt_deg=GOAL)
    assert "theta_x_rad" not in propose(stream).draft["signals"]


def test_volts_that_never_come_near_zero_are_a_supplys():
    sagging = 12.4 - 0.8 * np.abs(ANGLE)
    found = propose(servo(input_volts=sagging))
    assert "voltage_x_V" not in found.draft["signals"]
    assert any("supply" in reason for reason in found.reasons["drive"])
    drive = 12.4 * np.sign(GOAL)
    assert any("voltage_x_V" in one for one in options(servo(input_volts=drive)))


def test_a_stated_speed_is_the_angle_where_there_is_no_other():
    volts = np.repeat(RNG.uniform(-5, 5, 60), 10)
    speed = lagged(40.0 * volts, 0.06)
    stream = Stream({"t": T, "r": np.roll(speed, 3), "y": speed, "u": volts})
    said = ["voltage_x_V.column=u", "motor_speed_x_rad_s.column=y", "voltage_x_V.unit=V"]
    assert options(stream, *said) == [
        "--set ball_x_m.column=r or none",
        "--set motor_speed_x_rad_s.unit=rad/s or deg/s or rpm or turn/s",
    ]
    said += ["ball_x_m.column=none", "motor_speed_x_rad_s.unit=deg/s"]
    signals = propose(stream, stated(said)).map().signals
    assert (signals["theta_x_rad"].column, signals["theta_x_rad"].unit) == ("y", "deg/s")
    assert signals["voltage_x_V"].sign == 1


def test_the_unit_of_a_signal_that_nothing_tells_is_asked():
    stream = servo(strange=0.1 * ANGLE)
    said = ("theta_x_rad.column=position", "target_x_m.column=strange")
    assert "--set target_x_m.unit=m or cm or mm or um or in or px" in options(stream, *said)


def balanced() -> tuple[np.ndarray, np.ndarray]:
    """Tilt [rad] and place [m] (n,) of a ball that is sent to and fro, of 7 m/s2/rad."""
    tilt, place, speed, target = np.zeros(len(T)), np.zeros(len(T)), 0.0, 0.0
    for k in range(1, len(T)):
        target = RNG.uniform(-0.08, 0.08) if k % 60 == 1 else target
        tilt[k] = 1.3 * (target - place[k - 1]) - 0.6 * speed
        place[k] = place[k - 1] + speed / HZ
        speed += 7.0 * tilt[k] / HZ
    return tilt, place + RNG.normal(0, 3e-4, len(T))


@pytest.mark.parametrize("late_s", [0.0, 0.2])
def test_an_angle_that_is_told_after_the_ball_moved_is_doubted(late_s: float):
    tilt, place = balanced()
    told = np.interp(T - late_s, T, tilt)
    stream = Stream({"t": T, "ball_x_m": place, "imu_pitch_rad": told, "pitch_cmd_rad": tilt})
    late = [one for one in propose(stream).doubts if "before imu_pitch_rad tells it" in one.why]
    assert len(late) == (1 if late_s else 0)
    if late:
        assert late[0].option == "--set theta_x_rad.column=none or imu_pitch_rad"
