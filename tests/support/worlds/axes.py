"""Single servo axes: only `voltage_x_V` and `theta_x_rad`."""

import numpy as np

from tests.support.worlds.logs import World, axis_log, coloured, rig_toml, truth


def wide_dead_zone(seed: int) -> World:
    """A positioned axis with a dead zone of 1.3 V."""
    rng = np.random.default_rng(seed)
    columns = axis_log(rng, {"dead_V": 1.3}, target_rad=0.6, inner_V_rad=20.0)
    return columns, rig_toml(), truth({"dead_zone": {"x": {"half_width_V": 1.3}}})


def bare_motor(seed: int) -> World:
    """A small motor (tau 17 ms) with 0.17 V of friction; the rig file keeps its assumed friction.

    What the assumed friction of arm and joints explains has to be told as assumed, so that
    "nothing missing" is a miss here.
    """
    rng = np.random.default_rng(seed)
    columns = axis_log(rng, {"tau_s": 0.017, "friction_V": 0.17}, open_V=2.0)
    rig = "[servo]\ntime_constant_s = 0.017\n"
    return columns, rig, truth({"coulomb_friction": {"x": {"friction_V": 0.17}}})


def asymmetric_viscous(seed: int) -> World:
    """A slow positioning axis at 1 kHz: 0.58 V of friction, 0.09 V of offset, 0.26 V/(rad/s)."""
    rng = np.random.default_rng(seed)
    axis = {"gain_rad_s_V": 0.69, "tau_s": 0.47, "friction_V": 0.58, "offset_V": 0.09}
    columns = axis_log(
        rng,
        axis | {"drag_V_s": 0.26},
        rows_hz=1000.0,
        counts=65536.0,
        target_rad=1.0,
        inner_V_rad=12.0,
        limit_V=10.0,
        hold_s=(1.0, 4.0),
    )
    rig = rig_toml(
        top={"control_rate_hz": 1000.0},
        servo={
            "gain_rad_s_V": 0.69,
            "time_constant_s": 0.47,
            "encoder_counts_per_rev": 65536,
            "voltage_limit_V": 10.0,
        },
    )
    found = truth(
        {
            "coulomb_friction": {"x": {"friction_V": 0.58}},
            "voltage_offset": {"x": {"offset_V": 0.09}},
            "viscous_asymmetry|coulomb_friction": {"x": {"fraction_1": 0.26 * 0.69}},
        },
        "stribeck_friction",
    )
    return columns, rig, found


def gyro_dead_zone(seed: int) -> World:
    """A dead zone of 1.3 V; the angle is the sum of a noisy, coarse rate with a slow drift."""
    rng = np.random.default_rng(seed)
    columns = axis_log(rng, {"dead_V": 1.3}, counts=1e9, target_rad=0.6, inner_V_rad=20.0)
    rate = np.gradient(columns["theta_x_rad"], 0.002) + rng.normal(0.0, 0.02, len(columns["t_s"]))
    rate += 0.002 + coloured(rng, rate.shape, 0.002, 10.0, 500.0)
    lsb = 0.00107  # rad/s: 16.4 counts for a degree a second
    columns["theta_x_rad"] = np.cumsum(np.round(rate / lsb) * lsb) * 0.002
    rig = rig_toml(servo={"encoder_counts_per_rev": 1000000})
    return columns, rig, truth({"dead_zone": {"x": {"half_width_V": 1.3}}})


def healthy_axis(seed: int) -> World:
    """An axis without a fault beyond 0.006 V of friction."""
    rng = np.random.default_rng(seed)
    columns = axis_log(rng, {"friction_V": 0.006}, target_rad=0.5)
    return columns, rig_toml(), truth({}, kind="healthy")
