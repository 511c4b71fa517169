"""A recorded run and the two models of it, before and after, in closed loop at the same time."""

from dataclasses import dataclass, replace

import numpy as np

from experiments.assemble import known
from experiments.dashboard.curves import held
from experiments.gap_input import GapInput
from experiments.protocol import course, parse
from experiments.samples import pair, run_part
from rig.controllers import ARMS
from rig.log import Log
from rig.parameters import Rig
from rig.simulate import draw, simulate

FILM_HZ = 30.0


@dataclass(frozen=True, eq=False)
class Motion:
    """What a table did: t_s (n,), servo angles [rad], ball and target [m] (n, 2), ball held."""

    t_s: np.ndarray
    theta_rad: np.ndarray
    ball_m: np.ndarray
    target_m: np.ndarray

    def at(self, t_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angles, ball and target at a time, the last before it."""
        i = int(np.clip(np.searchsorted(self.t_s, t_s, side="right") - 1, 0, len(self.t_s) - 1))
        return self.theta_rad[i], self.ball_m[i], self.target_m[i]

    @property
    def end_s(self) -> float:
        return float(self.t_s[-1])


def motion_of(log: Log, *, run_only: bool = False) -> Motion:
    """The motion of a log, thinned to what a film needs. ValueError: it has no rows."""
    log = run_part(log) if run_only else log
    if not len(log):
        raise ValueError("the run has no rows: choose another")
    t = log["t_s"] - log["t_s"][0]
    step = max(1, round(1 / (FILM_HZ * float(np.median(np.diff(t)))))) if len(t) > 1 else 1
    ball = pair(log, "ball_{}_m")
    seen = np.isfinite(ball).all(axis=1)
    ball = np.column_stack([held(ball[:, a]) for a in range(2)])
    ball[: int(np.argmax(seen)) if seen.any() else len(ball)] = np.nan
    theta = np.nan_to_num(pair(log, "theta_{}_rad"))
    target = pair(log, "target_{}_m")
    return Motion(*(part[::step] for part in (t, theta, ball, target)))


def both_models(
    inputs: GapInput, before: Rig, after: Rig
) -> tuple[Motion, Motion, Motion, str] | None:
    """Recorded, before, after and the run's name; None where no run can be run again."""
    order = sorted(range(len(inputs.logs)), key=lambda i: "release" not in inputs.names[i])
    for i in order:
        log, rig, arm, stored = inputs.logs[i], inputs.rigs[i], inputs.arms[i], inputs.protocols[i]
        seed = inputs.seeds[i]
        if stored is None or seed is None or arm not in ARMS or not log.has("ball_x_m", "ball_y_m"):
            continue
        try:
            protocol = parse(stored, label="run.json", name=str(stored.get("name", "")))
            way = course(protocol, rig, seed)
        except ValueError:
            continue
        if protocol.servo_only or protocol.pushes.kind == "at-centre":
            continue
        made = []
        for model in (before, after):
            plant = replace(model, gains=rig.gains, control_rate_hz=rig.control_rate_hz)
            numbers = draw(np.random.default_rng([seed, 6, 0]), plant, way)
            result = simulate(plant, known(rig), ARMS[arm], way, numbers)
            made.append(motion_of(result.log, run_only=True))
        return motion_of(log, run_only=True), made[0], made[1], inputs.names[i]
    return None
