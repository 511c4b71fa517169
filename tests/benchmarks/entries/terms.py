"""The columns of every effect of the catalogue, for the regressions (see `signals`).

What is not linear in its size stands as its first order, with the size that a lab would look for:
plays as half their width times the side that touches, a saturation as the volts above 70 % of the
largest. Effects that only scale another one's column (twins) stand under one name.
"""

import numpy as np

from tests.benchmarks.entries.signals import (
    BALL_HZ,
    G_M_S2,
    SERVO_HZ,
    Case,
    Equation,
    Filter,
    Key,
    positions,
    relay,
)


def equations(case: Case) -> list[Equation]:
    """Servo x, y (where volts or an angle are there to be explained) and ball x, y."""
    found = [servo(case, axis) for axis in "xy"] if case.voltage else []
    return found + [ball(case, axis) for axis in "xy"]


def speed_of(theta: np.ndarray, rate_hz: float) -> np.ndarray:
    width = round(0.03 * rate_hz) | 1
    smooth = np.convolve(np.pad(theta, width // 2, mode="edge"), np.ones(width) / width, "valid")
    return np.gradient(smooth, 1 / rate_hz)


def servo(case: Case, axis: str) -> Equation:
    """In volts: K V = tau theta'' + theta' without anything; the sampled V holds for a tick."""
    told = case.rig["servo"]
    K, tau = told["gain_rad_s_V"], told["time_constant_s"]
    f, log, t = Filter(SERVO_HZ, case.rate_hz), case.log, case.log["t_s"]
    theta, V = case.angle(axis), log[f"voltage_{axis}_V"]
    V = np.r_[V[0], 0.5 * (V[1:] + V[:-1])]  # held, so half a tick late
    other = log[f"voltage_{'y' if axis == 'x' else 'x'}_V"]
    w, step = speed_of(theta, case.rate_hz), 2 * np.pi / told["encoder_counts_per_rev"]
    sign, top = np.tanh(w / 0.02), 0.7 * np.abs(V).max()
    side = relay(theta, 1.5 * step)
    raw = {
        ("coulomb_friction", "friction_V"): sign,
        ("stribeck_friction", "extra_V"): sign * np.exp(-((w / 0.1) ** 2)),
        ("dead_zone", "half_width_V"): np.tanh(V / 0.05),
        ("gain_asymmetry", "fraction"): -np.abs(V),
        ("viscous_asymmetry", "fraction_1"): np.abs(w) / K,
        ("voltage_offset", "offset_V"): -np.ones(len(t)),
        ("saturation", "cut_share"): np.sign(V) * np.maximum(np.abs(V) - top, 0.0),
        ("input_delay", "delay_s"): np.gradient(V, 1 / case.rate_hz),
        ("cogging", "sine_V"): -np.sin(24 * theta),
        ("cogging", "cosine_V"): -np.cos(24 * theta),
        ("gain_drift", "rate_1_s"): t * V,
    }
    columns: dict[Key, np.ndarray] = {(n, axis, k): -f(v) for (n, k), v in raw.items()}
    columns["supply_sag", "xy", "drop_1_V"] = -f(V * (np.abs(V) + np.abs(other)))
    columns["gear_backlash", axis, "play_rad"] = -(f(side, 1) + tau * f(side, 2)) / (2 * K)
    e = (tau * f(theta, 2) + f(theta, 1)) / K - f(V)
    free = np.column_stack([f(V), f(theta, 2)])
    states = {"V": f(V), "w": f(w), "theta": f(theta), "sign": f(sign), "t": f(t)}
    return Equation(f"servo_{axis}", e, columns, free, states)


def ball(case: Case, axis: str) -> Equation:
    """In m/s2: x'' = A sin(theta) without anything; A as the rig file has it."""
    f, t = Filter(BALL_HZ, case.rate_hz), case.log["t_s"]
    across = "y" if axis == "x" else "x"
    A, B = (G_M_S2 * case.ratio(a) for a in (axis, across))
    theta, cross = case.angle(axis), case.angle(across)
    x, y = positions(case, axis), positions(case, across)
    v, w = speed_of(x, case.rate_hz), speed_of(y, case.rate_hz)
    a, sign = A * np.sin(theta), -1.0 if axis == "x" else 1.0
    side, k = relay(theta, 0.003), A / case.ratio(axis) * 0.6
    raw = {
        ("joint_backlash", axis, "play_rad"): -A * side / 2,
        ("transmission_ripple", axis, "sine_rad"): A * np.sin(10 * theta),
        ("transmission_ripple", axis, "cosine_rad"): A * np.cos(10 * theta),
        ("linkage_quadratic", axis, "coefficient_1_rad"): A * theta**2,
        ("linkage_cubic", axis, "coefficient_1_rad2"): A * theta**3,
        ("cross_coupling", axis, "fraction"): A * np.sin(cross),
        ("level_offset", axis, "slope_rad"): k * np.ones(len(t)),
        ("level_drift", axis, "rate_rad_s"): k * t,
        ("plate_bowl", "xy", "stiffness_1_s2"): -x,
        ("rolling_resistance", "xy", "deceleration_m_s2"): -v / np.maximum(np.hypot(v, w), 0.01),
        ("viscous_drag", "xy", "rate_1_s"): -v,
        ("camera_delay", "xy", "extra_s"): -np.gradient(a, 1 / case.rate_hz),
        ("camera_scale", "xy", "fraction"): a,
        ("camera_yaw", "xy", "angle_rad"): sign * B * np.sin(cross),
    }
    columns: dict[Key, np.ndarray] = {key: f(value) for key, value in raw.items()}
    columns["lens_distortion", "xy", "k1_1_m2"] = f((x * x + y * y) * x, 2)
    e = f(x, 2) - f(a)
    states = {
        "theta": f(theta),
        "other": f(cross),
        "x": f(x),
        "v": f(v),
        "side": f(side),
        "t": f(t),
    }
    calm = f(np.abs(log_of(case, "push"))) < 1e-3  # a push is in no equation
    columns, states = ({n: c[calm] for n, c in d.items()} for d in (columns, states))
    return Equation(f"ball_{axis}", e[calm], columns, np.zeros((calm.sum(), 0)), states)


def log_of(case: Case, name: str) -> np.ndarray:
    """A column of the log, zeros where it is missing."""
    return case.log.get(name, np.zeros(len(case.log["t_s"])))
