"""A ball on a plate that two position servos tilt, and whether an imported log says what it did.

It shares no code with the product: a servo is a dead time and a first-order lag, the ball rolls
with 5/7 of gravity, a PD controller sees it late and with noise.
"""

from dataclasses import dataclass

import numpy as np

STEP_S = 0.001
LARGEST_ANGLE_RAD = 0.5


@dataclass(frozen=True)
class Run:
    """What happened; each array but `t_s` (n,) is (n, 2): x, y."""

    t_s: np.ndarray
    command_rad: np.ndarray
    theta_rad: np.ndarray
    ball_m: np.ndarray
    target_m: np.ndarray


@dataclass(frozen=True)
class Told:
    """What a file tells: signals by their names in a log, and whether it tells everything.

    A signal is (n, 2) in m or rad, NaN where the file has none; `open_words` are what the
    question about what it lacks must hold one of.
    """

    t_s: np.ndarray
    signals: dict[str, np.ndarray]
    open_words: tuple[str, ...] = ()


def run(
    seed: int,
    rate_hz: float = 50.0,
    duration_s: float = 40.0,
    lever: float = 0.3,
    course: str = "steps",
    grid_rad: float = 0.0,
) -> Run:
    """One run: `lever` is plate angle per servo angle, `grid_rad` the command's own steps."""
    rng = np.random.default_rng(seed)
    steps = round(duration_s / STEP_S)
    every, dead, late = round(1 / rate_hz / STEP_S), 25, 35
    lag_s = rng.uniform(0.04, 0.07, 2)
    level = rng.uniform(-0.01, 0.01, 2)
    place, speed, theta = rng.uniform(-0.04, 0.04, 2), np.zeros(2), np.zeros(2)
    commands, places = np.zeros((steps, 2)), np.zeros((steps, 2))
    command, seen, seen_speed = np.zeros(2), place.copy(), np.zeros(2)
    corners = rng.uniform(-0.06, 0.06, (1000, 2))
    rows = []
    for step in range(steps):
        places[step] = place
        if step % every == 0:
            now = step * STEP_S
            target = corners[int(now / 4.0)]
            if course == "circle":
                target = 0.05 * np.array([np.cos(1.3 * now), np.sin(1.3 * now)])
            observed = places[max(step - late, 0)] + rng.normal(0, 0.0004, 2)
            raw = (observed - seen) * rate_hz
            seen_speed, seen = seen_speed + 0.35 * (raw - seen_speed), observed
            wanted = (2.2 * (target - observed) - 1.8 * seen_speed) / (0.714 * 9.81 * lever)
            command = np.clip(wanted, -LARGEST_ANGLE_RAD, LARGEST_ANGLE_RAD)
            if grid_rad:
                command = np.round(command / grid_rad) * grid_rad
            rows.append((now, *command, *theta, *observed, *target))
        commands[step] = command
        theta = theta + STEP_S / lag_s * (commands[max(step - dead, 0)] - theta)
        speed = speed + STEP_S * (5 / 7 * 9.81 * np.sin(lever * theta + level) - 0.05 * speed)
        place = place + STEP_S * speed
    table = np.array(rows)
    return Run(table[:, 0], table[:, 1:3], table[:, 3:5], table[:, 5:7], table[:, 7:9])


def faults(log: dict[str, np.ndarray], told: Told) -> list[str]:
    """What of a log differs from what its file told; which way an axis counts is free."""
    t_s, true_s = log["t_s"] - log["t_s"][0], told.t_s - told.t_s[0]
    found = []
    if abs(t_s[-1] / true_s[-1] - 1) > 0.02:
        found.append(f"lasts {t_s[-1]:.3g} s, not {true_s[-1]:.3g}")
        return found
    turned = {}
    for stem, values in told.signals.items():
        unit = "m" if stem in ("ball", "target") else "rad"
        for axis in range(2):
            name = f"{stem}_{'xy'[axis]}_{unit}"
            if name not in log or np.isfinite(log[name]).mean() < 0.3:
                found.append(f"no {name}")
                continue
            slope = _slope(t_s, log[name], true_s, values[:, axis])
            sign = turned.setdefault(axis, np.sign(slope))
            if not abs(sign * slope - 1) < 0.03:
                found.append(f"{name} is {slope:.3g} of what it was, its axis' sign {sign:+.0f}")
    return found + [
        f"{name} of nothing"
        for name in log
        if name.split("_")[0] in ("command", "theta", "target", "voltage")
        and name.split("_")[0] not in told.signals
        and np.isfinite(log[name]).any()
    ]


def _slope(t_s: np.ndarray, values: np.ndarray, true_s: np.ndarray, true: np.ndarray) -> float:
    """Least-squares slope on the truth, at the best shift of up to 0.2 s; NaN: it is not it."""
    known = np.isfinite(true)
    best, best_fit = np.nan, 0.98
    for shift_s in np.linspace(-0.2, 0.2, 41):
        inside = np.isfinite(values) & (t_s + shift_s >= 0) & (t_s + shift_s <= true_s[-1])
        at = np.interp(t_s[inside] + shift_s, true_s[known], true[known])
        fit = np.corrcoef(at, values[inside])[0, 1]
        if abs(fit) > best_fit:
            best, best_fit = float(np.polyfit(at, values[inside], 1)[0]), abs(fit)
    return best
