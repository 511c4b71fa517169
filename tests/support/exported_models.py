"""One course on our own simulator, in MuJoCo and in an FMI importer, from the exported models."""

import importlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.export.export_model import export_model
from rig import three_arms
from rig.linkage import THREE_ARMS
from rig.parameters import Rig
from rig.plant import plant
from rig.plant.plant_record import no_volts, pack
from rig.plant.position_servo import mixed, quantised
from rig.simulation.simulator import table_tick

SECONDS = 2.0


@dataclass(frozen=True)
class Motion:
    """Rows by tick, at its end: arms' angles [rad], sines of the plate's tilt, ball [m]."""

    arms: np.ndarray
    sines: np.ndarray
    ball: np.ndarray


def course(rig: Rig, seconds: float = SECONDS) -> np.ndarray:
    """Volts or angles of both axes by tick (n, 2) that leave the ball on the plate.

    The angle is sin(w t) - 2 sin(2 w t), which pushes the ball there and back, volts its slope,
    less the table's own offset. Angles change at the servo's period only and are whole quanta, as
    the servo would make them.
    """
    t = np.arange(round(seconds * rig.control_rate_hz)) / rig.control_rate_hz
    w = 2 * np.pi * np.array([0.9, 0.7])
    if not rig.servo.takes_angle:
        t = t[:, None]
        offsets = rig.effects.get("voltage_offset", {})
        offset = [offsets.get(n, {}).get("offset_V", 0.0) for n in "xy"]
        return [1.3, -1.1] * (np.cos(w * t) - 4 * np.cos(2 * w * t)) / 5 - offset
    size = 0.04 if rig.linkage.kind == THREE_ARMS else 0.2
    period, quantum = max(rig.servo.pair("period_s")), max(rig.servo.pair("quantum_rad"))
    t = (np.floor(t / period + 1e-9) * period if period else t)[:, None]
    told = size * (np.sin(w * t) - 2 * np.sin(2 * w * t)) / 2
    if rig.linkage.kind == THREE_ARMS or not quantum:
        return told
    return np.floor(told / quantum + 0.5) * quantum


def ours(rig: Rig, driven: np.ndarray, start: tuple[float, float] = (0.0, 0.0)) -> Motion:
    """The course on our own simulator."""
    p, history, seen = pack(rig), no_volts(rig), np.zeros(7)
    state, tick = plant.rest(start, float(p["height"])), 1 / rig.control_rate_hz
    rows = []
    for k, told in enumerate(driven):
        t = k * tick
        end = t + tick - 0.5 * float(p["step_s"])
        table_tick(state, p, history, told, 0.0, 0.0, False, t, tick, end, seen)
        arms = state[plant.ARM].tolist()
        if rig.linkage.kind == THREE_ARMS:
            arms = [*state[plant.MOTOR], state[plant.SERVO_THIRD, 0]]
        rows.append((arms, seen[2:4].copy(), state[plant.BALL].copy()))
    return Motion(*(np.array(part) for part in zip(*rows, strict=True)))


def arms_of(rig: Rig, told: np.ndarray) -> np.ndarray:
    """Angles from level (3,) of three arms for a commanded tilt (2,), in the servos' quanta."""
    p, s = pack(rig), np.sin(told)
    size = rig.linkage.size
    angles = [three_arms.arm_angle(i, s[0], s[1], rig.linkage.height_m, size) for i in range(3)]
    level = float(p["level_arm"])
    quanta = [mixed.py_func(_Pairs(p), i, p["quantum_rad"]) for i in range(3)]
    return np.array(
        [quantised.py_func(a - level, float(q)) for a, q in zip(angles, quanta, strict=True)]
    )


class _Pairs:
    """A record's fields as attributes."""

    def __init__(self, p: np.record) -> None:
        self.share_x = p["share_x"]


def in_mujoco(
    rig: Rig, driven: np.ndarray, folder: Path, start: tuple[float, float] = (0.0, 0.0)
) -> Motion:
    """The course in MuJoCo, from the XML alone."""
    mujoco: Any = importlib.import_module("mujoco")
    export_model(rig, "table", "mjcf", folder / "table.xml")
    model = mujoco.MjModel.from_xml_path(str(folder / "table.xml"))
    data = mujoco.MjData(model)
    data.joint("ball").qpos[:2] += start
    arms = rig.linkage.kind == THREE_ARMS
    names = [f"arm_{n}" for n in ("012" if arms else "xy")]
    steps = round(1 / rig.control_rate_hz / model.opt.timestep)
    rows = []
    for told in driven:
        data.ctrl[:] = arms_of(rig, told) if arms else told
        mujoco.mj_step(model, data, steps)
        mujoco.mj_forward(model, data)  # positions by their new angles
        frame = data.body("plate").xmat.reshape(3, 3)
        ball = frame.T @ (data.body("ball").xpos - data.body("plate").xpos)
        angles = [float(data.joint(n).qpos[0]) for n in names]
        rows.append((angles, -frame[2, :2].copy(), ball[:2]))
    return Motion(*(np.array(part) for part in zip(*rows, strict=True)))


def in_fmi(
    rig: Rig, driven: np.ndarray, folder: Path, start: tuple[float, float] = (0.0, 0.0)
) -> Motion:
    """The course in FMPy, from the FMU alone."""
    fmpy: Any = importlib.import_module("fmpy")
    export_model(rig, "table", "fmu", folder / "table.fmu")
    fed = ["command_x_rad", "command_y_rad"] if rig.servo.takes_angle else None
    fed = fed or ["voltage_x_V", "voltage_y_V"]
    arms = [f"arm_{i}_rad" for i in range(3)] if rig.linkage.kind == THREE_ARMS else None
    arms = arms or ["theta_x_rad", "theta_y_rad"]
    read = [*arms, "tilt_sine_x", "tilt_sine_y", "ball_x_m", "ball_y_m"]
    tick = 1 / rig.control_rate_hz
    rows = [(k * tick, *told, 0.0, 0.0, False) for k, told in enumerate(driven)]
    kinds = [("time", float), *((n, float) for n in (*fed, "push_x_m_s2", "push_y_m_s2"))]
    signal = np.array(rows, dtype=[*kinds, ("held", bool)])
    found = fmpy.simulate_fmu(
        str(folder / "table.fmu"),
        stop_time=len(driven) * tick,
        step_size=tick,
        output_interval=tick,
        start_values={"start.ball_x_m": start[0], "start.ball_y_m": start[1]},
        input=signal,
        output=read,
    )
    columns = np.column_stack([found[name] for name in read])[1:]
    return Motion(columns[:, : len(arms)], columns[:, -4:-2], columns[:, -2:])


def apart(a: Motion, b: Motion) -> dict[str, float]:
    """Greatest difference of two motions: arms and plate [mrad], ball [mm], and the ball's RMS."""
    ball = np.abs(a.ball - b.ball)
    return {
        "arm_mrad": 1e3 * float(np.abs(a.arms - b.arms).max()),
        "plate_mrad": 1e3 * float(np.abs(a.sines - b.sines).max()),
        "ball_mm": 1e3 * float(ball.max()),
        "ball_rms_mm": 1e3 * float(np.sqrt((ball**2).mean())),
    }


MOST = {  # of a voltage table: every effect that MuJoCo can carry
    "coulomb_friction": {"x": {"friction_V": 0.10}, "y": {"friction_V": 0.06}},
    "stribeck_friction": {"x": {"extra_V": 0.05, "speed_rad_s": 0.2}},
    "voltage_offset": {"x": {"offset_V": -0.13}, "y": {"offset_V": 0.1}},
    "saturation": {"x": {"limit_V": 0.9}},
    "input_delay": {"x": {"delay_s": 0.006}, "y": {"delay_s": 0.004}},
    "cogging": {"y": {"amplitude_V": 0.1, "phase_rad": 0.5, "periods_per_turn": 40}},
    "gear_backlash": {"x": {"play_rad": 0.0175}, "y": {"play_rad": 0.01, "offset_rad": 0.002}},
    "joint_backlash": {"x": {"play_rad": 0.026}, "y": {"play_rad": 0.018, "offset_rad": 0.003}},
    "linkage_quadratic": {"x": {"coefficient_1_rad": 0.2}},
    "linkage_cubic": {"y": {"coefficient_1_rad2": -0.8}},
    "cross_coupling": {"x": {"fraction": 0.05}, "y": {"fraction": -0.04}},
    "level_offset": {"x": {"slope_rad": 0.0017}, "y": {"slope_rad": -0.0017}},
    "plate_bowl": {"xy": {"stiffness_1_s2": 0.6}},
    "rolling_resistance": {"xy": {"deceleration_m_s2": 0.01}},
    "viscous_drag": {"xy": {"rate_1_s": 0.15}},
}
MORE = {  # what only the FMU carries, too
    "dead_zone": {"x": {"half_width_V": 0.05}, "y": {"positive_V": 0.04, "negative_V": 0.08}},
    "gain_asymmetry": {"x": {"fraction": 0.06}},
    "viscous_asymmetry": {"y": {"fraction_1": 0.2}},
    "gain_drift": {"x": {"rate_1_s": 0.004}},
    "supply_sag": {"xy": {"drop_1_V": 0.01}},
    "transmission_ripple": {
        "x": {"amplitude_rad": 0.003, "phase_rad": 0.4, "periods_per_turn": 50}
    },
    "level_drift": {"x": {"rate_rad_s": 0.0002}},
}


def with_effects(rig: Rig, *more: dict) -> Rig:
    """The rig with exactly these effects."""
    return replace(rig, effects={name: axes for part in more for name, axes in part.items()})
