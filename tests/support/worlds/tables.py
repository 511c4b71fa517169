"""Tables under volts with a known fault of real size."""

import numpy as np

from tests.support.worlds.logs import World, rig_toml, table_log, truth


def k_far_off(seed: int) -> World:
    """K is 90 % above the rig file's 1.53 rad/s/V."""
    rng = np.random.default_rng(seed)
    gain = 1.9 * 1.53
    columns = table_log(rng, {"gain_rad_s_V": gain}, {}, {"inner_V_rad": 8.0})
    calibrated = {"gain_x_rad_s_V": gain, "gain_y_rad_s_V": gain}
    return columns, rig_toml(), truth({}, kind="recalibrate", calibrated=calibrated)


def bowl(seed: int) -> World:
    """A plate bowed by 4 1/s2: acceleration - 4 position."""
    rng = np.random.default_rng(seed)
    columns = table_log(rng, {}, {"bowl_1_s2": 4.0}, {"kp_rad_m": 6.0, "ki_rad_m_s": 2.0})
    return columns, rig_toml(), truth({"plate_bowl": {"xy": {"stiffness_1_s2": 4.0}}})


def soft_friction(seed: int) -> World:
    """Dry friction 0.19 V tanh(omega / 0.05 rad/s), and 0.08 V more below 0.15 rad/s."""
    rng = np.random.default_rng(seed)
    friction = {"friction_V": 0.19, "softness_rad_s": 0.05, "extra_V": 0.08}
    columns = table_log(rng, friction | {"extra_speed_rad_s": 0.15}, {}, {})
    size = {"friction_V": 0.19, "softness_rad_s": 0.05}
    found = truth({"coulomb_friction": {"x": size, "y": size}}, "stribeck_friction")
    return columns, rig_toml(), found


def wide_dead_zone_table(seed: int) -> World:
    """A dead zone of 1.3 V on both axes."""
    rng = np.random.default_rng(seed)
    columns = table_log(rng, {"dead_V": 1.3}, {}, {"inner_V_rad": 40.0, "limit_V": 10.0})
    size = {"half_width_V": 1.3}
    rig = rig_toml(servo={"voltage_limit_V": 10.0})
    return columns, rig, truth({"dead_zone": {"x": size, "y": size}})


def loaded_joint(seed: int) -> World:
    """Joint play of 2 degrees; the plate's friction of 0.155 V loads the arm at the flanks alone.

    The rig file keeps the assumed friction of arm and joints.
    """
    rng = np.random.default_rng(seed)
    columns = table_log(rng, {"joint_rad": 0.035, "joint_V": 0.155}, {}, {})
    size = {"play_rad": 0.035}
    found = truth({"joint_backlash": {"x": size, "y": size}}, "coulomb_friction")
    return columns, "", found


def falling_joint(seed: int) -> World:
    """Joint play of 2 degrees on a table without friction: the plate falls to the side of the ball.

    3 g 10 cm out turn a plate of 6.4e-5 kg m2 by 0.1 * 85 rad/s2; it bounces with 0.5.
    """
    rng = np.random.default_rng(seed)
    weight_1_m_s2 = 0.003 * 9.81 * (2 * 0.0254 / 0.275) / 6.4e-5
    plate = {"joint_rad": (0.035, 0.0), "fall_1_m_s2": (weight_1_m_s2, 0.0), "bounce": 0.5}
    columns = table_log(rng, plate, {}, {})
    return columns, rig_toml(), truth({"joint_backlash": {"x": {"play_rad": 0.035}}})


def coasting_gears(seed: int) -> World:
    """Gear play of 2 degrees; the arm coasts through the gap, damped by 4 1/s and 8 rad/s2."""
    rng = np.random.default_rng(seed)
    gears = {"gear_rad": 0.035, "coast_1_s": 4.0, "coast_rad_s2": 8.0}
    columns = table_log(rng, gears, {}, {})
    size = {"play_rad": 0.035}
    return columns, rig_toml(), truth({"gear_backlash": {"x": size, "y": size}})


def walls(seed: int) -> World:
    """Healthy, with a rim; targets beyond the rim keep the ball lying at a wall at times."""
    rng = np.random.default_rng(seed)
    columns = table_log(rng, {}, {"walls": True}, {}, size_m=0.16)
    rig = rig_toml(walls={"present": True, "restitution": 0.5})
    return columns, rig, truth({}, kind="healthy")


def five_runs(seed: int) -> World:
    """Five runs of 8 s in one log, t_s restarts; dry friction of 0.15 V on x."""
    rng = np.random.default_rng(seed)
    friction = {"friction_V": (0.15, 0.0)}
    runs = [table_log(rng, friction, {}, {}, seconds=8.0) for _ in range(5)]
    columns = {key: np.concatenate([run[key] for run in runs]) for key in runs[0]}
    found = truth({"coulomb_friction": {"x": {"friction_V": 0.15}}}, "stribeck_friction")
    return columns, rig_toml(), found
