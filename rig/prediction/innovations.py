"""One step ahead from measured signals: the innovations of a calibrated observer.

The table is a cascade with a measured middle: volts -> servo -> encoder -> plate -> ball -> camera.
So the servo's part predicts the encoder's next count from the volts, and the ball's part predicts
the next exposure from the *measured* encoder angles: servo-side and ball-side effects show in two
separate channels. Shafts are rigid here (a play is its operator); every effect is the compiled
equation that the simulator calls. With true parameters and no noise the innovations vanish with
the tick.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rig.log import Log
from rig.parameters import Rig
from rig.plant_record import pack
from rig.predict_ball import LONGEST_GAP_S, look_ahead, predict_ball
from rig.predict_servo import predict_axis

NOISE = np.dtype(
    [
        ("servo_process", np.float64, (2,)),  # of the speed, rad/s/sqrt(s)
        ("servo_measured", np.float64, (2,)),  # of the encoder, rad
        ("ball_process", np.float64),  # of the velocity, m/s/sqrt(s)
        ("ball_measured", np.float64),  # of the camera, m
        ("ball_memory_s", np.float64),  # in which the camera's noise forgets itself; 0: white
    ]
)


@dataclass(frozen=True, eq=False)
class Signals:
    """What a log gives to predict from; a channel that it lacks is empty.

    t_s (n,), volts_V and theta_rad (n, 2), exposed_s (k,), ball_m (k, 2); fresh (k,): exposures at
    which the ball's filter starts anew, if any; driven: axes with a servo channel (the others'
    volts are taken as 0).
    """

    t_s: np.ndarray
    volts_V: np.ndarray
    theta_rad: np.ndarray
    exposed_s: np.ndarray
    ball_m: np.ndarray
    fresh: np.ndarray | None = None
    driven: tuple[bool, bool] = (True, True)

    def has_servo(self, a: int) -> bool:
        """Volts and angle of axis `a` are there in every row."""
        if not self.driven[a]:
            return False
        pair = self.volts_V, self.theta_rad
        n = len(self.t_s)
        return n > 1 and all(len(p) == n and np.isfinite(p[:, a]).all() for p in pair)


def signals(log: Log, *, camera_delay_s: float) -> Signals:
    """Take the signals of a log's rows; `camera_delay_s` dates observations without a stamp."""
    exposed, ball = log.ball(camera_delay_s)
    pair = [np.column_stack([log[f"{n}_x_{u}"], log[f"{n}_y_{u}"]]) for n, u in _PAIRS]
    return Signals(np.array(log["t_s"]), pair[0], pair[1], exposed, ball)


_PAIRS = (("voltage", "V"), ("theta", "rad"))


@dataclass(frozen=True, eq=False)
class Innovations:
    """Servo (n, 2) [rad] and ball (k, 2) [m]: measured minus predicted, NaN before a prediction;
    their standard deviations as the filters expect them, servo (n, 2), ball (k,)."""

    servo: np.ndarray
    servo_std: np.ndarray
    ball: np.ndarray
    ball_std: np.ndarray


def noise(
    *,
    servo_process: float | tuple[float, float] = 0.2,
    servo_measured: float | tuple[float, float] = 4.4e-4,
    ball_process: float = 0.002,
    ball_measured: float = 3e-4,
    ball_memory_s: float = 0.0,
) -> np.record:
    """Noise levels of the filters; the encoder's is a count over sqrt(12)."""
    record = np.zeros(1, NOISE)[0]
    record["servo_process"], record["servo_measured"] = servo_process, servo_measured
    record["ball_process"], record["ball_measured"] = ball_process, ball_measured
    record["ball_memory_s"] = ball_memory_s
    return record


def predict(rig: Rig, known: Signals, levels: np.record) -> Innovations:
    """Innovations of a log under the model `rig`, effects included."""
    p = pack(rig)
    servo = servo_innovations(
        p, known, levels, (rig.servo.gain_rad_s_V,) * 2, (rig.servo.time_constant_s,) * 2
    )
    return Innovations(*servo, *ball_innovations(p, known, levels))


def servo_innovations(
    p: np.record,
    known: Signals,
    levels: np.record,
    gain_rad_s_V: Sequence[float],
    time_constant_s: Sequence[float],
    axes: tuple[int, ...] = (0, 1),
) -> tuple[np.ndarray, np.ndarray]:
    """Innovations and their expected deviations, (n, 2) each [rad]; NaN where nothing is known."""
    shape = known.theta_rad.shape
    out, std = np.full(shape, np.nan), np.full(shape, np.nan)
    for a in axes:
        if known.has_servo(a):
            predict_axis(
                p, levels, a, known.t_s, known.volts_V, known.theta_rad,
                gain_rad_s_V[a], time_constant_s[a], out, std,
            )  # fmt: skip
    return out, std


def ball_innovations(
    p: np.record, known: Signals, levels: np.record
) -> tuple[np.ndarray, np.ndarray]:
    """Innovations (k, 2) [m] of the camera and their expected deviation (k,)."""
    k = len(known.exposed_s)
    out, std = np.full((k, 2), np.nan), np.full(k, np.nan)
    if k:
        fresh = known.fresh if known.fresh is not None else np.zeros(k, np.bool_)
        predict_ball(
            p, levels, known.t_s, known.theta_rad, known.exposed_s, known.ball_m, fresh,
            LONGEST_GAP_S, out, std,
        )  # fmt: skip
    return out, std


def ball_ahead(
    p: np.record, known: Signals, levels: np.record, *, horizon_s: float = 1.0, every_s: float = 0.5
) -> np.ndarray:
    """Errors (k, 2) [m] of the ball's place predicted `horizon_s` ahead from the angles alone.

    Row i belongs to the exposure in which the prediction ends; NaN where none does.
    """
    k = len(known.exposed_s)
    errors = np.full((k, 2), np.nan)
    if k:
        fresh = known.fresh if known.fresh is not None else np.zeros(k, np.bool_)
        look_ahead(
            p, levels, known.t_s, known.theta_rad, known.exposed_s, known.ball_m, fresh,
            horizon_s, every_s, errors,
        )  # fmt: skip
    return errors
