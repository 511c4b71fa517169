"""What an episode is made of: the table that is drawn, its start, its targets, the reward."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import sqrt
from os import PathLike
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from rig.control.agent import AgentView
from rig.course import Course
from rig.intervals import Intervals, check_intervals, drawn, read_intervals
from rig.parameters import Rig
from rig.rigfile import read_rig
from rig.simulation.simulate import draw
from rig.simulation.stepped import Start, SteppedTables, most_ticks

Reference = Callable[[np.ndarray, np.random.Generator], np.ndarray]
EFFORT = 0.05  # chosen: full volts cost as much as 2 cm of error on a plate of 27.5 cm
INSIDE = 0.6  # chosen: of half the plate's side; from further out few controllers keep the ball


@dataclass(frozen=True)
class Task:
    """What every episode has in common, checked.

    rig: a `Rig`, the path of a rig file, or None for the ideal default table, effects included;
    agents see what the rig says without them. seconds: length of an episode; start_m: the ball
    lies within +-start_m of the centre on both axes, uniformly (None: INSIDE of half the side);
    reference: function of the times (m,) [s] and a generator that gives targets (m, 2) [m], as
    those of `rig.reference` (None: the centre); randomise: path of a `rig gap` answer (JSON), or a
    mapping {"effects.NAME.AXIS.KEY" or "servo.KEY": (low, high)}, from which each episode's table
    is drawn; play: the agent sees the estimated play, too. ValueError (one line): one of them is no
    good. OSError: a file cannot be read.
    """

    rig: Rig
    steps: int
    start_m: float
    reference: Reference | None
    intervals: Intervals
    play: bool

    @classmethod
    def of(
        cls,
        rig: Rig | str | PathLike | None = None,
        *,
        seconds: float = 10.0,
        start_m: float | None = None,
        reference: Reference | None = None,
        randomise: str | PathLike | Mapping[str, tuple[float, float]] | None = None,
        play: bool = False,
    ) -> "Task":
        """Return the task of an environment's arguments, which are explained above."""
        table = rig if isinstance(rig, Rig) else Rig() if rig is None else read_rig(Path(rig))
        steps = round(seconds * table.control_rate_hz) if np.isfinite(seconds) else 0
        if not 1 <= steps <= 3600 * table.control_rate_hz:
            raise ValueError(f"seconds = {seconds:g}: must be from one tick to 3600")
        room = min(table.linkage.half_sides_m)
        room -= table.ball.radius_m if table.walls.present else 0.0
        start = INSIDE * room if start_m is None else float(start_m)
        if not 0 <= start < room:
            raise ValueError(f"start_m = {start:g}: must be from 0 to below {room:g}, on the plate")
        if table.camera.dropout >= 1:
            raise ValueError("camera.dropout = 1: no frame shows the ball; lower it")
        task = cls(table, steps, start, reference, _intervals(randomise), bool(play))
        check_intervals(table, task.intervals)
        task.start(np.random.default_rng(0))
        return task

    @cached_property
    def view(self) -> AgentView:
        """What the agent sees and commands."""
        return AgentView(self.rig.known, play=self.play)

    def tables(self, n: int) -> SteppedTables:
        """Return n tables on which episodes can be started."""
        return SteppedTables(n, self.rig, self.steps)

    def start(self, rng: np.random.Generator, options: Mapping[str, Any] | None = None) -> Start:
        """Return the next episode of `rng`: the noise of its sensors is the same whichever table is
        drawn.

        options: {"start_m": (x, y)} puts the ball there. ValueError (one line): off the plate, an
        unknown option, or a reference that is no (m, 2) of finite numbers on the plate.
        """
        world, where, aim, noise = rng.spawn(4)
        table = drawn(self.rig, self.intervals, world) if self.intervals else self.rig
        x, y = where.uniform(-self.start_m, self.start_m, 2).tolist()
        options = options or {}
        if set(options) - {"start_m"}:
            raise ValueError(f"unknown option in {sorted(options)}; known: start_m")
        if "start_m" in options:
            x, y = (float(v) for v in options["start_m"])
        halves = self.rig.linkage.half_sides_m
        if not (abs(x) < halves[0] and abs(y) < halves[1]):
            raise ValueError(f"start_m = ({x:g}, {y:g}): off the plate, +-{min(halves):g} m")
        ticks = most_ticks(self.rig, self.steps)
        targets = np.zeros((ticks, 2))
        if self.reference is not None:
            t_s = np.arange(ticks) / self.rig.control_rate_hz
            targets = np.asarray(self.reference(t_s, aim), float)
            if targets.shape != (ticks, 2) or not np.all(np.abs(targets) <= halves):
                raise ValueError(
                    f"reference gave {targets.shape}, up to {np.abs(targets).max():g} m: must give "
                    f"({ticks}, 2) within +-{min(halves):g} m"
                )
        course = Course(targets, np.zeros((ticks, 2)), (x, y))
        return Start(table, course, draw(noise, table, course))

    def rewards(self, tables: SteppedTables) -> np.ndarray:
        """Return the reward of the tick that every table has just made, (n,).

        r = 1 - |p - p*| / (sqrt(2) L) - w (u_x^2 + u_y^2) / 2,  from -w to 1 within the plate,

        p: where the ball truly is, p*: its target, L: the plate's side (the shorter one), u: volts
        or angle applied over the limit, w = EFFORT.
        """
        off, used = tables.balls_m - tables.targets_m, tables.applied / self.view.limit
        error = np.hypot(off[:, 0], off[:, 1]) / self._diagonal_m
        return 1.0 - error - 0.5 * EFFORT * (used * used).sum(axis=1)

    @cached_property
    def _diagonal_m(self) -> float:
        return sqrt(2) * 2 * min(self.rig.linkage.half_sides_m)


def _intervals(randomise: str | PathLike | Mapping[str, tuple[float, float]] | None) -> Intervals:
    if randomise is None:
        return {}
    if isinstance(randomise, Mapping):
        try:
            return {str(name): (float(low), float(high)) for name, (low, high) in randomise.items()}
        except (TypeError, ValueError, OverflowError) as error:
            raise ValueError(f"randomise: must be {{NAME: (low, high)}} ({error})") from None
    found, told = read_intervals(Path(randomise), "randomise = ")
    for line in told:
        gymnasium.logger.warn(f"{line} It stays as the rig file has it.")
    return found


def spaces_of(view: AgentView) -> tuple[gymnasium.spaces.Box, gymnasium.spaces.Box]:
    """Observation and action space of one table."""
    high = view.high
    return gymnasium.spaces.Box(-high, high), gymnasium.spaces.Box(-1.0, 1.0, (2,))
