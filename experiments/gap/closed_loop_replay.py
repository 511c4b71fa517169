"""Recorded runs simulated again in closed loop under a model, and their motion as a film shows it.

The same targets, start and pushes, the controller settings of the recording, and noise drawn from
the recording's seed.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from experiments.analysis.samples import held, pair, run_part
from experiments.gap.input import GapInput
from experiments.runs.assemble import known
from experiments.runs.protocol import Protocol, course, parse
from rig.control.controllers import COMPENSATORS
from rig.course import Course
from rig.log import Log, shown_angles
from rig.parameters import Rig
from rig.simulation.simulate import Simulated, draw, simulate

FILM_HZ = 30.0  # samples a second of a film; chosen: more than a page draws


@dataclass(frozen=True, eq=False)
class RepeatableRun:
    """A recording that can be simulated again.

    label: protocol and arm; rig: as its controller knew it, with the gains and control rate of the
    run; compensator: its index in `rig.control.controllers.COMPENSATORS`; course: targets and
    pushes as long as the recording; seed: of the recording.
    """

    name: str
    label: str  # protocol and arm
    log: Log
    rig: Rig
    compensator: int
    protocol: Protocol
    course: Course
    seed: int


def repeatable_runs(inputs: GapInput) -> Iterator[RepeatableRun]:
    """Yield the recordings that can be simulated again, in their order.

    Left out are recordings whose protocol, seed or controller is not known (files), without ball,
    on the servos alone, pushed in answer to the ball, or with a protocol that this version does not
    read.
    """
    for name, log, rig, arm, stored, seed in zip(
        inputs.names,
        inputs.logs,
        inputs.rigs,
        inputs.arms,
        inputs.protocols,
        inputs.seeds,
        strict=True,
    ):
        if (
            stored is None
            or seed is None
            or arm not in COMPENSATORS
            or not log.has("ball_x_m", "ball_y_m")
        ):
            continue
        try:
            protocol_name = str(stored.get("name", ""))
            protocol = parse(stored, label="run.json", name=protocol_name)
            planned = course(protocol, rig, seed)
        except ValueError:  # of another version, or with the operator's own changes
            continue
        if protocol.servo_only or protocol.pushes.kind == "at-centre":
            continue
        recorded = _as_long_as(planned, run_part(log))
        label = f"{protocol_name}, {arm}"
        yield RepeatableRun(name, label, log, rig, COMPENSATORS[arm], protocol, recorded, seed)


def _as_long_as(planned: Course, run: Log) -> Course:
    """The course up to where the recording ends (a person may have stopped it)."""
    n = max(1, min(len(run), len(planned.targets_m)))
    return replace(planned, targets_m=planned.targets_m[:n], pushes_m_s2=planned.pushes_m_s2[:n])


def simulate_again(run: RepeatableRun, model: Rig, draw_number: int = 0) -> Simulated:
    """Simulate the recorded run in closed loop under a model.

    model: a whole rig, effects included; its gains and control rate are replaced by those of the
    run. draw_number: which draw of the noise, seeded by the recording's seed.
    """
    plant = replace(model, gains=run.rig.gains, control_rate_hz=run.rig.control_rate_hz)
    numbers = draw(np.random.default_rng([run.seed, 6, draw_number]), plant, run.course)
    return simulate(plant, known(run.rig), run.compensator, run.course, numbers)


@dataclass(frozen=True, eq=False)
class TableMotion:
    """Motion of a table at n times t_s (n,) [s] from 0.

    theta_rad (n, 2): servo angles x, y; ball_m, target_m (n, 2): positions. The ball is held
    between observations and NaN before the first.
    """

    t_s: np.ndarray
    theta_rad: np.ndarray
    ball_m: np.ndarray
    target_m: np.ndarray

    def at(self, t_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angles [rad], ball and target [m], (2,) each, of the last sample up to t_s [s].

        Before the first sample: those of the first.
        """
        i = int(np.clip(np.searchsorted(self.t_s, t_s, side="right") - 1, 0, len(self.t_s) - 1))
        return self.theta_rad[i], self.ball_m[i], self.target_m[i]

    @property
    def end_s(self) -> float:
        """Time of the last sample [s]."""
        return float(self.t_s[-1])


def table_motion(log: Log, *, run_only: bool = False) -> TableMotion:
    """Motion of a log, thinned to about FILM_HZ.

    run_only: leave out the rows before the ball's release. ValueError: no rows are left.
    """
    log = run_part(log) if run_only else log
    if not len(log):
        raise ValueError("the run has no rows: choose another")
    t = log["t_s"] - log["t_s"][0]
    step = max(1, round(1 / (FILM_HZ * float(np.median(np.diff(t)))))) if len(t) > 1 else 1
    ball = pair(log, "ball_{}_m")
    seen = np.isfinite(ball).all(axis=1)
    ball = np.column_stack([held(ball[:, a]) for a in range(2)])
    ball[: int(np.argmax(seen)) if seen.any() else len(ball)] = np.nan
    theta = np.nan_to_num(shown_angles(log.rows))
    target = pair(log, "target_{}_m")
    return TableMotion(*(part[::step] for part in (t, theta, ball, target)))


@dataclass(frozen=True, eq=False)
class ModelComparison:
    """One recorded run beside the same run simulated by the model before and after naming."""

    name: str
    recorded: TableMotion
    before: TableMotion
    after: TableMotion


def compare_models(inputs: GapInput, before: Rig, after: Rig) -> ModelComparison | None:
    """The first recording that can be simulated again, beside both models' simulations of it.

    A recording with "release" in its name is preferred. `before` and `after` are whole models,
    effects included. None: no recording can be simulated again.
    """
    runs = sorted(repeatable_runs(inputs), key=lambda run: "release" not in run.name)
    if not runs:
        return None
    run = runs[0]
    models = (table_motion(simulate_again(run, m).log, run_only=True) for m in (before, after))
    return ModelComparison(run.name, table_motion(run.log, run_only=True), *models)
