"""The ball's samples of a log: new observations of the run phase, and where they were.

Only rows of phase 2 (run) count, times from the first of them; a log without phases (an import) is
a run from its first row. What a log lacks is NaN.
"""

from dataclasses import dataclass
from math import nan, sqrt

import numpy as np

from rig.log import Log, Phase


@dataclass(frozen=True, eq=False)
class Place:
    """Position of the ball over a stretch of samples [m], NaN without samples.

    centroid_m (2,): mean; distance_m: of the mean from the mean target; spread_m: RMS distance from
    the mean; error_rms_m: RMS distance from the target; samples: their number. An axis that the log
    lacks is left out of the three distances.
    """

    centroid_m: np.ndarray
    distance_m: float
    spread_m: float
    error_rms_m: float
    samples: int


@dataclass(frozen=True, eq=False)
class Samples:
    """New observations of the ball in the run phase, k of them; times count from the first row of
    the phase.

    t_s (k,): when the light hit the sensor; xy_m (k, 2): position; target_m (k, 2): target at that
    time, the plate's centre where the log does not say; pushed (k,): True while a push was on;
    until_s (k,): the last time at which the log still holds the observation. Where the next t_s is
    much later than until_s, the ball was not seen in between.
    """

    t_s: np.ndarray
    xy_m: np.ndarray
    target_m: np.ndarray
    pushed: np.ndarray
    until_s: np.ndarray

    def where(self, chosen: np.ndarray | slice) -> "Samples":
        """The samples that `chosen` selects, a mask (k,) or a slice."""
        return Samples(**{name: values[chosen] for name, values in vars(self).items()})

    @property
    def target_moves(self) -> bool:
        """Whether the target of any two samples differs."""
        return bool(len(self.t_s)) and bool(np.ptp(self.target_m, axis=0).any())

    @property
    def off_m(self) -> np.ndarray:
        """Distance (k,) [m] of each sample from its target, over the axes that the log has."""
        return np.sqrt(np.nansum((self.xy_m - self.target_m) ** 2, axis=1))


def run_part(log: Log) -> Log:
    """Rows of the run phase; all rows of a log without phases."""
    return log.where(log["phase"] == Phase.RUN) if log.has("phase") else log


def ball_samples(log: Log) -> Samples:
    """Samples of the ball in the run phase of a log."""
    run = run_part(log)
    t_s, xy = run.ball()
    tick = run["t_s"]
    start = tick[0] if len(tick) else 0.0
    at = np.clip(np.searchsorted(tick, t_s + 1e-9, side="right") - 1, 0, None)
    target = np.column_stack([run["target_x_m"], run["target_y_m"]])[at]
    seen = tick[~np.isnan(run["ball_x_m"]) | ~np.isnan(run["ball_y_m"])]
    held = np.append(-np.inf, seen)[np.searchsorted(seen, np.append(t_s[1:], np.inf))]
    return Samples(
        t_s=t_s - start,
        xy_m=xy,
        target_m=np.where(np.isnan(target), 0.0, target),
        pushed=np.nan_to_num(run["push"])[at] != 0,
        until_s=np.maximum(held[: len(t_s)], t_s) - start,
    )


def place(ball: Samples) -> Place:
    """Mean, distance from the target, spread and RMS error of the samples."""
    if not len(ball.t_s):
        return Place(np.full(2, nan), nan, nan, nan, 0)
    centroid = mean_seen(ball.xy_m)
    away = np.nansum((centroid - ball.target_m.mean(axis=0)) ** 2)
    spread = np.nansum(mean_seen((ball.xy_m - centroid) ** 2))
    error = sqrt(np.mean(ball.off_m**2))
    return Place(centroid, float(np.sqrt(away)), float(np.sqrt(spread)), error, len(ball.t_s))


def mean_seen(values: np.ndarray) -> np.ndarray:
    """Mean (2,) of each column of values (n, 2), NaN left out; NaN where a column has no number."""
    count = (~np.isnan(values)).sum(axis=0)
    return np.where(count > 0, np.nansum(values, axis=0) / np.maximum(count, 1), nan)


def pair(log: Log, name: str) -> np.ndarray:
    """The x and y columns of a signal as (n, 2), in the log's unit; name: the column's, with `{}`
    in place of the axis. KeyError: no such column.
    """
    return np.column_stack([log[name.format(axis)] for axis in "xy"])


def held(values: np.ndarray, first: float = 0.0) -> np.ndarray:
    """`values` (n,) with each NaN or infinity replaced by the value before it, `first` at the
    start."""
    known = np.where(np.isfinite(values), np.arange(len(values)), -1)
    last = np.maximum.accumulate(known)
    return np.where(last >= 0, values[np.maximum(last, 0)], first)
