"""The recordings as the workflow sees them: signals by run, what is masked, and roll-outs.

Two separate channels (see `rig.predict`): `servo_x`, `servo_y` (volts to encoder) and `ball`
(encoder to camera, both axes in one vector). A residual is an innovation over the deviation that
its filter expects; where a run lacks a signal or a push is masked it weighs nothing.
"""

from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calibration.gap.knobs import BALL, SERVO, Model
from rig.log import Log
from rig.predict import Signals, ball_innovations, servo_innovations, signals

FASTEST_HZ = 600.0  # above it the encoder's counts drown a tick: several become one
BROKEN = 1e6  # deviations: beyond, a roll-out is no prediction
AFTER_PUSH_S = 0.05
# Counts within MEMORY_S before and after from which on their errors average out.
MEMORY_S, ENOUGH_COUNTS, LEAST_WORTH = 0.05, 8.0, 0.4
ALIKE = 0.995  # correlation of cycles that repeat each other
SETTLE = {BALL: 4, "servo_x": 5, "servo_y": 5}  # first innovations of a filter that knows nothing
PARTS = (*SERVO, BALL)


@dataclass(frozen=True, eq=False)
class Roll:
    """A roll-out's residuals (n,) and the logarithm of their deviations (n,)."""

    z: np.ndarray
    log_std: np.ndarray

    def slope(self, base: "Roll", step: float) -> np.ndarray:
        """The secant (n,) from `base` to here; one that ran away tells none."""
        if np.max(np.abs(self.z), initial=0.0) >= BROKEN:
            return np.zeros(len(self.z))
        return (self.z - base.z) / step


def usable(log: Log, *, camera_delay_s: float) -> Signals:
    """A log's signals: fast ones thinned, missing axes 0 or NaN, held and pushed balls left out."""
    known = _thinned(signals(log, camera_delay_s=camera_delay_s))
    driven = known.has_servo(0), known.has_servo(1)
    theta = np.where(np.isnan(known.theta_rad).all(axis=0), 0.0, known.theta_rad)
    volts = np.where(np.array(driven), known.volts_V, 0.0)
    seen = ~np.isnan(known.ball_m)
    ball = np.where(seen.any(axis=0), known.ball_m, 0.0)
    kept = np.isfinite(ball).all(axis=1) & seen.any()
    touched = _touched(log, known.exposed_s)
    fresh = np.concatenate([[True], touched[:-1] & ~touched[1:]])[: len(touched)]
    kept &= ~touched
    return replace(known, theta_rad=theta, volts_V=volts, driven=driven, fresh=fresh[kept],
                   exposed_s=known.exposed_s[kept], ball_m=ball[kept])  # fmt: skip


def _touched(log: Log, exposed_s: np.ndarray) -> np.ndarray:
    """Exposures (k,) in which a hand had the ball: placed, held or pushed."""
    if not len(exposed_s):
        return np.zeros(0, bool)
    t = log["t_s"]
    hand = (np.nan_to_num(log["push"]) != 0) | (log["phase"] < 2)
    if not hand.any():
        return np.zeros(len(exposed_s), bool)
    at = np.clip(np.searchsorted(t, exposed_s), 0, len(t) - 1)
    back = np.clip(np.searchsorted(t, exposed_s - AFTER_PUSH_S), 0, len(t) - 1)
    so_far = np.concatenate([[0], np.cumsum(hand)])
    return so_far[at + 1] > so_far[back]


def _thinned(known: Signals) -> Signals:
    """At most FASTEST_HZ: angles of every m-th row, volts their mean until the next."""
    step = float(np.median(np.diff(known.t_s))) if len(known.t_s) > 1 else 1.0
    m = int(np.ceil(1.0 / (FASTEST_HZ * step) - 1e-9))
    if m <= 1:
        return known
    n = len(known.t_s) // m * m
    volts = known.volts_V[:n].reshape(-1, m, 2).mean(axis=1)
    return replace(known, t_s=known.t_s[:n:m].copy(), theta_rad=known.theta_rad[:n:m].copy(),
                   volts_V=volts)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Evidence:
    """Runs of one table with the noise levels of its filters.

    ball_axes: whether x and y of the ball were seen; masks: part -> weights (n,) of its residuals.
    """

    runs: tuple[Signals, ...]
    levels: np.record
    ball_axes: tuple[bool, bool]
    masks: dict[str, np.ndarray]
    threads: int = 1

    @cached_property
    def parts(self) -> tuple[str, ...]:
        """The parts for which there are signals and motion."""
        return tuple(part for part in PARTS if part in self.masks and self.masks[part].any())

    def roll(self, model: Model, part: str) -> Roll:
        """Residuals of a part under a model, all runs one after the other."""
        found = [self._run(run, model, part) for run in self.runs]
        z, log_std = (np.concatenate(column) for column in zip(*found, strict=True))
        blind = ~np.isfinite(z)
        z[blind] = 0.0
        if np.max(np.abs(z), initial=0.0) > BROKEN:
            z[~blind] = BROKEN  # it ran away: no model of this log
        log_std[blind] = 0.0
        return Roll(z, log_std)

    def _run(self, run: Signals, model: Model, part: str) -> tuple[np.ndarray, np.ndarray]:
        if part == BALL:
            out, std = ball_innovations(model.record, run, self.levels)
            spread = np.repeat(std, 2)
            return out.ravel() / spread, np.log(spread)
        a = SERVO.index(part)
        out, std = servo_innovations(
            model.record, run, self.levels, model.gain_rad_s_V, model.time_constant_s, (a,)
        )
        return out[:, a] / std[:, a], np.log(std[:, a])

    def rolls(self, wanted: Iterable[tuple[Model, str]]) -> list[Roll]:
        """Many roll-outs, on as many threads as allowed; the order is kept."""
        wanted = list(wanted)
        if self.threads == 1 or len(wanted) < 2:
            return [self.roll(model, part) for model, part in wanted]
        with ThreadPoolExecutor(self.threads) as pool:
            return list(pool.map(lambda pair: self.roll(*pair), wanted))

    def times(self, part: str) -> tuple[np.ndarray, np.ndarray]:
        """Time [s] and run number of every residual of a part, (n,) each."""
        t = [np.repeat(run.exposed_s, 2) if part == BALL else run.t_s for run in self.runs]
        return np.concatenate(t), np.repeat(np.arange(len(t)), [len(x) for x in t])

    def with_levels(self, levels: np.record) -> "Evidence":
        return replace(self, levels=levels)


def gather(runs: Sequence[Signals], levels: np.record, *, threads: int = 1) -> Evidence:
    """Evidence of runs: all that is there counts but the filters' first innovations.

    `levels` as a start: an encoder's level is its count over sqrt(12).
    """
    masks, count_rad = {}, 12**0.5 * float(np.mean(levels["servo_measured"]))
    for a, part in enumerate(SERVO):
        weights = [_servo_weights(run, a, count_rad) for run in runs]
        masks[part] = np.concatenate(weights)
    seen = tuple(bool(any(np.any(run.ball_m[:, a]) for run in runs)) for a in range(2))
    masks[BALL] = np.concatenate([_ball_weights(run, seen) for run in runs])
    return Evidence(tuple(runs), levels, (seen[0], seen[1]), masks, threads)


def _tells(angle: np.ndarray, step_s: float, count_rad: float) -> np.ndarray:
    """How much of a sample each reading (n,) of an encoder is worth, at least LEAST_WORTH.

    Between two counts of a slow servo the error is one constant, and no noise that averages out.
    """
    half = max(1, round(MEMORY_S / step_s))
    counted = np.abs(np.diff(angle, prepend=angle[0])) / count_rad
    near = np.convolve(counted, np.ones(2 * half + 1), "full")[half : half + len(counted)]
    return np.clip(near / ENOUGH_COUNTS, LEAST_WORTH, 1.0)


def _cycles(angle: np.ndarray) -> float:
    """How often a run repeats one motion exactly, 1 for one that does not.

    Cycles that are alike show the same small faults of the model again, and nothing new.
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
    again = np.flatnonzero(alike > ALIKE)
    again = again[again > other[0]] if len(other) else again[:0]
    return n / int(lag[again[0]]) if len(again) else 1.0


def _servo_weights(run: Signals, a: int, count_rad: float) -> np.ndarray:
    if not run.has_servo(a) or len(run.t_s) < 2:
        return np.zeros(len(run.t_s))
    step_s = float(np.median(np.diff(run.t_s)))
    weights = _tells(run.theta_rad[:, a], step_s, count_rad) / _cycles(run.theta_rad[:, a])
    weights[: SETTLE["servo_x"]] = 0.0
    return weights


def _ball_weights(run: Signals, seen: tuple[bool, ...]) -> np.ndarray:
    weights = np.ones((len(run.exposed_s), 2)) * np.array(seen, float)
    fresh = run.fresh if run.fresh is not None else np.zeros(len(weights), bool)
    gaps = np.flatnonzero(fresh | (np.diff(run.exposed_s, prepend=-1e9) > 0.25))
    for first in gaps:
        weights[first : first + SETTLE[BALL]] = 0.0
    return weights.ravel()
