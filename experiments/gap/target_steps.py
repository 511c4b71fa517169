"""The proof in closed loop where nobody wrote the controller down: each change of the target again.

The controller that the commands of a recording tell (`calibration.motion.recorded_controller`)
steers the simulated table from each change of the target to the next. The table begins as the
recording stood: told what the recording was told, the ball held where it lay.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.motion.recorded_controller import RecordedController, identify
from calibration.motion.recorded_law import command
from experiments.analysis.metrics import settling_time
from experiments.analysis.samples import Samples, place
from rig.log import Log
from rig.parameters import Rig
from rig.simulation.simulator import SimulatedTable

BEFORE_S = 1.0  # told as recorded, the ball held; longer than a servo's lag and dead time
SHORTEST_S = 2.0  # of what is compared; chosen: to settle, and to stay for a second


@dataclass(frozen=True, eq=False)
class TargetStep:
    """A change of the target in a recording: rows from it to the next one, and the controller."""

    rows: slice
    controller: RecordedController

    @property
    def ball_m(self) -> np.ndarray:
        """The recorded ball (n, 2) [m]."""
        return self.controller.ball_m[self.rows]


def target_steps(log: Log) -> list[TargetStep]:
    """The changes of the target that last long enough; [] where no controller is told."""
    controller = identify(log)
    if controller is None:
        return []
    found = []
    for k, after in zip(controller.changes, [*controller.changes[1:], len(log)], strict=True):
        end = min(after, controller.rows[controller.stretch(k)].stop)
        if (end - k) * controller.tick_s >= SHORTEST_S:
            found.append(TargetStep(slice(k, end), controller))
    return found


def step_numbers(steps: Sequence[TargetStep]) -> dict[str, float]:
    """Settling time [s] and spread [mm] of the recording, means over the steps."""
    return means([_numbers(step, step.ball_m) for step in steps])


def simulated_numbers(steps: Sequence[TargetStep], model: Rig, *, seeds: int) -> dict[str, float]:
    """The same of the model's table, over `seeds` draws of the camera's noise."""
    runs = ((step, replay(step, model, seed)) for step in steps for seed in range(seeds))
    return means([_numbers(step, ball) for step, ball in runs])


def replay(step: TargetStep, model: Rig, seed: int) -> np.ndarray:
    """The simulated ball (n, 2) [m] as the controller saw it, NaN from where it fell.

    model: a whole rig, effects included; its control and frame rate are those of the recording. A
    disturbance without a name that acted for some time of it is left out: it met other steps.
    """
    control, begin = step.controller, step.rows.start
    rate = 1.0 / control.tick_s
    lasting = replace(model.unknown, ball_segment=(0.0, 0.0), servo_segment=(0.0, 0.0))
    camera = replace(model.camera, rate_hz=rate)
    rig = replace(model, control_rate_hz=rate, camera=camera, unknown=lasting)
    start = control.ball_m[begin]
    table = SimulatedTable(
        rig, np.random.default_rng([seed, 7]), start_m=(start[0], start[1]), held=True
    )
    for told in _told_before(control, begin, round(BEFORE_S * rate)):
        table.read()
        table.drive((told[0], told[1]))
    table.release()
    return np.array(list(_steered(table, step, start)))


def _told_before(control: RecordedController, begin: int, ticks: int) -> np.ndarray:
    """The commands (ticks, 2) before a row of a stretch, the first of it repeated."""
    first = control.rows[control.stretch(begin)].start
    return control.told_rad[np.maximum(np.arange(begin - ticks, begin), first)]


def _steered(table: SimulatedTable, step: TargetStep, ball: np.ndarray) -> Iterator[np.ndarray]:
    control = step.controller
    states = control.states(step.rows.start)
    for target in control.targets_m[step.rows]:
        seen = table.read().ball
        if seen is not None:
            ball = np.array(seen.xy_m)
        told = [
            float(command(control.laws[a], states[a], target[a], ball[a], control.tick_s))
            for a in range(2)
        ]
        table.drive((told[0], told[1]))
        yield np.full(2, np.nan) if table.fallen else ball


def _numbers(step: TargetStep, ball: np.ndarray) -> dict[str, float]:
    """Settling time [s] after the change and spread [mm] from then on; NaN where it fell or never
    settled."""
    if not np.isfinite(ball).all():
        return {"settling time": np.nan, "spread": np.nan}
    t = np.arange(len(ball)) * step.controller.tick_s
    targets = step.controller.targets_m[step.rows]
    quiet = np.zeros(len(ball), bool)
    samples = Samples(t, ball, targets, quiet, t + step.controller.tick_s)
    settled = settling_time(samples)
    after = samples.where(samples.t_s >= settled)
    return {"settling time": settled, "spread": 1e3 * place(after).spread_m}


def means(found: Sequence[dict[str, float]]) -> dict[str, float]:
    """Mean of each quantity over the runs in which it is defined; NaN if in under half of them."""
    mean = {}
    for quantity in found[0]:
        values = np.array([one[quantity] for one in found])
        there = values[np.isfinite(values)]
        mean[quantity] = float(there.mean()) if 2 * len(there) >= len(values) else np.nan
    return mean
