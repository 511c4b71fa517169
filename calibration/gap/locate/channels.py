"""A channel of the evidence, ready to be searched: innovations in floors, what the table did."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calibration.gap import coordinates, pushes
from calibration.gap.evidence import Evidence
from calibration.gap.knobs import BALL, SERVO
from calibration.gap.pushes import Coordinate, Series
from calibration.gap.state import State
from rig.predict_ball import LONGEST_GAP_S


@dataclass(frozen=True, eq=False)
class Channel:
    """Innovations in floors (n,) where their cause was, NaN where none counts; the series and the
    coordinates that go with it; starts_s (r,) of the runs on the common time axis."""

    name: str
    gap: np.ndarray
    series: Series
    coordinates: list[Coordinate]
    starts_s: np.ndarray

    @property
    def ball(self) -> bool:
        return self.name.startswith(BALL)

    def of(self, kind: str) -> Coordinate:
        """The first coordinate of a kind (along the channel's own axis)."""
        return next(c for c in self.coordinates if c.kind == kind)


def part_of(name: str) -> str:
    """The part of the evidence in which a channel is."""
    return BALL if name.startswith(BALL) else name


def present(evidence: Evidence, name: str) -> bool:
    """Whether the evidence has the channel."""
    a = "xy".index(name[-1])
    return part_of(name) in evidence.parts and (name in SERVO or evidence.ball_axes[a])


def channel(state: State, evidence: Evidence, name: str, floor: float) -> Channel:
    """A channel of the evidence under a state's model; floor [rad or m]."""
    model, part, a = state.believed.model(state.fit.setting), part_of(name), "xy".index(name[-1])
    ball, runs = part == BALL, evidence.runs
    own = slice(a, None, 2) if ball else slice(None)
    roll = evidence.roll(model, part)
    z, std = roll.z[own], np.exp(roll.log_std[own])
    w = np.where(evidence.masks[part][own] > 0, 1.0, 0.0)
    times = [r.exposed_s if ball else r.t_s for r in runs]
    fresh = [r.fresh if ball and r.fresh is not None else np.zeros(len(t), bool)
             for r, t in zip(runs, times, strict=True)]  # fmt: skip
    t_s, starts_s = in_a_row(times)
    h = answer(evidence.levels, ball, a, times, model.time_constant_s[a])
    clipped = np.clip(z, -pushes.CLIP, pushes.CLIP) * w
    series = Series(clipped, w, h, segments(times, fresh, LONGEST_GAP_S if ball else np.inf), t_s)
    gap = at_cause(np.where(w > 0, z * std / floor, np.nan), series)
    found = (coordinates.of_ball if ball else coordinates.of_servo)(runs, a, t_s)
    return Channel(name, gap, series, found, starts_s)


def answer(levels: np.record, ball: bool, a: int, times: Sequence[np.ndarray], tau_s: float
           ) -> np.ndarray:  # fmt: skip
    """The response (l,) of the channel's observer to a push.

    Camera noise that lasts weighs as much more as its mean over many frames does.
    """
    step_s = float(np.median(np.concatenate([np.diff(t) for t in times])))
    if not ball:
        process, measured = levels["servo_process"][a], levels["servo_measured"][a]
        return pushes.response(step_s, float(process), float(measured), tau_s)
    memory = float(levels["ball_memory_s"])
    rho = np.exp(-step_s / memory) if memory > 0 else 0.0
    measured = float(levels["ball_measured"]) * np.sqrt((1 + rho) / (1 - rho))
    return pushes.response(step_s, float(levels["ball_process"]), measured)


def in_a_row(times: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) of all runs, one run after the other, and where each begins (r,).

    A single run keeps its own clock, shifted so that `starts_s` is 0 there.
    """
    starts, end = [], 0.0
    for t in times:
        starts.append(end)
        end += float(t[-1]) if len(t) else 0.0
    return np.concatenate([t + s for t, s in zip(times, starts, strict=True)]), np.array(starts)


def segments(
    times: Sequence[np.ndarray], fresh: Sequence[np.ndarray], longest_s: float
) -> tuple[slice, ...]:
    """Stretches in which an observer runs on: within a run, between fresh starts and long gaps."""
    found, first = [], 0
    for t, new in zip(times, fresh, strict=True):
        cuts = np.flatnonzero(new[1:] | (np.diff(t) > longest_s)) + 1 if len(t) > 1 else []
        edges = [0, *cuts, len(t)]
        found += [slice(first + int(i), first + int(j))
                  for i, j in pairwise(edges) if j > i]  # fmt: skip
        first += len(t)
    return tuple(found)


def at_cause(innovations: np.ndarray, series: Series) -> np.ndarray:
    """The innovations (n,) moved to where their cause was: earlier by the observer's lag."""
    out = np.full(len(innovations), np.nan)
    for part in series.segments:
        length = part.stop - part.start
        if length > series.lag:
            out[part.start : part.stop - series.lag] = innovations[part][series.lag :]
    return out
