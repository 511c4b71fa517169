"""Which controller told the servos in a recording, from its commands and the ball alone.

The law (`recorded_law`) is followed from the recorded ball, never simulated with a table, and its
numbers are those whose commands differ least from the recorded ones. Targets that nobody recorded
are constant between their changes (`target_changes`), and are fitted with it.
"""

from dataclasses import dataclass

import numpy as np

from calibration.motion.recorded_law import follow, started
from calibration.motion.recorded_law_fit import AxisFit, Told, fit_axis, missed, targets_of
from calibration.motion.target_changes import held, recorded_changes, stretches, told_changes
from rig.log import Log

MIN_EXPLAINED = 0.9  # share of the commands; chosen: below, such a law did not tell them
MIN_CHANGE = 0.1  # share of the largest change of the target; chosen: smaller ones are noise
LATEST = 10  # ticks by which a change may be moved; chosen: over which it is looked for


@dataclass(frozen=True, eq=False)
class RecordedController:
    """A controller of both axes as a log tells it.

    laws (2, 7): as `recorded_law` has them; tick_s: its period as the log has it; rows: stretches
    in which it worked; changes: rows at which its target changed; targets_m (n, 2), NaN outside the
    stretches; integrals (stretches, 2): I at their begin [rad]; explained (2,): share of the
    commands' variance; ball_m, told_rad (n, 2): what it saw, held between frames, and told.
    """

    laws: np.ndarray
    tick_s: float
    rows: tuple[slice, ...]
    changes: tuple[int, ...]
    targets_m: np.ndarray
    integrals: np.ndarray
    explained: np.ndarray
    ball_m: np.ndarray
    told_rad: np.ndarray

    def stretch(self, row: int) -> int:
        """Which stretch holds a row. StopIteration: none."""
        return next(i for i, s in enumerate(self.rows) if s.start <= row < s.stop)

    def states(self, row: int) -> np.ndarray:
        """The states (2, 4) of both laws before a row of a stretch."""
        which = self.stretch(row)
        begin, found = self.rows[which].start, []
        for a in range(2):
            state = started(self.integrals[which, a], self.told_rad[begin, a])
            r, x = self.targets_m[begin:row, a], self.ball_m[begin:row, a]
            follow(self.laws[a], state, r, x, self.tick_s, np.empty(len(r)))
            state[-1] = self.told_rad[max(row - 1, begin), a]  # what was told is known
            found.append(state)
        return np.array(found)


def identify(log: Log) -> RecordedController | None:
    """The controller of a log with commanded angles and the ball on both axes; None where there is
    no stretch of it, the target never changes, or no such law explains the commands."""
    needed = [f"{what}_{axis}" for axis in "xy" for what in ("command", "ball")]
    if not log.has(*(f"{n}_rad" if n.startswith("c") else f"{n}_m" for n in needed)):
        return None
    seen = np.column_stack([log["ball_x_m"], log["ball_y_m"]])
    told = np.column_stack([log["command_x_rad"], log["command_y_rad"]])
    rows = stretches(log["t_s"], seen, told)
    data = Told(log["t_s"], held(seen), told, tuple(rows), _targets(log))
    changes = sorted(k for s in rows for k in _changes(data, s))
    if not changes:
        return None
    axes = [fit_axis(data, a, changes) for a in range(2)]
    if data.targets is None:
        changes = _that_change(axes, changes)
        axes = [fit_axis(data, a, changes, axes[a]) for a in range(2)]
        changes = _moved(data, axes, changes)
        axes = [fit_axis(data, a, changes, axes[a]) for a in range(2)]
    explained = np.array([axis.explained for axis in axes])
    if not changes or not explained.min() >= MIN_EXPLAINED:
        return None
    return RecordedController(
        laws=np.array([axis.law for axis in axes]),
        tick_s=data.tick_s,
        rows=data.rows,
        changes=tuple(changes),
        targets_m=np.column_stack([axis.targets for axis in axes]),
        integrals=np.column_stack([axis.integrals for axis in axes]),
        explained=explained,
        ball_m=data.ball,
        told_rad=told,
    )


def _targets(log: Log) -> np.ndarray | None:
    if not log.has("target_x_m", "target_y_m"):
        return None
    return held(np.column_stack([log["target_x_m"], log["target_y_m"]]))


def _changes(data: Told, rows: slice) -> list[int]:
    """Rows of a stretch at which the target changed."""
    if data.targets is not None:
        found = recorded_changes(data.t_s[rows], data.targets[rows])
    else:
        found = told_changes(data.t_s[rows], data.ball[rows], data.told[rows])
    return [rows.start + k for k in found]


def _that_change(axes: list[AxisFit], changes: list[int]) -> list[int]:
    """The changes of a size."""
    steps = [[axis.targets[k] - axis.targets[k - 1] for axis in axes] for k in changes]
    sizes = np.hypot(*np.nan_to_num(steps).T)
    return [k for k, size in zip(changes, sizes, strict=True) if size > MIN_CHANGE * sizes.max()]


def _moved(data: Told, axes: list[AxisFit], changes: list[int]) -> list[int]:
    """Each change at the tick within LATEST of it at which the laws miss the commands least."""
    best = list(changes)
    for i, change in enumerate(changes):
        low, high = max(change - LATEST, best[i - 1] + 1 if i else 0), change + LATEST + 1
        rows = next(s for s in data.rows if s.start <= change < s.stop)
        costs = {change: np.inf}
        for k in range(max(low, rows.start + 1), min(high, rows.stop, *changes[i + 1 :])):
            tried = [*best[:i], k, *best[i + 1 :]]
            costs[k] = sum(_cost(data, a, axis, tried) for a, axis in enumerate(axes))
        best[i] = min(costs, key=lambda k: costs[k])
    return best


def _cost(data: Told, a: int, axis: AxisFit, changes: list[int]) -> float:
    targets = targets_of(data, changes, axis.levels)
    return float(np.mean(abs(missed(data, a, axis.law, axis.integrals, targets))))
