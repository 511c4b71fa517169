"""Tables on which nothing is missing, and whose noise is not what a textbook assumes."""

import numpy as np

from tests.support.worlds.logs import World, coloured, pink, rig_toml, table_log, truth

ROWS = 20000  # 40 s


def plain(seed: int) -> World:
    """Small faults inside the tolerances, white noise."""
    columns = table_log(np.random.default_rng(seed), {}, {}, {})
    return columns, rig_toml(), truth({}, kind="healthy")


def rubbing_joints(seed: int, seconds: float = 40.0) -> World:
    """The friction that the rig file assumes of arm and joints, 0.171 V, behind rigid shafts."""
    columns = table_log(np.random.default_rng(seed), {"friction_V": 0.1713}, {}, {}, seconds)
    return columns, "", truth({}, kind="healthy")


def coloured_torque(seed: int) -> World:
    """A torque noise of 0.03 V with a memory of 0.3 s on both motors."""
    rng = np.random.default_rng(seed)
    noise = coloured(rng, (ROWS, 2), 0.03, 0.3, 500.0)
    columns = table_log(rng, {}, {}, {}, torque_V=noise)
    return columns, rig_toml(), truth({}, kind="healthy")


def pink_drift(seed: int) -> World:
    """1/f noise on the motors (0.015 V) and on the ball (0.002 m/s2): inside the tolerances."""
    rng = np.random.default_rng(seed)
    volts, push = pink(rng, (ROWS, 2), 0.015), pink(rng, (ROWS, 2), 0.002)
    columns = table_log(rng, {}, {}, {}, torque_V=volts, push=push)
    return columns, rig_toml(), truth({}, kind="healthy")


def limit_cycle(seed: int) -> World:
    """High gains on a slow inner loop: both axes swing on their own at 0.56 Hz."""
    rng = np.random.default_rng(seed)
    gains = {"kp_rad_m": 4.0, "kd_rad_s_m": 4.0, "angle_limit_rad": 0.12, "inner_V_rad": 3.0}
    columns = table_log(rng, {}, {}, gains | {"ki_rad_m_s": 0.0}, size_m=0.03)
    return columns, rig_toml(), truth({}, kind="healthy")


def double_noise(seed: int) -> World:
    """Twice the process noise of the other logs, on motors and ball."""
    rng = np.random.default_rng(seed)
    volts = np.sqrt(3.0) * 0.01 * rng.normal(size=(ROWS, 2))
    push = np.sqrt(3.0) * coloured(rng, (ROWS, 2), 0.003, 0.05, 500.0)
    columns = table_log(rng, {}, {}, {}, torque_V=volts, push=push)
    return columns, rig_toml(), truth({}, kind="healthy")
