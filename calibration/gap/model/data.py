"""The recordings as the workflow uses them: signals by run, weights of samples, predictions.

Three outputs (see `rig.prediction.innovations`): `servo_x`, `servo_y` (volts to encoder) and `ball`
(encoder to camera, both axes in one vector, x and y in turn). A residual z is an innovation over
the standard deviation that its filter expects. It weighs nothing where a run lacks a signal, or
where a person held or pushed the ball.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf

import numpy as np

from calibration.gap.model.kept_fits import KeptFits
from calibration.gap.model.outliers import outliers
from calibration.gap.model.parameters import BALL, SERVO, Model
from calibration.gap.model.repeats import repeats
from calibration.gap.model.side_by_side import Item, Result, side_by_side
from rig.compiled import compiled
from rig.log import Log
from rig.prediction.innovations import (
    Signals,
    after_holes,
    ball_innovations,
    read_back,
    servo_innovations,
    signals,
)

MAX_RATE_HZ = 600.0  # above, a tick is less than an encoder count: several ticks become one
DIVERGED_Z = 1e6  # residual beyond which a prediction has diverged
AFTER_PUSH_S = 0.05
# The time ahead at which a model is judged: several ticks of camera and loop, and about the time in
# which a ball crosses its own noise and a servo answers. Chosen.
HORIZON_S = {BALL: 0.05, SERVO[0]: 0.02, SERVO[1]: 0.02}
UNTOLD_S = 0.5  # chosen: servos of hobbyists answer, and the ball's filter forgets, within it
WALL_MARGIN_M = 0.002  # by which a wall and the measured place of a ball may be off; chosen
# Of `information_weights`; chosen.
WEIGHT_WINDOW_S, FULL_WEIGHT_COUNTS, MIN_WEIGHT = 0.05, 8.0, 0.4
REPEATED_CORRELATION = 0.995  # of two cycles that count as one motion repeated; chosen
SETTLING_SAMPLES = {
    BALL: 4,
    "servo_x": 5,
    "servo_y": 5,
}  # first innovations of a filter
OUTPUTS = (*SERVO, BALL)


@dataclass(frozen=True, eq=False)
class Roll:
    """The residuals z (n,) of a prediction, in expected standard deviations, and the natural
    logarithm of these deviations (n,) [rad or m]."""

    z: np.ndarray
    log_std: np.ndarray

    def change(self, base: "Roll") -> np.ndarray:
        """How the residuals (n,) differ from those of `base`, both in the deviations that `base`
        expects: a prediction that merely expects larger ones explains nothing. All 0 where this one
        diverged."""
        if self._diverged:
            return np.zeros(len(self.z))
        larger = np.exp(np.minimum(self.log_std - base.log_std, np.log(DIVERGED_Z)))
        return self.z * larger - base.z

    def slope(self, base: "Roll", step: float) -> np.ndarray:
        """The secant (z - base.z)/step (n,); all 0 where this prediction diverged."""
        return np.zeros(len(self.z)) if self._diverged else (self.z - base.z) / step

    @property
    def _diverged(self) -> bool:
        return bool(np.max(np.abs(self.z), initial=0.0) >= DIVERGED_Z)


def usable(
    log: Log,
    *,
    camera_delay_s: float,
    noise_m: float = 0.0,
    reach_m: float = inf,
    commanded: bool = False,
) -> Signals:
    """A log's signals as the workflow uses them: at most MAX_RATE_HZ, missing axes 0, exposures of
    a held or pushed ball, of one at a wall, repeats and outliers left out, of the others one each
    HORIZON_S.

    From frame to frame at 100 Hz a controller that answers the camera's noise is part of what is
    predicted best: a table that is 0.25 s late is told better by a model without the delay, and at
    0.05 s and more by the right one. `camera_delay_s`: from exposure to row, for logs without
    exposure times; `noise_m`: the camera's, for `outliers`; `reach_m`: of the ball's centre between
    walls; `commanded`: the servos may read back the angle that they are told."""
    known = signals(log, camera_delay_s=camera_delay_s)
    known = _thinned(read_back(log, known) if commanded else known)
    driven = known.has_servo(0), known.has_servo(1)
    theta = np.where(np.isnan(known.theta_rad).all(axis=0), 0.0, known.theta_rad)
    volts = np.where(np.array(driven) | known.commanded, known.volts_V, 0.0)
    seen = ~np.isnan(known.ball_m)
    ball = np.where(seen.any(axis=0), known.ball_m, 0.0)
    kept = np.isfinite(ball).all(axis=1) & seen.any()
    touched = _touched(log, known.exposed_s) | _at_wall(ball, reach_m)
    fresh = np.concatenate([[True], touched[:-1] & ~touched[1:]])[: len(touched)]
    kept &= ~touched
    begun = np.cumsum(fresh)
    again = repeats(ball[kept])
    kept[kept] = ~again
    wild = outliers(known.exposed_s[kept], ball[kept], noise_m)
    kept[kept] = ~wild
    fresh = np.diff(begun[kept], prepend=0) > 0
    exposed_s, ball = known.exposed_s[kept], ball[kept]
    few = every(exposed_s, fresh, HORIZON_S[BALL])
    return replace(
        known,
        theta_rad=theta,
        volts_V=volts,
        driven=driven,
        fresh=fresh[few],
        exposed_s=exposed_s[few],
        ball_m=ball[few],
        repeats=int(again.sum()),
        outliers=int(wild.sum()),
    )


def within(t: np.ndarray, span_s: float) -> int:
    """How many samples at the times `t` (n,) [s] lie in a span, 1 or more."""
    return max(1, round(span_s / float(np.median(np.diff(t))))) if len(t) > 1 else 1


def every(t: np.ndarray, new: np.ndarray, apart_s: float) -> np.ndarray:
    """True (n,) for samples at the times `t` (n,) [s] that are `apart_s` apart, counted anew where
    `new` (n,) is true."""
    k = within(t, apart_s)
    first = np.maximum.accumulate(np.where(new, np.arange(len(t)), 0))
    return (np.arange(len(t)) - first) % k == 0


def _touched(log: Log, exposed_s: np.ndarray) -> np.ndarray:
    """True (k,) for exposures in which a person placed, held or pushed the ball."""
    if not len(exposed_s):
        return np.zeros(0, bool)
    t = log["t_s"]
    operated = (np.nan_to_num(log["push"]) != 0) | (log["phase"] < 2)
    if not operated.any():
        return np.zeros(len(exposed_s), bool)
    at = np.clip(np.searchsorted(t, exposed_s), 0, len(t) - 1)
    back = np.clip(np.searchsorted(t, exposed_s - AFTER_PUSH_S), 0, len(t) - 1)
    so_far = np.concatenate([[0], np.cumsum(operated)])
    return so_far[at + 1] > so_far[back]


def _at_wall(ball_m: np.ndarray, reach_m: float) -> np.ndarray:
    """True (k,) for exposures of a ball (k, 2) that touches a wall before the next one or did so
    since the last one: its place and its way between two exposures reach beyond `reach_m`."""
    if not np.isfinite(reach_m) or len(ball_m) < 2:
        return np.zeros(len(ball_m), bool)
    step = np.abs(np.diff(ball_m, axis=0))
    way = np.maximum(np.vstack([step[:1], step]), np.vstack([step, step[-1:]]))
    return np.asarray(np.any(np.abs(ball_m) + way > reach_m - WALL_MARGIN_M, axis=1))


def _thinned(known: Signals) -> Signals:
    """At most MAX_RATE_HZ: angles of every m-th row, volts their mean until the next."""
    step = float(np.median(np.diff(known.t_s))) if len(known.t_s) > 1 else 1.0
    m = int(np.ceil(1.0 / (MAX_RATE_HZ * step) - 1e-9))
    if m <= 1:
        return known
    n = len(known.t_s) // m * m
    volts = known.volts_V[:n].reshape(-1, m, 2).mean(axis=1)
    told = None if known.told_rad is None else known.told_rad[:n:m].copy()
    t_s = known.t_s[:n:m].copy()
    return replace(
        known,
        t_s=t_s,
        resumed=after_holes(t_s),
        theta_rad=known.theta_rad[:n:m].copy(),
        volts_V=volts,
        told_rad=told,
    )


@dataclass(frozen=True, eq=False)
class Evidence:
    """Runs of one table with the noise levels (dtype NOISE) of the filters.

    `ball_axes`: whether x and y of the ball were seen; `masks`: output -> weights (n,) of its
    residuals; `threads`: fits or predictions at a time; `fits`: kept by all that is made of it.
    """

    runs: tuple[Signals, ...]
    levels: np.record
    ball_axes: tuple[bool, bool]
    masks: dict[str, np.ndarray]
    threads: int = 1
    fits: KeptFits = field(default_factory=KeptFits)

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """The outputs that have a weight above 0, in the order of OUTPUTS."""
        return tuple(
            output for output in OUTPUTS if output in self.masks and self.masks[output].any()
        )

    def roll(self, model: Model, output: str) -> Roll:
        """Residuals of an output under a model, all runs one after the other; 0 where a signal is
        missing.

        Where one residual exceeds DIVERGED_Z, or its deviation is no number, or none is one, all
        are set to DIVERGED_Z, so that the cost is higher than that of any other prediction.
        """
        n, worst, begin = len(self.masks[output]), 0.0, 0
        z, log_std, blind = np.zeros(n), np.zeros(n), np.ones(n, np.bool_)
        for run, left in self._parts[output]:
            out, std = self._innovations(run, model, output)
            end = begin + len(out)
            into = z[begin:end], log_std[begin:end], blind[begin:end]
            worst, begin = max(worst, _standardize(out, std, *into)), end + left
        if worst > DIVERGED_Z:
            z[~blind] = DIVERGED_Z
        if blind.all():
            z[:] = DIVERGED_Z
        return Roll(z, log_std)

    @cached_property
    def _parts(self) -> dict[str, list[tuple[Signals, int]]]:
        """By output each run up to its last sample with a weight, and how many follow that: what a
        filter expects depends on what came before alone."""
        parts: dict[str, list[tuple[Signals, int]]] = {}
        for output, mask in self.masks.items():
            width = 2 if output == BALL else 1
            sizes = [len(run.exposed_s if output == BALL else run.t_s) for run in self.runs]
            own = np.split(mask, width * np.cumsum(sizes)[:-1])
            used = [int(np.flatnonzero(m)[-1]) // width + 1 if m.any() else 0 for m in own]
            parts[output] = [
                (_until(run, output, last), width * (n - last))
                for run, n, last in zip(self.runs, sizes, used, strict=True)
            ]
        return parts

    def _innovations(
        self, run: Signals, model: Model, output: str
    ) -> tuple[np.ndarray, np.ndarray]:
        """Innovations (k,) of an output in a run, and their expected deviations."""
        if output == BALL:
            out, std = ball_innovations(model.record, run, self.levels)
            return out.ravel(), np.repeat(std, 2)
        a = SERVO.index(output)
        servo = model.gain_rad_s_V, model.time_constant_s
        out, std = servo_innovations(model.record, run, self.levels, *servo, (a,))
        return out[:, a], std[:, a]

    def rolls(self, wanted: Iterable[tuple[Model, str]]) -> list[Roll]:
        """Predictions for (model, output) pairs, in their order, on `threads` threads."""
        return self.each(lambda pair: self.roll(*pair), wanted)

    def each(self, call: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
        """`call` of each item, in their order, on `threads` threads (`side_by_side`)."""
        return side_by_side(call, items, self.threads)

    def times(self, output: str) -> tuple[np.ndarray, np.ndarray]:
        """Time [s] and run number of every residual of an output, (n,) each."""
        t = [np.repeat(run.exposed_s, 2) if output == BALL else run.t_s for run in self.runs]
        return np.concatenate(t), np.repeat(np.arange(len(t)), [len(x) for x in t])

    def of(self, outputs: Iterable[str]) -> "Evidence":
        """The evidence of these outputs alone."""
        return replace(self, masks={output: self.masks[output] for output in outputs})

    def with_levels(self, levels: np.record) -> "Evidence":
        """The evidence at other noise levels (dtype NOISE)."""
        return replace(self, levels=levels)


@compiled
def _standardize(out, std, z, log_std, blind) -> float:
    """Write the residuals out/std and the logarithm of std of a prediction (k,), and where there is
    none, which are left as they are; return the largest |z|, infinite where one failed: a variance
    below 0 or beyond all numbers."""
    worst = 0.0
    for i in range(len(std)):
        o, s = out[i], std[i]
        if np.isnan(o) == np.isfinite(s):
            blind[i], worst = False, inf
            continue
        if np.isfinite(s) and s > 0.0:
            log_std[i] = np.log(s)
        residual = o / s
        if not np.isnan(residual):
            blind[i], z[i] = False, residual
            worst = max(worst, abs(residual))
    return worst


def _until(run: Signals, output: str, last: int) -> Signals:
    """The run up to the sample `last` of an output."""
    if output == BALL:
        fresh = None if run.fresh is None else run.fresh[:last]
        return replace(run, exposed_s=run.exposed_s[:last], ball_m=run.ball_m[:last], fresh=fresh)
    return replace(
        run,
        t_s=run.t_s[:last],
        volts_V=run.volts_V[:last],
        theta_rad=run.theta_rad[:last],
        corrected=None if run.corrected is None else run.corrected[:last],
        resumed=None if run.resumed is None else run.resumed[:last],
    )


def gather(runs: Sequence[Signals], levels: np.record, *, threads: int = 1) -> Evidence:
    """The evidence of runs at start levels of noise (dtype NOISE; an encoder's: count/sqrt(12)).

    Weights: `information_weights` over the number of repetitions for the servos, 1 for the ball, 0
    for the first innovations of a filter and for missing signals.
    """
    masks, count_rad = {}, 12**0.5 * float(np.mean(levels["servo_measured"]))
    for a, output in enumerate(SERVO):
        weights = [_servo_weights(run, a, count_rad) for run in runs]
        masks[output] = np.concatenate(weights)
    seen = tuple(bool(any(np.any(run.ball_m[:, a]) for run in runs)) for a in range(2))
    masks[BALL] = np.concatenate([_ball_weights(run, seen) for run in runs])
    return Evidence(tuple(runs), levels, (seen[0], seen[1]), masks, threads)


def information_weights(angle: np.ndarray, step_s: float, count_rad: float) -> np.ndarray:
    """Weight (n,) of each encoder reading, MIN_WEIGHT to 1.

        w = clip(counts passed within -+WEIGHT_WINDOW_S / FULL_WEIGHT_COUNTS, MIN_WEIGHT, 1)

    `angle` (n,) [rad]; `step_s`: sampling period; `count_rad`: one encoder count. Between two
    counts of a slow servo the quantisation error is a constant: it is no independent noise and does
    not average out (Widrow and Kollar, Quantization Noise, 2008).
    """
    half = max(1, round(WEIGHT_WINDOW_S / step_s))
    counted = np.abs(np.diff(angle, prepend=angle[0])) / count_rad
    near = np.convolve(counted, np.ones(2 * half + 1), "full")[half : half + len(counted)]
    return np.clip(near / FULL_WEIGHT_COUNTS, MIN_WEIGHT, 1.0)


def _repetitions(angle: np.ndarray) -> float:
    """How often a run repeats one motion (autocorrelation above REPEATED_CORRELATION); 1 if not.

    Equal cycles repeat the same small errors of the model: their samples are not independent.
    """
    x = angle - angle.mean()
    n = len(x)
    if n < 8 or not x.any():
        return 1.0
    lag = np.arange(1, n // 2)
    product = np.fft.irfft(np.abs(np.fft.rfft(x, 2 * n)) ** 2)[lag]
    power = np.concatenate([[0.0], np.cumsum(x * x)])
    alike = product / np.maximum(np.sqrt(power[n - lag] * (power[n] - power[lag])), 1e-30)
    other = np.flatnonzero(alike < 0.5)  # before, it is only slow
    again = np.flatnonzero(alike > REPEATED_CORRELATION)
    again = again[again > other[0]] if len(other) else again[:0]
    return n / int(lag[again[0]]) if len(again) else 1.0


def _servo_weights(run: Signals, a: int, count_rad: float) -> np.ndarray:
    if not run.has_servo(a) or len(run.t_s) < 2:
        return np.zeros(len(run.t_s))
    step_s = float(np.median(np.diff(run.t_s)))
    weights = information_weights(run.theta_rad[:, a], step_s, count_rad) / _repetitions(
        run.theta_rad[:, a]
    )
    resumed = [] if run.resumed is None else np.flatnonzero(run.resumed)
    for first in (0, *resumed):
        weights[first : first + SETTLING_SAMPLES["servo_x"]] = 0.0
    weights[_untold(run, run.t_s)] = 0.0
    return weights


def _ball_weights(run: Signals, seen: tuple[bool, ...]) -> np.ndarray:
    weights = np.ones((len(run.exposed_s), 2)) * np.array(seen, float)
    fresh = run.fresh if run.fresh is not None else np.zeros(len(weights), bool)
    gaps = np.flatnonzero(fresh | (np.diff(run.exposed_s, prepend=-1e9) > 0.25))
    for first in gaps:
        weights[first : first + SETTLING_SAMPLES[BALL]] = 0.0
    weights[_untold(run, run.exposed_s)] = 0.0
    return weights.ravel()


def _untold(run: Signals, t_s: np.ndarray) -> np.ndarray:
    """True (n,) for the times `t_s` (n,) [s] up to UNTOLD_S after the first row and after a hole in
    the rows: what servos that take an angle were told before, they still do, and the ball shows it.
    """
    if not (run.commanded or run.told_rad is not None):
        return np.zeros(len(t_s), bool)
    behind = [] if run.resumed is None else run.t_s[run.resumed]
    begun = np.concatenate([[-np.inf], run.t_s[:1], behind])
    return t_s - begun[np.searchsorted(begun, t_s, side="right") - 1] < UNTOLD_S
