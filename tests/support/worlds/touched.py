"""Tables whose ball a hand pushes now and then, which nobody recorded."""

import numpy as np

from tests.support.worlds.commanded import world_of
from tests.support.worlds.logs import DEG, World, rig_toml, table_log, truth


def _hand(rng: np.random.Generator, seconds: float = 40.0, rows_hz: float = 500.0) -> np.ndarray:
    """Forces of a hand (rows, 2) [m/s2]: six pushes of 0.2 to 0.6 s at random times, each in its
    own direction."""
    push = np.zeros((int(rows_hz * seconds), 2))
    for begin_s in rng.uniform(1.0, seconds - 2.0, 6):
        way, size = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.3, 0.6)
        rows = slice(int(rows_hz * begin_s), int(rows_hz * (begin_s + rng.uniform(0.2, 0.6))))
        push[rows] = size * np.cos(way), size * np.sin(way)
    return push


def touched_bowl(seed: int) -> World:
    """A plate bowed by 4 1/s2."""
    rng = np.random.default_rng(seed)
    gains = {"kp_rad_m": 6.0, "ki_rad_m_s": 2.0}
    columns = table_log(rng, {}, {"bowl_1_s2": 4.0}, gains, size_m=0.05, push=_hand(rng))
    return columns, rig_toml(), truth({"plate_bowl": {"xy": {"stiffness_1_s2": 4.0}}})


def touched_crooked(seed: int) -> World:
    """A plate that is 0.6 and -0.4 degrees off level."""
    rng = np.random.default_rng(seed)
    slopes = np.array([0.0105, -0.007])
    columns = table_log(rng, {}, {"level_rad": slopes}, {}, size_m=0.05, push=_hand(rng))
    size = {a: {"slope_rad": float(slope)} for a, slope in zip("xy", slopes, strict=True)}
    return columns, rig_toml(), truth({"level_offset": size})


def _touched(found: dict, seed: int, **changes) -> World:
    """RC servos: `changes` as of `world_of`."""
    rng = np.random.default_rng([seed, 1])
    return world_of(found, "rc", seed, pushed=_hand(rng, 60.0, 50.0), **changes)


def touched_lazy_servo(seed: int) -> World:
    """0.6 degree more dead band in x."""
    found = {"command_dead_band": {"x": {"half_width_rad": 0.6 * DEG}}}
    return _touched(found, seed, servo={"band_rad": (0.6 * DEG, 0.0)})


def touched_far_servo(seed: int) -> World:
    """The servos turn 7 % further than told, in y 5 % less far."""
    found = {"angle_scale": {"x": {"fraction": 0.07}, "y": {"fraction": -0.05}}}
    return _touched(found, seed, servo={"scale": (0.07, -0.05)})


def touched_late_servo(seed: int) -> World:
    """40 ms more lag in x, 30 ms in y."""
    size = {"x": {"lag_s": 0.04}, "y": {"lag_s": 0.03}}
    return _touched({"servo_lag": size}, seed, servo={"lag_s": (0.04, 0.03)})
