"""One step ahead from measured signals: the innovations of a calibrated observer.

The table is a cascade with a measured middle: volts -> servo -> encoder -> plate -> ball -> camera.
So the servo's part predicts the encoder's next count from the volts, and the ball's part predicts
the next exposure from the *measured* encoder angles: servo-side and ball-side effects show in two
separate channels. Shafts are rigid here (a play is its operator); every effect is the compiled
equation that the simulator calls. With true parameters and no noise the innovations vanish with
the tick.
"""

from dataclasses import dataclass

import numpy as np

from rig.log import Log
from rig.parameters import Rig
from rig.plant_record import pack
from rig.predict_ball import predict_ball
from rig.predict_servo import predict_servo

NOISE = np.dtype(
    [
        (name, np.float64)
        for name in (
            "servo_process "  # of the speed, rad/s/sqrt(s)
            "servo_measured "  # of the encoder, rad
            "ball_process "  # of the velocity, m/s/sqrt(s)
            "ball_measured"  # of the camera, m
        ).split()
    ]
)


@dataclass(frozen=True, eq=False)
class Signals:
    """What a log gives to predict from; a channel that it lacks is empty.

    t_s (n,), volts_V and theta_rad (n, 2), exposed_s (k,), ball_m (k, 2).
    """

    t_s: np.ndarray
    volts_V: np.ndarray
    theta_rad: np.ndarray
    exposed_s: np.ndarray
    ball_m: np.ndarray


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
    servo_process: float = 0.2,
    servo_measured: float = 4.4e-4,
    ball_process: float = 0.002,
    ball_measured: float = 3e-4,
) -> np.record:
    """Noise levels of the filters; the encoder's is a count over sqrt(12)."""
    record = np.zeros(1, NOISE)[0]
    record["servo_process"], record["servo_measured"] = servo_process, servo_measured
    record["ball_process"], record["ball_measured"] = ball_process, ball_measured
    return record


def predict(rig: Rig, known: Signals, levels: np.record) -> Innovations:
    """Innovations of a log under the model `rig`, effects included."""
    p = pack(rig)
    n, k = len(known.t_s), len(known.exposed_s)
    servo, servo_std = np.full((n, 2), np.nan), np.full((n, 2), np.nan)
    ball, ball_std = np.full((k, 2), np.nan), np.full(k, np.nan)
    if known.volts_V.size and np.isfinite(known.volts_V).all():
        predict_servo(
            p, levels, known.t_s, known.volts_V, known.theta_rad, rig.servo.gain_rad_s_V,
            rig.servo.time_constant_s, servo, servo_std,
        )  # fmt: skip
    if k:
        predict_ball(
            p, levels, known.t_s, known.theta_rad, known.exposed_s, known.ball_m, ball, ball_std
        )
    return Innovations(servo, servo_std, ball, ball_std)
