"""Level slopes, the ball's direction signs, and the delay that a ball's run tells."""

from math import hypot
from typing import Literal

import numpy as np

from calibration.records import LevelRecord, TimingRecord, Value
from calibration.rolling import Rolling, RollingFit, fit_rolling
from calibration.sheet import CalibrationError
from rig.parameters import Rig

_WIDE = 2.0  # 95 % of a Student's t with the usual 40 windows
# What the window model leaves out (second order in the tilt, the shafts), on simulated tables.
_MODEL_SLOPE_RAD, _MODEL_GAIN = 5e-5, 0.01
_GAIN_LIMIT = 0.3
AXES: tuple[Literal["x"], Literal["y"]] = ("x", "y")


def level_record(x: list[Rolling], y: list[Rolling], rig: Rig) -> LevelRecord:
    """The slopes from runs in which the ball was led about (of each axis one `Rolling` a run).

    Raises `CalibrationError` on too little motion, or an angle that drives the ball the wrong way.
    """
    fits = [fit_rolling(runs, rig) for runs in (x, y)]
    for name, fit in zip(AXES, fits, strict=True):
        _check_gain(name, fit, rig)
    pairs = list(zip(AXES, fits, strict=True))
    return LevelRecord(
        slope_rad={n: _value(*f.slope_rad, _MODEL_SLOPE_RAD) for n, f in pairs},
        gain_m_s2={n: _value(*f.gain_m_s2, _MODEL_GAIN * f.gain_m_s2[0]) for n, f in pairs},
        play_rad={n: f.play_rad[0] for n, f in pairs},
    )


def _check_gain(name: str, fit: RollingFit, rig: Rig) -> None:
    gain, told = fit.gain_m_s2[0], rig.ball_gain_m_s2
    if gain < 0:
        raise CalibrationError(
            f"direction signs: a positive servo angle drives the ball towards -{name}: turn the "
            f"sign of {name} in the driver, or the camera's axis"
        )
    if abs(gain / told - 1) > _GAIN_LIMIT:
        raise CalibrationError(
            f"the ball answers to servo {name} with {gain:.2f} m/s2 per rad, the rig file makes it "
            f"{told:.2f}: check [linkage], [ball] and whether the axes are swapped"
        )


def timing_from_ball(axes: list[list[Rolling]], rig: Rig, known_s: float) -> TimingRecord:
    """The delay from runs without frames: what the ball tells, some milliseconds uncertain.

    `axes`: of each axis one `Rolling` a run; `known_s` is the delay that its times allow for.
    """
    fits = [fit_rolling(runs, rig) for runs in axes]
    weights = np.array([1 / max(fit.late_s[1], 1e-6) ** 2 for fit in fits])
    late = float(np.sum(weights * [fit.late_s[0] for fit in fits]) / weights.sum())
    std = float(weights.sum() ** -0.5)
    apart = abs(fits[0].late_s[0] - fits[1].late_s[0]) / 2
    return TimingRecord(
        delay_s=_value(known_s + late, max(std, apart), 0.0005),
        play_rad={name: fit.play_rad[0] for name, fit in zip(AXES, fits, strict=True)},
        frames=sum(len(run.seen_s) for run in axes[0]),
        source="ball",
    )


def _value(mean: float, std: float, model: float) -> Value:
    wide = hypot(_WIDE * std, model)
    return Value(value=mean, low=mean - wide, high=mean + wide)
