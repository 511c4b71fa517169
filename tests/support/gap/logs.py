"""Logs for the tests of the gap workflow's input: quick, exact, made without the simulator."""

import numpy as np

from rig.log import Log
from rig.parameters import Rig

RIG = Rig()


def table_log(
    *, rate_hz: float = 500.0, seconds: float = 12.0, seed: int = 1, frame_hz: float = 60.0
) -> dict[str, np.ndarray]:
    """Columns of a two-axis run: smooth angles, the volts that make them, a ball they roll.

    theta_a = sum of two sines (about 6 degrees); V from K, tau; the ball from Eq. 15.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(round(rate_hz * seconds)) / rate_hz
    columns = {"t_s": t}
    seen = np.diff(np.floor(t * frame_hz), prepend=-1.0) > 0
    for axis in "xy":
        theta, speed, bend, x = (np.zeros_like(t) for _ in range(4))
        for f, size in zip(rng.uniform((0.4, 0.8), (0.6, 1.2)), (0.08, 0.04), strict=True):
            w, phase = 2 * np.pi * f, rng.uniform(0, 2 * np.pi)
            theta += size * np.sin(w * t + phase)
            speed += size * w * np.cos(w * t + phase)
            bend -= size * w**2 * np.sin(w * t + phase)
            x -= RIG.ball_gain_m_s2 * size / w**2 * np.sin(w * t + phase)
        volts = (speed + RIG.servo.time_constant_s * bend) / RIG.servo.gain_rad_s_V
        step = RIG.servo.encoder_step_rad
        columns[f"voltage_{axis}_V"] = volts
        columns[f"theta_{axis}_rad"] = step * np.round(theta / step)
        ball = x + rng.normal(0, RIG.camera.noise_m, len(t))
        columns[f"ball_{axis}_m"] = np.where(seen, ball, np.nan)
    return columns


def log_of(columns: dict[str, np.ndarray]) -> Log:
    return Log.from_columns(columns)
