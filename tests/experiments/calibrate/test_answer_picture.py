"""How late a ball answers its servos' commands: the picture, and the line that says it."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration.motion.rolling import Rolling
from calibration.records import PositionServoAxis, PositionServoRecord, Value
from experiments.calibrate.answer_picture import acceleration, answer_figure, averaged
from experiments.calibrate.position import _not_seen, sentence
from rig.log import Log
from rig.parameters import Rig, Servo

GAIN, LATE_S, TURNS_1_S = 0.8, 0.1, 4.0  # the last: the command's frequency, as of a swing
T = np.arange(0.0, 20.0, 0.01)


def told(t_s: np.ndarray) -> np.ndarray:
    return 0.2 * np.sin(TURNS_1_S * t_s)


def rolling(axis: int) -> Rolling:
    """A ball whose acceleration is GAIN times the command of LATE_S before."""
    seen = np.arange(0.5, 19.5, 1 / 60)
    place = -GAIN / TURNS_1_S**2 * told(seen - LATE_S)
    noise = 0.0003 * np.random.default_rng(axis).standard_normal(len(seen))
    return Rolling(T, told(T), seen, place + noise, axis)


LOG = Log.from_columns({"t_s": T, "command_x_rad": told(T), "command_y_rad": told(T)})


def record(lag: Value | None) -> PositionServoRecord:
    axis = PositionServoAxis(
        lag_s=lag,
        dead_time_s=Value.around(0.05, 0.02),
        together_s=Value.around(LATE_S, 0.02),
        together_off_s=None,
        not_seen={"acceleration_limit_rad_s2": "the ball does not show it"}
        | ({} if lag else {"lag_s": "the ball does not part it"}),
    )
    return PositionServoRecord(x=axis, y=axis, source="ball")


def test_the_ball_is_drawn_on_the_command_that_moved_it():
    at = np.arange(5.0, 15.0, 0.05)
    pulled, late = acceleration(rolling(0), at), averaged(LOG, 0, at - LATE_S)
    assert pulled == pytest.approx(GAIN * late, abs=0.04)  # of 0.16 m/s2
    early = averaged(LOG, 0, at)
    assert np.abs(pulled - GAIN * early).max() > 0.055
    unseen = Rolling(T, told(T), np.array([1.0]), np.array([0.0]))
    assert np.isnan(acceleration(unseen, at)).all()


def test_the_picture_is_written(tmp_path: Path):
    path = answer_figure(
        LOG, [rolling(0), rolling(1)], record(None), tmp_path / "a.png", "measured"
    )
    assert cv2.imread(str(path)) is not None


def test_a_lag_that_was_not_seen_is_called_assumed_and_no_limit_is_no_number():
    rig = Rig(servo=Servo(kind="position", lag_s=0.05))
    assert sentence(record(None), "x", rig).startswith(
        "lag 50 ms (assumed) + dead time 50 (95 %: 30 to 70) ms; lag and dead time together 100 ("
    )
    seen = sentence(record(Value.around(0.06, 0.01)), "x", rig)
    assert seen.startswith("lag 60 (95 %: 50 to 70) ms; dead time 50 (30 to 70) ms")
    lines = _not_seen(record(None), rig)
    assert "servo x and y: no acceleration limit assumed: the ball does not show it" in lines
    slow = Rig(servo=Servo(kind="position", acceleration_limit_rad_s2=300.0))
    assert any(
        "acceleration limit kept at 300 rad/s2" in line for line in _not_seen(record(None), slow)
    )
