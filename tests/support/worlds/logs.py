"""From a plant to (columns, rig.toml, truth): defaults, small faults, excitation and noise."""

import numpy as np

from tests.support.worlds.loops import Loop, run_axis, run_positions, run_table
from tests.support.worlds.plant import Ball, Servo

DEG = np.pi / 180.0
GAIN_rad_s_V, TAU_s = 1.53, 0.025
HOLLOW, SOLID = 1.5, 2.5  # m r^2 / J
World = tuple[dict[str, np.ndarray], str, dict]


def servo(**changes) -> Servo:
    """A faultless servo; a number serves both axes, a pair (x, y)."""
    values = dict.fromkeys(Servo._fields, 0.0)
    values |= {"gain_rad_s_V": GAIN_rad_s_V, "tau_s": TAU_s, "extra_speed_rad_s": 0.1} | changes
    return Servo(**{k: np.broadcast_to(v, 2).astype(float) for k, v in values.items()})


def ball(**changes) -> Ball:
    """A faultless hollow ball on a still, level, plane plate without walls."""
    return Ball(
        **{
            "spin": HOLLOW,
            "radius_m": 0.019625,
            "arm_m": 0.0254,
            "side_m": 0.275,
            "level_rad": np.zeros(2),
            "bowl_1_s2": 0.0,
            "rolling_m_s2": 0.0,
            "felt_m_s2": 0.0,
            "drag_1_s": 0.0,
            "off_centre_m": 0.0,
            "waves": np.zeros((0, 4)),
            "mu": 1e9,
            "walls": False,
            "restitution": 0.5,
            "swing_hz": 0.0,
            "swing_damping": 0.1,
            "centred_rad": 0.0,
            **changes,
        }
    )


def loop(**changes) -> Loop:
    """500 Hz, 4096 counts, 60 Hz camera with 12 ms; a PD of 3.45 rad/m and 2.11 rad s/m."""
    return Loop(
        **{
            "rows_hz": 500.0,
            "counts": 4096.0,
            "camera_hz": 60.0,
            "delay_s": 0.012,
            "scale": 0.0,
            "yaw_rad": 0.0,
            "kp_rad_m": 3.45,
            "kd_rad_s_m": 2.11,
            "ki_rad_m_s": 0.3,
            "speed_filter_s": 1.0 / 60.0,
            "angle_limit_rad": 0.5,
            "inner_V_rad": 14.0,
            "limit_V": 6.0,
            "lag_s": 0.0,
            **changes,
        }
    )


def small_faults(rng: np.random.Generator) -> tuple[dict, dict, dict]:
    """Changes of servo, ball and loop inside half of the default tolerances."""

    def draw(size, n=None):
        return rng.uniform(-0.5 * size, 0.5 * size, n)

    servo_faults = {
        "gain_rad_s_V": GAIN_rad_s_V * (1.0 + draw(0.05, 2)),
        "tau_s": TAU_s * (1.0 + draw(0.1, 2)),
        "offset_V": draw(0.02, 2),
        "dead_V": abs(draw(0.01, 2)),
        "asymmetry": draw(0.005, 2),
        "friction_V": abs(draw(0.015, 2)),
        "joint_rad": abs(draw(0.08 * DEG, 2)),
    }
    ball_faults = {"level_rad": draw(0.02 * DEG, 2), "rolling_m_s2": abs(draw(0.0015))}
    loop_faults = {
        "delay_s": 0.012 + draw(0.002),
        "scale": draw(0.003),
        "yaw_rad": draw(0.15 * DEG),
    }
    return servo_faults, ball_faults, loop_faults


def steps(rng: np.random.Generator, n: int, rows_hz: float, size, hold_s=(1.0, 3.0)) -> np.ndarray:
    """Random levels in [-size, size] held for random times, shape (n,)."""
    out, row = np.empty(n), 0
    while row < n:
        end = row + max(1, int(rng.uniform(*hold_s) * rows_hz))
        out[row:end] = rng.uniform(-size, size)
        row = end
    return out


def coloured(rng: np.random.Generator, shape, sd: float, memory_s: float, rows_hz: float):
    """First-order noise of standard deviation sd; memory_s = 0: white."""
    white = rng.normal(0.0, 1.0, shape)
    if memory_s == 0.0:
        return sd * white
    keep = np.exp(-1.0 / (memory_s * rows_hz))
    out = np.empty(shape)
    value = white[0]
    for row in range(shape[0]):
        value = keep * value + np.sqrt(1.0 - keep**2) * white[row]
        out[row] = value
    return sd * out


def pink(rng: np.random.Generator, shape, sd: float) -> np.ndarray:
    """1/f noise (power falls with the frequency) of standard deviation sd."""
    spectrum = np.fft.rfft(rng.normal(0.0, 1.0, shape), axis=0)
    weight = np.r_[0.0, 1.0 / np.sqrt(np.arange(1, len(spectrum)))]
    out = np.fft.irfft(spectrum * weight[:, None], n=shape[0], axis=0)
    return sd * out / out.std(axis=0)


def table_columns(log: np.ndarray, rows_hz: float) -> dict[str, np.ndarray]:
    """Columns of the contract, cut where the ball's contact point leaves the plate."""
    names = "voltage_x_V voltage_y_V theta_x_rad theta_y_rad ball_x_m ball_y_m".split()
    return {"t_s": np.arange(len(log)) / rows_hz} | dict(zip(names, log.T, strict=True))


def table_log(
    rng, servo_changes, ball_changes, loop_changes, seconds=40.0, size_m=0.09, **noise
) -> dict[str, np.ndarray]:
    """Random steps on a table with small faults; smaller steps where the ball would fall.

    noise: torque_V, push (rows, 2), m/s2), slipped (rows, 2), each added to the small own ones.
    """
    a, b, c = small_faults(rng)
    p, plate = servo(**(a | servo_changes)), ball(**(b | ball_changes))
    settings = loop(**(c | loop_changes))
    n = int(seconds * settings.rows_hz)
    torque = 0.01 * rng.normal(size=(n, 2)) + noise.get("torque_V", 0.0)
    push = coloured(rng, (n, 2), 0.003, 0.05, settings.rows_hz) + noise.get("push", 0.0)
    slipped = np.zeros((n, 2)) + noise.get("slipped", 0.0)
    camera = rng.normal(0.0, 0.0003, (n, 2))
    targets = np.stack([steps(rng, n, settings.rows_hz, size_m) for _ in range(2)], axis=1)
    for shrink in (1.0, 0.8, 0.6, 0.4, 0.2):
        log = run_table(
            p, plate, settings, np.zeros(2), shrink * targets, torque, push, slipped, camera
        )
        if np.nanmax(np.abs(log[:, 4:])) < 0.5 * plate.side_m:
            return table_columns(log, settings.rows_hz)
    raise RuntimeError(f"the ball fell at x, y of {np.nanmax(np.abs(log[:, 4:]), axis=0)} m")


def axis_log(
    rng,
    servo_changes,
    seconds=40.0,
    rows_hz=500.0,
    counts=4096.0,
    target_rad=0.0,
    open_V=0.0,
    inner_V_rad=14.0,
    limit_V=6.0,
    torque_V=0.0,
    hold_s=(0.3, 1.5),
) -> dict[str, np.ndarray]:
    """One servo axis alone under random steps of the target angle and of open-loop volts."""
    n = int(seconds * rows_hz)
    torque = 0.01 * rng.normal(size=n) + torque_V
    targets = steps(rng, n, rows_hz, target_rad, hold_s)
    volts = steps(rng, n, rows_hz, open_V, hold_s)
    gain = inner_V_rad if target_rad else 0.0
    log = run_axis(servo(**servo_changes), rows_hz, counts, gain, limit_V, targets, volts, torque)
    return {"t_s": np.arange(n) / rows_hz, "voltage_x_V": log[:, 0], "theta_x_rad": log[:, 1]}


def position_log(
    rng, rows_hz, delay_s, ball_changes, seconds=60.0, size_m=0.06, push_m_s2=0.03, lag_s=0.0
) -> dict[str, np.ndarray]:
    """A table whose servos take an angle; the gains suit a loop that is `delay_s` late."""
    n = int(seconds * rows_hz)
    speed = min(1.6, 0.25 / (delay_s + lag_s))  # rad/s of the closed loop
    plate = ball(**ball_changes)
    factor = plate.spin / (1.0 + plate.spin) * 9.81 * 2.0 * plate.arm_m / plate.side_m
    kp, kd = speed**2 / factor, 1.6 * speed / factor
    gains = {"kp_rad_m": kp, "kd_rad_s_m": kd, "ki_rad_m_s": 0.15 * kp * speed}
    settings = loop(rows_hz=rows_hz, delay_s=delay_s, speed_filter_s=0.08, lag_s=lag_s, **gains)
    push = coloured(rng, (n, 2), push_m_s2, 0.05, rows_hz)
    camera = rng.normal(0.0, 0.0005, (n, 2))
    targets = np.stack([steps(rng, n, rows_hz, size_m, (2.0, 5.0)) for _ in range(2)], axis=1)
    for shrink in (1.0, 0.8, 0.6, 0.4, 0.2):
        log = run_positions(plate, settings, shrink * targets, push, camera)
        if np.abs(log[:, 2:]).max() < 0.5 * plate.side_m:
            names = ("theta_x_rad", "theta_y_rad", "ball_x_m", "ball_y_m")
            return {"t_s": np.arange(n) / rows_hz} | dict(zip(names, log.T, strict=True))
    raise RuntimeError(f"the ball fell at x, y of {np.abs(log[:, 2:]).max(axis=0)} m")


def rig_toml(**sections: dict) -> str:
    """A rig file; a table without assumed friction unless `drive` says otherwise."""
    sections = {"drive": {"arm_friction_nm": 0.0, "joint_friction_nm": 0.0}} | sections
    lines = []
    for section, keys in sections.items():
        if section == "top":
            lines[:0] = [f"{key} = {value}" for key, value in keys.items()]
            continue
        lines.append(f"[{section}]")
        lines += [f"{key} = {str(v).lower()}" for key, v in keys.items()]
    return "\n".join(lines) + "\n"


def truth(required: dict, *accepted: str, kind: str = "effect", **more) -> dict:
    """What is really there.

    kind: effect, healthy, unknown or recalibrate; required: {name: {axis: {key: value}}}, any of
    the names joined by "|" will do; accepted: names that may stand beside them, twins included.
    """
    return {"kind": kind, "required": required, "accepted": list(accepted), **more}
