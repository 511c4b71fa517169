"""Inject an effect into a recorded log, exactly, by changing what was recorded.

Input side: the recorded volts are changed so that the volts which really acted are what the effect
makes of them: V_recorded = effect^-1(V_true). Sensor side: the recorded positions become what a
wrong camera would have said. Encoder side: the recorded angle becomes the one from which the effect
makes the true one. Each has its forward equation in `rig.plant.effect_equations`; what has
no inverse stands in `NOT_POSSIBLE` with the reason.
"""

from collections.abc import Callable, Mapping
from math import radians

import numpy as np

from rig.log import Log, exposures
from rig.plant.effect_equations import camera_map

Columns = dict[str, np.ndarray]
ByAxis = Mapping[str, Mapping[str, float]]
ANGLE_STEPS = 60  # Newton steps with a numerical slope, at most

NOT_POSSIBLE: dict[str, str] = {
    "coulomb_friction": "where the servo sticks no recorded voltage leads to the true one",
    "stribeck_friction": "as coulomb_friction",
    "viscous_asymmetry": "it needs the motor's speed, which an encoder's counts do not give",
    "saturation": "a clipped voltage has no inverse: the true one is not clipped",
    "gear_backlash": "the encoder would have to leave the motor",
    "joint_backlash": "the plate would have to leave the encoder",
    "cross_coupling": "the ball would have had to roll otherwise",
    "plate_bowl": "as cross_coupling",
    "rolling_resistance": "as cross_coupling",
    "viscous_drag": "as cross_coupling",
}
# With these the recorded angle is no longer the one that the motor turned: the volts are left out.
WITHOUT_VOLTS = ("transmission_ripple", "linkage_quadratic", "linkage_cubic")


def possible(log: Log) -> list[str]:
    """The sorted names of the effects that can be hidden in this log, judged by its channels."""
    names = []
    for axis in "xy":
        if log.has(f"voltage_{axis}_V", f"theta_{axis}_rad"):
            names += [*_VOLTS, "input_delay"]
        if log.has(f"theta_{axis}_rad", f"ball_{axis}_m"):
            names += [*_ANGLES, "level_offset", "level_drift"]
    if log.has("ball_x_m") or log.has("ball_y_m"):
        names += ["camera_delay", "camera_scale"]
    if log.has("ball_x_m", "ball_y_m"):
        names += ["camera_yaw", "lens_distortion"]
    if log.has("voltage_x_V", "voltage_y_V"):
        names += ["supply_sag"]
    return sorted(set(names))


def axes_with(log: Log, name: str) -> list[str]:
    """The axes ("x", "y") of the log whose channels allow the effect `name`, one that acts per
    axis.
    """
    first = "voltage_{}_V" if name in (*_VOLTS, "input_delay") else "ball_{}_m"
    return [a for a in "xy" if log.has(first.format(a), f"theta_{a}_rad")]


def inject(
    log: Log, effects: Mapping[str, ByAxis], *, ratio: float = 0.0, delay_s: float = 0.0
) -> Log:
    """The log that a table with these effects would have recorded of the same motion.

    effects: {name: {axis: {key: value}}} as in a rig file, applied in turn; ratio: 2 R_d/L of the
    linkage, needed by level_offset and level_drift; delay_s: the camera's delay [s], used where the
    log has no exposure times. Rows may be fewer (input_delay), and volts and motor speed are
    removed by an effect of `WITHOUT_VOLTS`. ValueError: an effect that cannot be hidden in this
    log, or is too large to have an inverse.
    """
    columns = {name: values.copy() for name, values in log.columns.items() if log.has(name)}
    there = possible(log)
    for name, by_axis in effects.items():
        if name not in there:
            why = NOT_POSSIBLE.get(name, "the log lacks the channel for it")
            raise ValueError(f"{name} cannot be hidden in this log: {why}")
        if name == "camera_delay":
            columns = _camera_delay(columns, by_axis["xy"]["extra_s"], delay_s)
        elif name in ("camera_scale", "camera_yaw", "lens_distortion"):
            _camera(columns, name, by_axis["xy"])
        elif name == "supply_sag":
            _sag(columns, by_axis["xy"]["drop_1_V"])
        elif name == "input_delay":
            columns = _input_delay(columns, by_axis)
        else:
            _one_axis_at_a_time(columns, name, by_axis, ratio)
    return Log.from_columns(columns, notes=log.notes)


def _one_axis_at_a_time(columns: Columns, name: str, by_axis: ByAxis, ratio: float) -> None:
    t = columns["t_s"]
    for axis, values in by_axis.items():
        theta = columns[f"theta_{axis}_rad"]
        if name in _VOLTS:
            key = f"voltage_{axis}_V"
            columns[key] = _VOLTS[name](columns[key], theta, t, values)
        elif name in _ANGLES:
            columns[f"theta_{axis}_rad"] = _angle_before(theta, _ANGLES[name], values)
        else:
            slope = values["slope_rad"] if name == "level_offset" else values["rate_rad_s"] * t
            sine = np.clip(np.sin(theta) - slope / ratio, -1, 1)
            columns[f"theta_{axis}_rad"] = np.arcsin(sine)
    if name in WITHOUT_VOLTS:
        for axis in "xy":
            columns.pop(f"voltage_{axis}_V", None)
            columns.pop(f"motor_speed_{axis}_rad_s", None)


# --- volts: from those that acted to those that a table with the effect would have recorded -------


def _dead_zone(v: np.ndarray, theta: np.ndarray, t: np.ndarray, p: Mapping[str, float]):
    """max(V - w, 0) + min(V + w, 0) backwards; zero stays zero."""
    half = p.get("half_width_V", 0.0)
    above, below = half + p.get("positive_V", 0.0), half + p.get("negative_V", 0.0)
    return np.where(v > 0, v + above, np.where(v < 0, v - below, 0.0))


def _asymmetry(v: np.ndarray, theta: np.ndarray, t: np.ndarray, p: Mapping[str, float]):
    return np.where(v > 0, v / (1 + p["fraction"]), v / (1 - p["fraction"]))


def _offset(v: np.ndarray, theta: np.ndarray, t: np.ndarray, p: Mapping[str, float]):
    return v - p["offset_V"]


def _drift(v: np.ndarray, theta: np.ndarray, t: np.ndarray, p: Mapping[str, float]):
    return v / (1 - p["rate_1_s"] * t)


def _cogging(v: np.ndarray, theta: np.ndarray, t: np.ndarray, p: Mapping[str, float]):
    return v - p["amplitude_V"] * np.sin(p["periods_per_turn"] * theta + p["phase_rad"])


_VOLTS: dict[str, Callable[..., np.ndarray]] = {
    "dead_zone": _dead_zone,
    "gain_asymmetry": _asymmetry,
    "voltage_offset": _offset,
    "gain_drift": _drift,
    "cogging": _cogging,
}


def _sag(columns: Columns, drop: float) -> None:
    """V = U (1 - drop S), S = |U_x| + |U_y|: with s = |V_x| + |V_y| it is s = S (1 - drop S)."""
    pair = [columns["voltage_x_V"], columns["voltage_y_V"]]
    s = np.abs(pair[0]) + np.abs(pair[1])
    root = 1 - 4 * drop * s
    if root.min() < 0:
        raise ValueError(f"supply_sag of {drop:g} 1/V cannot give the {s.max():.1f} V that acted")
    kept = 1 - drop * 2 * s / (1 + np.sqrt(root))
    columns["voltage_x_V"], columns["voltage_y_V"] = (v / kept for v in pair)


def _input_delay(columns: Columns, by_axis: ByAxis) -> Columns:
    """Volts recorded `delay` before they acted; the last rows, without volts yet, are left out."""
    t = columns["t_s"]
    longest = 0.0
    for axis, values in by_axis.items():
        volts, delay = columns[f"voltage_{axis}_V"], values["delay_s"]
        # Volts hold from row to row: at t + delay acts the newest row not later than that.
        row = np.searchsorted(t, t + delay + 1e-9, side="right") - 1
        columns[f"voltage_{axis}_V"] = volts[row]
        longest = max(longest, delay)
    kept = t <= t[-1] - longest + 1e-9
    return {name: values[kept] for name, values in columns.items()}


# --- angles: from the one that the plate felt to the one that the encoder would have read ---------


def _ripple(theta: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
    phase = p["phase_rad"]
    return p["amplitude_rad"] * (np.sin(p["periods_per_turn"] * theta + phase) - np.sin(phase))


_ANGLES: dict[str, Callable[[np.ndarray, Mapping[str, float]], np.ndarray]] = {
    "transmission_ripple": _ripple,
    "linkage_quadratic": lambda theta, p: p["coefficient_1_rad"] * theta**2,
    "linkage_cubic": lambda theta, p: p["coefficient_1_rad2"] * theta**3,
}


def _angle_before(felt: np.ndarray, error: Callable, p: Mapping[str, float]) -> np.ndarray:
    """theta with theta + error(theta) = felt, by Newton's steps. ValueError: it is not unique."""
    grid = np.linspace(felt.min() - radians(2), felt.max() + radians(2), 2000)
    if np.diff(grid + error(grid, p)).min() <= 0:
        raise ValueError("so large an error of the angle has no inverse: make it smaller")
    theta = np.interp(felt, grid + error(grid, p), grid)
    for _ in range(ANGLE_STEPS):
        step = 1e-6
        slope = 1 + (error(theta + step, p) - error(theta - step, p)) / (2 * step)
        change = (theta + error(theta, p) - felt) / slope
        theta = theta - change
        if np.abs(change).max() < 1e-14:
            break
    return theta


# --- camera -------------------------------------------------------------------------------------


def _camera(columns: Columns, name: str, values: Mapping[str, float]) -> None:
    """What a wrong camera says of every position."""
    blank = np.zeros_like(columns["t_s"])
    xy = [columns.get(f"ball_{a}_m", blank) for a in "xy"]
    scale, yaw, k1 = (values.get(key, 0.0) for key in ("fraction", "angle_rad", "k1_1_m2"))
    seen = np.array([camera_map(x, y, scale, yaw, k1) for x, y in zip(*xy, strict=True)])
    for a, axis in enumerate("xy"):
        if f"ball_{axis}_m" in columns:
            columns[f"ball_{axis}_m"] = seen[:, a]


def _camera_delay(columns: Columns, extra_s: float, delay_s: float) -> Columns:
    """Every observation comes `extra_s` later, with a stamp so much too late."""
    t, names = columns["t_s"], [n for n in ("ball_x_m", "ball_y_m") if n in columns]
    xy = np.column_stack([columns[n] for n in names])
    exposed = columns.get("ball_exposed_s", np.full(len(t), np.nan))
    same = ((xy[1:] == xy[:-1]) | (np.isnan(xy[1:]) & np.isnan(xy[:-1]))).all(axis=1)
    held = same & (np.isnan(exposed[1:]) | (exposed[1:] == exposed[:-1]))
    new = np.flatnonzero(~np.isnan(xy).all(axis=1) & ~np.concatenate(([False], held)))
    row = np.searchsorted(t, t[new] + extra_s - 1e-9)
    new, row = new[row < len(t)], row[row < len(t)]
    columns = dict(columns)
    for i, name in enumerate(names):
        columns[name] = np.full(len(t), np.nan)
        columns[name][row] = xy[new, i]
    columns["ball_exposed_s"] = np.full(len(t), np.nan)
    stamp = exposures(t, exposed, delay_s)
    columns["ball_exposed_s"][row] = stamp[new] + extra_s
    return columns
