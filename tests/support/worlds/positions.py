"""Tables whose servos take an angle and whose camera is far later than the rig file says."""

import numpy as np

from tests.support.worlds.logs import SOLID, World, position_log, rig_toml, truth


def late_camera(seed: int, rows_hz: float, extra_s: float) -> World:
    """The camera is `extra_s` beyond the rig file's 12 ms; level error 0.007 rad, solid ball."""
    rng = np.random.default_rng(seed)
    level = 0.007 * np.array([1.0, -1.0]) * rng.choice([-1.0, 1.0])
    faults = {"spin": SOLID, "level_rad": level}
    columns = position_log(rng, rows_hz, 0.012 + extra_s, faults)
    rig = rig_toml(
        top={"control_rate_hz": rows_hz},
        ball={"hollow": False},
        camera={"rate_hz": rows_hz, "delay_s": 0.012, "noise_m": 0.0005},
    )
    slopes = {axis: {"slope_rad": float(value)} for axis, value in zip("xy", level, strict=True)}
    delay = {"xy": {"extra_s": extra_s}}
    accepted = ("servo_dead_time", "angle_zero")
    return columns, rig, truth({"camera_delay": delay, "level_offset": slopes}, *accepted)


def late_camera_100ms_at_30hz(seed: int) -> World:
    """0.1 s too little, 30 rows a second."""
    return late_camera(seed, 30.0, 0.1)


def late_camera_100ms_at_60hz(seed: int) -> World:
    """0.1 s too little, 60 rows a second."""
    return late_camera(seed, 60.0, 0.1)


def late_camera_100ms_at_100hz(seed: int) -> World:
    """0.1 s too little, 100 rows a second."""
    return late_camera(seed, 100.0, 0.1)


def late_camera_250ms_at_30hz(seed: int) -> World:
    """0.25 s too little, 30 rows a second."""
    return late_camera(seed, 30.0, 0.25)


def late_camera_250ms_at_60hz(seed: int) -> World:
    """0.25 s too little, 60 rows a second."""
    return late_camera(seed, 60.0, 0.25)


def late_camera_250ms_at_100hz(seed: int) -> World:
    """0.25 s too little, 100 rows a second."""
    return late_camera(seed, 100.0, 0.25)


def home_made_table(seed: int) -> World:
    """What a stranger records: commands as angles, servos with a lag of 60 ms, coarse pixels.

    30 rows a second, camera 0.1 s beyond the rig file, positions on a grid of 1.2 mm, forces of
    0.08 m/s2, level error 0.007 rad. Through the ball, delay and lag are one delay of 0.16 s and
    half a row, but for fast motion.
    """
    rng = np.random.default_rng(seed)
    level = 0.007 * np.array([1.0, -1.0])
    faults = {"spin": SOLID, "level_rad": level}
    columns = position_log(rng, 30.0, 0.112, faults, push_m_s2=0.08, lag_s=0.06)
    for key in ("ball_x_m", "ball_y_m"):
        columns[key] = np.round(columns[key] / 0.0012) * 0.0012
    rig = rig_toml(
        top={"control_rate_hz": 30.0},
        ball={"hollow": False},
        camera={"rate_hz": 30.0, "delay_s": 0.012, "noise_m": 0.0006},
    )
    found = truth(
        {
            "camera_delay|servo_lag|servo_dead_time": {"xy": {"extra_s": 0.177}},
            "level_offset|angle_zero": {"x": {"slope_rad": 0.007}, "y": {"slope_rad": -0.007}},
        }
    )
    return columns, rig, found
