"""Servos that take an angle, as MuJoCo's position actuators on the arms' hinges."""

from math import ceil

import numpy as np

from experiments.export.mjcf.parts import Document, add, stiff
from rig.plant.plant_record import STEP_S

STIFF_NM_RAD = 1e4  # chosen: a load of 1 N m turns a servo by 0.1 mrad
FAST_RAD_S = 300.0  # chosen: of a servo without lag; steps of some mrad settle in 13 ms


def mixed(p: np.record, i: int, field: str) -> float:
    """A field by axis of the record (dtype PLANT) as servo i has it."""
    share = float(p["share_x"][i])
    return share * float(p[field][0]) + (1 - share) * float(p[field][1])


def _least_rate(p: np.record, i: int) -> float:
    least = np.minimum(p["rate_limit_rad_s"], p["rate_limit_limit_rad_s"])
    share = float(p["share_x"][i])
    return share * float(least[0]) + (1 - share) * float(least[1])


def add_servo(
    document: Document, p: np.record, i: int, joint: str, name: str, limit_rad: float
) -> dict[str, float | str]:
    """Add servo i of a table (record p, dtype PLANT), to `joint`; the joint's attributes.

    With a lag T: an overdamped hinge, c omega = k(e - w), w the dead band as dry friction k w, the
    rate limit as the force limit c Omega + k w, the acceleration limit as c Omega over the inertia,
    which is at least c M of the motor's lag M: M T s^2 + T s + 1 as `rig.plant.position_servo` has.
    Without lag: a stiff hinge whose force limit is the acceleration limit, told a setpoint that
    moves at the rate limit.
    """
    lag = max(mixed(p, i, "lag_s") + mixed(p, i, "servo_lag_lag_s"), 0.0)
    band = mixed(p, i, "dead_band_rad") + mixed(p, i, "command_dead_band_half_width_rad")
    late = mixed(p, i, "dead_time_s") + mixed(p, i, "servo_dead_time_delay_s")
    scale, zero = mixed(p, i, "angle_scale_fraction"), mixed(p, i, "angle_zero_offset_rad")
    rate, change = _least_rate(p, i), mixed(p, i, "acceleration_limit_rad_s2")
    k = STIFF_NM_RAD
    common = {
        "name": name,
        "joint": joint,
        "ctrllimited": "true",
        "ctrlrange": (-limit_rad, limit_rad),
        "delay": late or None,
        "nsample": str(ceil(late / STEP_S) + 1) if late else None,
        "forcelimited": "true",
    }
    if lag > 0:
        damping = k * lag
        inertia = damping * max(mixed(p, i, "motor_lag_s"), rate / change)
        force = damping * rate + k * band
        own = {"gainprm": k * (1 + scale), "biastype": "affine", "biasprm": (k * zero, -k, 0)}
    else:
        inertia, damping = k / FAST_RAD_S**2, 0.0
        force = inertia * change + k * band
        own = {"kp": k, "kv": 2 * inertia * FAST_RAD_S, "slewmax": rate, "input": "pos"}
        if scale or zero:
            document.told.append(f"{name}: angle_scale and angle_zero of a servo without lag.")
    tag = "general" if lag > 0 else "pid"
    add(document.actuator, tag, forcerange=(-force, force), **own, **common)
    stop = float(p["stop_rad"])
    return {
        "armature": inertia,
        "damping": damping,
        "frictionloss": k * band,
        "limited": "true",
        "range": (-stop, stop),  # pyright: ignore
        **stiff("limit"),
        **stiff("friction"),
    }
