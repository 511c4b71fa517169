"""One channel prepared for the search: innovations in noise floors, and what the table did."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calibration.gap.locate import coordinates, disturbances
from calibration.gap.locate.disturbances import Coordinate, Series
from calibration.gap.model.data import Evidence
from calibration.gap.model.parameters import BALL, SERVO
from calibration.gap.model.state import State
from rig.prediction.ball import LONGEST_GAP_S


@dataclass(frozen=True, eq=False)
class Channel:
    """A channel prepared for the search. `gap` (n,): innovations in noise floors at the time of
    their cause, NaN where masked; `series`, `coordinates`: of the same n samples; `starts_s` (r,):
    starts of the runs on the common time axis."""

    name: str
    gap: np.ndarray
    series: Series
    coordinates: list[Coordinate]
    starts_s: np.ndarray

    @property
    def ball(self) -> bool:
        """Whether the channel is one of the ball's."""
        return self.name.startswith(BALL)

    def of(self, kind: str) -> Coordinate:
        """The first coordinate of a kind, which is along the channel's own axis. `StopIteration`:
        none is of that kind."""
        return next(c for c in self.coordinates if c.kind == kind)


def output_of(name: str) -> str:
    """The output to which a channel belongs: "ball" for ball_x and ball_y, else the channel
    itself."""
    return BALL if name.startswith(BALL) else name


def present(evidence: Evidence, name: str) -> bool:
    """Whether the evidence has the channel."""
    a = "xy".index(name[-1])
    return output_of(name) in evidence.outputs and (name in SERVO or evidence.ball_axes[a])


def channel(state: State, evidence: Evidence, name: str, floor: float) -> Channel:
    """A channel of the evidence under the fitted model of `state`; `floor`: its noise floor [rad or
    m]."""
    model, output, a = state.nominal.model(state.fit.setting), output_of(name), "xy".index(name[-1])
    ball, runs = output == BALL, evidence.runs
    own = slice(a, None, 2) if ball else slice(None)
    roll = evidence.roll(model, output)
    z, std = roll.z[own], np.exp(roll.log_std[own])
    w = np.where(evidence.masks[output][own] > 0, 1.0, 0.0)
    times = [r.exposed_s if ball else r.t_s for r in runs]
    fresh = [
        r.fresh if ball and r.fresh is not None else np.zeros(len(t), bool)
        for r, t in zip(runs, times, strict=True)
    ]
    t_s, starts_s = on_one_axis(times)
    h = observer_response(evidence.levels, ball, a, times, model.time_constant_s[a])
    clipped = np.clip(z, -disturbances.CLIP_Z, disturbances.CLIP_Z) * w
    series = Series(clipped, w, h, segments(times, fresh, LONGEST_GAP_S if ball else np.inf), t_s)
    gap = at_cause(np.where(w > 0, z * std / floor, np.nan), series)
    found = (coordinates.of_ball if ball else coordinates.of_servo)(runs, a, t_s)
    return Channel(name, gap, series, found, starts_s)


def observer_response(
    levels: np.record, ball: bool, a: int, times: Sequence[np.ndarray], tau_s: float
) -> np.ndarray:
    """The response (l,), of unit power, of a channel's observer to a disturbance
    (`disturbances.response`).

    `levels`: dtype NOISE; `a`: axis 0 x, 1 y; `times`: of the samples by run [s]; `tau_s`: the
    servo's time constant. AR(1) camera noise counts as white noise whose mean has the same
    variance: a factor sqrt((1 + rho)/(1 - rho)).
    """
    step_s = float(np.median(np.concatenate([np.diff(t) for t in times])))
    if not ball:
        process, measured = levels["servo_process"][a], levels["servo_measured"][a]
        return disturbances.response(step_s, float(process), float(measured), tau_s)
    memory = float(levels["ball_memory_s"])
    rho = np.exp(-step_s / memory) if memory > 0 else 0.0
    measured = float(levels["ball_measured"]) * np.sqrt((1 + rho) / (1 - rho))
    return disturbances.response(step_s, float(levels["ball_process"]), measured)


def on_one_axis(times: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) [s] of all runs on one axis, one run after the other, and the start (r,) [s] of
    each."""
    starts, end = [], 0.0
    for t in times:
        starts.append(end)
        end += float(t[-1]) if len(t) else 0.0
    return np.concatenate([t + s for t, s in zip(times, starts, strict=True)]), np.array(starts)


def segments(
    times: Sequence[np.ndarray], fresh: Sequence[np.ndarray], longest_s: float
) -> tuple[slice, ...]:
    """Slices of the joined samples in which an observer runs on: within a run, between fresh starts
    and gaps over `longest_s`. `times` and `fresh` (bool): by run."""
    found, first = [], 0
    for t, new in zip(times, fresh, strict=True):
        cuts = np.flatnonzero(new[1:] | (np.diff(t) > longest_s)) + 1 if len(t) > 1 else []
        edges = [0, *cuts, len(t)]
        found += [slice(first + int(i), first + int(j)) for i, j in pairwise(edges) if j > i]
        first += len(t)
    return tuple(found)


def at_cause(innovations: np.ndarray, series: Series) -> np.ndarray:
    """The innovations (n,) moved to the time of their cause, earlier by the observer's lag; NaN
    where no innovation falls."""
    out = np.full(len(innovations), np.nan)
    for segment in series.segments:
        length = segment.stop - segment.start
        if length > series.lag:
            out[segment.start : segment.stop - series.lag] = innovations[segment][series.lag :]
    return out
