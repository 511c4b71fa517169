"""The level's slopes, the ball's direction signs, and the delay, from a ball that is led about."""

from math import hypot
from typing import Literal

import numpy as np

from calibration.camera.sheet import CalibrationError
from calibration.motion.rolling import Rolling, RollingFit, fit_rolling
from calibration.records import LevelRecord, TimingRecord, Value
from calibration.statistics import student_quantile
from rig.parameters import GRAVITY_M_S2, Rig

# What the window model leaves out (second order in the tilt, the shafts), on simulated tables.
_MODEL_SLOPE_RAD, _MODEL_GAIN = 5e-5, 0.01
# Measured: eleven simulated runs of free-release and steps give a delay that is 2 to 4.2 ms too
# small; a ball that is led about gives the true one. Why is not known.
_MODEL_LATE_S = 0.0045
_GAIN_LIMIT = 0.3  # chosen: axes that are swapped or wrong linkages differ by more
AXES: tuple[Literal["x"], Literal["y"]] = ("x", "y")


def level_record(x: list[Rolling], y: list[Rolling], rig: Rig) -> LevelRecord:
    """The level section: slopes and gains of both axes with 95 % intervals, from runs in which the
    ball was led about; `x` and `y` hold one `Rolling` per run (model: `rolling.py`).

    `CalibrationError`: too little motion (`fit_rolling`), an angle that drives the ball the wrong
    way, or a gain that differs from the rig file's by over 30 %.
    """
    fits = [fit_rolling(runs, rig) for runs in (x, y)]
    for name, fit in zip(AXES, fits, strict=True):
        _check_gain(name, fit, rig)
    pairs = list(zip(AXES, fits, strict=True))
    return LevelRecord(
        slope_rad={n: _value(*f.slope_rad, f.freedom, _MODEL_SLOPE_RAD) for n, f in pairs},
        gain_m_s2={
            n: _value(*f.gain_m_s2, f.freedom, _MODEL_GAIN * f.gain_m_s2[0]) for n, f in pairs
        },
        play_rad={n: f.backlash_rad[0] for n, f in pairs},
    )


def _check_gain(name: str, fit: RollingFit, rig: Rig) -> None:
    ratio = rig.linkage.ratios["xy".index(name)]
    gain, told = fit.gain_m_s2[0], rig.ball.rolling_factor * GRAVITY_M_S2 * ratio
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
    """The camera's delay from runs without recorded frames, fitted to the ball's motion; its
    standard deviation is some milliseconds.

    `axes`: for x and y, one `Rolling` per run; `known_s`: the delay [s] that was already subtracted
    from their times. The latenesses of the axes are averaged with inverse-variance weights; the
    standard deviation is at least half their difference. `CalibrationError`: too little motion
    (`fit_rolling`).
    """
    fits = [fit_rolling(runs, rig) for runs in axes]
    weights = np.array([1 / max(fit.late_s[1], 1e-6) ** 2 for fit in fits])
    late = float(np.sum(weights * [fit.late_s[0] for fit in fits]) / weights.sum())
    std = float(weights.sum() ** -0.5)
    apart = abs(fits[0].late_s[0] - fits[1].late_s[0]) / 2
    return TimingRecord(
        delay_s=_value(known_s + late, max(std, apart), fits[0].freedom, _MODEL_LATE_S),
        play_rad={name: fit.backlash_rad[0] for name, fit in zip(AXES, fits, strict=True)},
        frames=sum(len(run.seen_s) for run in axes[0]),
        source="ball",
    )


def _value(mean: float, std: float, freedom: int, model: float) -> Value:
    """95 % interval of a fit's number; `model`: what the equations leave out, in its unit."""
    return Value.around(mean, hypot(student_quantile(freedom) * std, model))
