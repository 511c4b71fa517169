"""Servos that take an angle and whose angle nobody measures: lag and dead time from the ball alone.

The ball's motion against the servos' answer to their commands (`calibration.motion.rolling`). What
the ball tells best is how late the plate answers in all: lag, dead time and the camera's delay
together. The camera's delay is taken from the rig file. Lag and dead time part only where the
commands were quick; where they were not, the lag of the rig file is kept and said so.
"""

from collections.abc import Callable

from calibration.camera.sheet import CalibrationError
from calibration.motion.rolling import Rolling, fit_rolling
from calibration.records import PositionServoAxis, PositionServoRecord, Value
from calibration.statistics import student_quantile
from rig.parameters import Rig

# What windows with rigid joints leave out, on simulated tables: of the sum, of lag and dead time.
_MODEL_S = 0.006, 0.007, 0.007
_APART_S = 0.015  # chosen: half an interval above which lag and dead time count as not told apart


def record_by_ball(
    x: list[Rolling],
    y: list[Rolling],
    rig: Rig,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> PositionServoRecord:
    """Lag and dead time of both servos with 95 % intervals, from runs in which the ball was led
    about; `x` and `y` hold one `Rolling` per run. progress: called with (done, total) fits.

    `CalibrationError`: the angle was measured, too little motion (`fit_rolling`), or the frames are
    stamped later than they can be.
    """
    axes = []
    for number, runs in enumerate((x, y)):
        axes.append(_axis(runs, rig, lambda done, number=number: progress(number + done, 2)))
    return PositionServoRecord(x=axes[0], y=axes[1], source="ball")


def _axis(runs: list[Rolling], rig: Rig, fitted: Callable[[int], None]) -> PositionServoAxis:
    name = "xy"[runs[0].axis]
    if any(run.answer is None for run in runs):
        raise CalibrationError(f"servo {name}: its angle was measured in some run: take that alone")
    fitted(0)
    fit = fit_rolling(runs, rig, lag=True)
    fitted(1)
    half, *apart = [
        student_quantile(fit.freedom) * std + model_s
        for (_, std), model_s in zip((fit.together_s, fit.lag_s, fit.late_s), _MODEL_S, strict=True)
    ]
    told_apart = max(apart) <= _APART_S
    lag_s, dead_s = (rig.servo.pair(key)[runs[0].axis] for key in ("lag_s", "dead_time_s"))
    if told_apart:
        lag_s = fit.lag_s[0]
    late = dead_s + fit.together_s[0]
    if late + half < 0:
        raise CalibrationError(
            f"servo {name}: the plate would move {-1e3 * late:.0f} ms before it is told: "
            f"camera.delay_s = {rig.camera.delay_s:g} is too large"
        )
    not_seen = {
        "rate_limit_rad_s": "the ball does not show it",
        "acceleration_limit_rad_s2": "the ball does not show it",
        "dead_band_rad": "the ball cannot tell it from play",
    }
    if not told_apart:
        not_seen["lag_s"] = (
            "the ball does not part it from the dead time here: a longer run in which its target "
            "jumps would"
        )
    return PositionServoAxis(
        lag_s=_not_negative(lag_s, apart[0]) if told_apart else None,
        dead_time_s=_not_negative(late - lag_s, apart[1] if told_apart else half),
        together_s=Value.around(late, half),
        together_off_s=fit.together_off_s,
        not_seen=not_seen,
    )


def _not_negative(value: float, half: float) -> Value:
    return Value.within(value, half, at_least=0.0)
