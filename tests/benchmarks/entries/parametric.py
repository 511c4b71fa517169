"""Least squares on multi-step predictions, one candidate after the other, chosen by BIC.

As a system identification toolbox has it (mujoco.sysid): parameters of a simulator are fitted by
least squares on whole stretches of the log, with bounds and intervals from the Jacobian; K and tau
are always fitted. Which of the catalogue's effects are fitted is chosen forwards by Schwarz's BIC =
n ln(RSS/n) + k ln n (1978), n: two rows a window. A name's probability is its share of exp(-BIC/2)
among all that were tried in its round, nothing included. Told is what is beyond its tolerance with
its whole interval. It cannot say "unknown".
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.special import softmax

from rig.effects import BY_NAME
from tests.benchmarks.entries.signals import (
    G_M_S2,
    Case,
    answer,
    counts,
    effect,
    positions,
    read_case,
    relay,
)
from tests.benchmarks.entries.terms import log_of, speed_of
from tests.benchmarks.entries.windows import (
    BALL,
    BALL_TICKS,
    BOTH,
    N_SERVO,
    SERVO,
    SERVO_TICKS,
    ball_path,
    fit,
    servo_path,
    without_start,
)

ROUNDS, TRIED = 5, 6  # effects a group at most; candidates that are tried again in later rounds
Slot = tuple[str, str, str]  # effect, axis, key
Residual = Callable[[np.ndarray], np.ndarray]


def bounds(slot: Slot) -> tuple[float, float, float]:
    """Low, high and the size of a unit step."""
    if slot[2] == "phase":
        return -np.pi, np.pi, 1.0
    if slot[0] == "saturation":
        return 0.0, 5.0, 0.5
    first = BY_NAME[slot[0]].parameters[0]
    return first.low, 2 * first.high, max(BY_NAME[slot[0]].tolerance, 0.02 * first.high)


def servo_group(case: Case, axis: str) -> tuple[list[Slot], Residual, int]:
    told, log, dt = case.rig["servo"], case.log, 1 / case.rate_hz
    V, other = log[f"voltage_{axis}_V"], log[f"voltage_{'y' if axis == 'x' else 'x'}_V"]
    theta, step = case.angle(axis), 2 * np.pi / told["encoder_counts_per_rev"]
    w, side = speed_of(theta, case.rate_hz), relay(theta, 1.5 * step)
    starts = np.arange(10, len(V) - SERVO_TICKS, SERVO_TICKS)
    rows = theta[starts[:, None] + np.arange(SERVO_TICKS)]
    slots = [(n, "xy" if n == "supply_sag" else axis, k) for n, k in SERVO]
    slots.append(("cogging", axis, "phase"))

    def residual(p: np.ndarray) -> np.ndarray:
        K, tau = told["gain_rad_s_V"] * (1 + p[0]), told["time_constant_s"] * (1 + p[1])
        path = servo_path(V, other, theta, w, side, dt, K, tau, p[2:], starts, SERVO_TICKS)
        return without_start(path - rows, 1 - np.exp(-np.arange(SERVO_TICKS) * dt / tau), 10) / step

    assert len(slots) == N_SERVO
    return slots, residual, 2


def ball_group(case: Case) -> tuple[list[Slot], Residual, int]:
    dt, n = 1 / case.rate_hz, len(case.log["t_s"])
    theta = np.array([case.angle(a) for a in "xy"])
    side = np.array([relay(one, 0.003) for one in theta])
    xy = np.array([positions(case, a) for a in "xy"])
    v = np.array([speed_of(one, case.rate_hz) for one in xy])
    A = np.array([G_M_S2 * case.ratio(a) for a in "xy"])
    factor, noise = 3 / 5 if case.rig["ball"]["hollow"] else 5 / 7, case.rig["camera"]["noise_m"]
    starts = np.arange(50, n - BALL_TICKS, BALL_TICKS)
    window = starts[:, None] + np.arange(BALL_TICKS)
    starts = starts[~log_of(case, "push")[window].any(axis=1)]
    rows = xy[:, starts[:, None] + np.arange(BALL_TICKS)]
    slots = [(name, axis, key) for axis in "xy" for name, key in BALL]
    slots += [(name, "xy", key) for name, key in BOTH]
    slots += [("transmission_ripple", axis, "phase") for axis in "xy"]

    def residual(p: np.ndarray) -> np.ndarray:
        own, both, phase = p[:14].reshape(2, 7), p[14:21], p[21:]
        path = ball_path(theta, side, xy, v, dt, A, factor, own, both, phase, starts, BALL_TICKS)
        ramp = np.arange(BALL_TICKS) * dt
        return np.concatenate([without_start(path[a] - rows[a], ramp, 50) for a in (0, 1)]) / noise

    return slots, residual, 0


def named(group: tuple[list[Slot], Residual, int]) -> list[dict]:
    """The effects of a group that BIC accepts one after the other."""
    slots, residual, base = group
    limits = np.array([(-0.2, 0.2, 0.02)] * base + [bounds(slot) for slot in slots])
    low, high, unit = limits.T
    places: dict[tuple[str, str], list[int]] = {}
    for i, slot in enumerate(slots):
        places.setdefault(slot[:2], []).append(base + i)
    free = list(range(base))
    p, sd, best = fit(residual, free, low, high, unit, np.zeros(len(limits)), 8)
    tried, accepted = list(places), {}
    for _ in range(ROUNDS):
        fits = {s: fit(residual, free + places[s], low, high, unit, p, 8) for s in tried}
        weights = softmax([-best / 2, *(-one[2] / 2 for one in fits.values())])
        name = min(fits, key=lambda s: fits[s][2])
        if fits[name][2] > best - 2 * np.log(10):  # ten times as likely, at least
            break
        free += places[name]
        p, sd, best = fits[name]
        accepted[name] = float(weights[1 + list(fits).index(name)])
        tried = [s for s in sorted(fits, key=lambda s: fits[s][2]) if s != name][:TRIED]
    found: list[dict] = []
    for (name, axis), probability in accepted.items():
        place = places[name, axis][0]
        key = slots[place - base][2]
        size = (float(p[place]), float(sd[free.index(place)]))
        if counts(name, max(abs(size[0]) - 1.96 * size[1], 0.0)):
            found.append(effect(name, probability, {(axis, key): size}))
    return found


def answer_of(folder: Path) -> dict:
    case = read_case(folder)
    groups = [servo_group(case, a) for a in "xy"] if case.voltage else []
    effects: dict[str, dict] = {}
    for one in (e for group in [*groups, ball_group(case)] for e in named(group)):
        there = effects.setdefault(one["name"], one)
        there["parameters"] |= one["parameters"]
        there["probability"] = max(there["probability"], one["probability"])
    return answer("named", [*effects.values()]) if effects else answer("nothing-missing")
