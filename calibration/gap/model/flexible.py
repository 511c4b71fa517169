"""A flexible model of a disturbance: what the data explain of each other, whatever the rig's model.

Noise that is estimated beside a wrong model takes the model's misfit in: a filter with enough
process noise follows anything. Here everything that is a smooth function of what was measured may
act as a disturbance f, without a physical meaning: delayed angles and volts, hinges of the volts,
position and speed with their products, the sign of a motion, time. The innovations that f causes
are those of the observer's response h (`calibration.gap.locate.disturbances.response` has the same
filter), so f = F c is a linear regression:

    z = (h * F) c + e,   e: what no such model explains

Speeds are differences of earlier samples alone: a regressor that knows the noise of the sample it
has to explain would explain it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import lfilter

from calibration.gap.model.data import within
from calibration.gap.model.parameters import BALL, SERVO
from rig.prediction.innovations import Signals

# Lags of an angle, as far as cameras and servos are late, and of the other axis's; chosen.
LAGS_S, OTHER_LAGS_S = (0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4), (0.0, 0.15)
VOLT_LAGS_S = (0.002, 0.004, 0.008, 0.015, 0.03, 0.06, 0.1)  # chosen
HINGES = (0.05, 0.1, 0.2, 0.35, 0.5, 0.7)  # shares of the largest volts, a piecewise line; chosen
TURNS = (0.02, 0.1, 0.4)  # shares of the fastest speed over which the sign of a motion changes
SPEED_S = {"servo": 0.03, BALL: 0.08}  # span of the difference quotient; chosen
BALL_STATES, SERVO_STATES = 11, 8
HAT_S = 4.0  # several folds of a cross-validation by seconds, and several hats a log; chosen
MAX_HATS = 40  # bounds the work for long logs; chosen
SHRINKAGE = (1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0, np.inf)  # of regressors with unit mean square
SAMPLES_PER_REGRESSOR = 40  # at least: fewer, and noise is explained, too; chosen


@dataclass(frozen=True, eq=False)
class Regressors:
    """The regressors F of one channel: what a disturbance may be made of.

    `runs`: one matrix (n, k) a run, for each of its n samples the k regressors' values over the
    interval that ends in it, the last `states` columns (functions of position and speed) as they
    were at its begin. `step_s`: sampling period; `tau_s`: time in which a speed decays (infinite: a
    free mass).
    """

    runs: tuple[np.ndarray, ...]
    states: int
    step_s: float
    tau_s: float

    def over(self, places: Sequence[np.ndarray]) -> "Regressors":
        """The regressors for a filter that sees only the samples `places` (m,) of each run: over
        the longer interval between two of them inputs are means, states those at its begin.
        """
        runs, steps = [], []
        for run, at in zip(self.runs, places, strict=True):
            sums = np.cumsum(run, axis=0)
            whole = np.diff(at, prepend=at[:1] - 1)[:, None]
            mean = np.diff(sums[at], axis=0, prepend=0 * sums[:1]) / whole
            k = run.shape[1] - self.states
            begin = run[np.minimum(np.concatenate([at[:1], at[:-1] + 1]), len(run) - 1)][:, k:]
            runs.append(np.hstack([mean[:, :k], begin]))
            steps.append(np.diff(at))
        ratio = float(np.median(np.concatenate(steps))) if steps else 1.0
        return replace(self, runs=tuple(runs), step_s=ratio * self.step_s)

    def unexplained(
        self, z: np.ndarray, w: np.ndarray, process: float, measured: float
    ) -> np.ndarray:
        """The residuals e (n,) of the module's regression, scaled up for the number of regressors.

        `z` (n,): innovations in expected deviations, all runs one after the other; `w` (n,):
        weights; `process`, `measured`: noise levels of the filter, as of `observer`.
        """
        f = self._responses(w, process, measured)
        c, used = _least_squares(f, z, w)
        effective = float(np.sum(w > 0))
        return (z - f @ c) * np.sqrt(effective / max(effective - used, 1.0))

    def predicted(
        self, z: np.ndarray, w: np.ndarray, fold: np.ndarray, process: float, measured: float
    ) -> np.ndarray:
        """The innovations (n,) that the regression fitted on the other folds expects; `fold` (n,):
        the fold of each sample, 0 to K - 1. Other arguments as of `unexplained`.

        A ridge of SHRINKAGE times the number of samples keeps what few samples tell from deciding:
        the one with which the other folds predict each other best. Infinite, it expects nothing.
        """
        f, said = self._responses(w, process, measured), np.zeros(len(z))
        folds = [fold == one for one in range(int(fold.max(initial=-1)) + 1)]
        sums = [_Moments.of(f[here], z[here], w[here]) for here in folds]
        for one, here in enumerate(folds):
            others = sums[:one] + sums[one + 1 :]
            total = sum(others[1:], start=others[0])
            ridge = min(SHRINKAGE, key=lambda share: _misses(others, total, share))
            said[here] = f[here] @ total.coefficients(ridge)
        return said

    def _responses(self, w: np.ndarray, process: float, measured: float) -> np.ndarray:
        """h * F (n, k) of the module's equation where the weights w (n,) are not 0, to a scale."""
        b, a = observer(self.step_s, process, measured, self.tau_s)
        f = np.concatenate([lfilter(b, a, run, axis=0) for run in self.runs])
        f *= w[:, None] > 0
        return f / (np.sqrt(np.mean(f * f, axis=0)) + 1e-30)


@dataclass(frozen=True, eq=False)
class _Moments:
    """What a fit needs of some samples: F'WF (k, k), F'Wz (k,) and the sum of the weights W."""

    ff: np.ndarray
    fz: np.ndarray
    weight: float

    @classmethod
    def of(cls, f: np.ndarray, z: np.ndarray, w: np.ndarray) -> "_Moments":
        weighted = f * w[:, None]
        return cls(weighted.T @ f, weighted.T @ z, float(np.sum(w)))

    def __add__(self, other: "_Moments") -> "_Moments":
        return _Moments(self.ff + other.ff, self.fz + other.fz, self.weight + other.weight)

    def __sub__(self, other: "_Moments") -> "_Moments":
        return _Moments(self.ff - other.ff, self.fz - other.fz, self.weight - other.weight)

    def coefficients(self, shrinkage: float) -> np.ndarray:
        """Ridge regression (k,): (F'WF + shrinkage n 1)^-1 F'Wz (Hoerl and Kennard, Technometrics
        12, 1970)."""
        if not np.isfinite(shrinkage):
            return np.zeros(len(self.fz))
        ridge = shrinkage * max(self.weight, 1.0) * np.eye(len(self.fz))
        return np.linalg.solve(self.ff + ridge, self.fz)

    def misses(self, c: np.ndarray) -> float:
        """By how much the weighted square of z - F c is above that of z."""
        return float(c @ self.ff @ c - 2.0 * c @ self.fz)


def _misses(folds: Sequence[_Moments], total: _Moments, shrinkage: float) -> float:
    """The misses of predicting each fold from the rest of them with this shrinkage."""
    return sum(one.misses((total - one).coefficients(shrinkage)) for one in folds)


def _least_squares(f: np.ndarray, z: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, int]:
    """Coefficients (k,) of z = f c with weights w (n,) along the directions of f (n, k) that the
    samples tell, at most one for SAMPLES_PER_REGRESSOR of them, and the number of directions."""
    size, shape = np.linalg.eigh((f * w[:, None]).T @ f)
    most = int(float(np.sum(w > 0)) / SAMPLES_PER_REGRESSOR)
    kept = np.flatnonzero(size > 1e-6 * size[-1])[-most:] if most else np.zeros(0, int)
    along = shape[:, kept]
    return along @ ((along.T @ (f.T @ (w * z))) / size[kept]), len(kept)


def with_hats(rows: Regressors, times: Sequence[np.ndarray]) -> Regressors:
    """The regressors and, run by run, hats HAT_S apart over the times (n,) of their samples (so far
    apart that there are at most MAX_HATS): a disturbance that changes slowly, or by steps."""
    apart = max(HAT_S, sum(float(np.ptp(t)) for t in times if len(t)) / MAX_HATS)
    wanted = [np.arange(t[0], t[-1] + apart, apart) if len(t) else np.zeros(0) for t in times]
    total, done, runs = sum(map(len, wanted)), 0, []
    for run, t, tops in zip(rows.runs, times, wanted, strict=True):
        hats = np.zeros((len(t), total))
        hats[:, done : done + len(tops)] = np.maximum(
            1.0 - np.abs(t[:, None] - tops[None, :]) / apart, 0.0
        )
        done += len(tops)
        runs.append(np.hstack([hats, run]))
    return replace(rows, runs=tuple(runs))


def observer(
    step_s: float, process: float, measured: float, tau_s: float = np.inf
) -> tuple[np.ndarray, np.ndarray]:
    """Numerator (2,) and denominator (3,) of the steady-state Kalman filter from a disturbance to
    the innovations, for position and speed sampled every `step_s`.

    `process`: density of white acceleration [m or rad, /s2/sqrt(Hz)]; `measured`: standard
    deviation of a position [m or rad]; `tau_s`: time constant in which speed decays (infinite: a
    free mass).
    """
    decay = float(np.exp(-step_s / tau_s))
    reach = tau_s * (1.0 - decay) if np.isfinite(tau_s) else step_s
    f = np.array([[1.0, reach], [0.0, decay]])
    q = process**2 * step_s * np.array([[step_s**2 / 3, step_s / 2], [step_s / 2, 1.0]])
    p, gain = np.diag([measured**2, 1.0]), np.zeros(2)
    for _ in range(500):
        ahead = f @ p @ f.T + q
        gain = ahead[:, 0] / (ahead[0, 0] + measured**2)
        after = ahead - np.outer(gain, ahead[0])
        if np.allclose(after, p, rtol=1e-6, atol=0.0):
            break
        p = after
    closed = f @ (np.eye(2) - np.outer(gain, [1.0, 0.0]))
    kick = np.array([0.5 * step_s, 1.0])
    trace, determinant = closed[0, 0] + closed[1, 1], np.linalg.det(closed)
    first, second = kick[0], (closed @ kick)[0]
    return np.array([first, second - trace * first]), np.array([1.0, -trace, determinant])


def ball_regressors(runs: Sequence[Signals], half_side_m: float) -> tuple[Regressors, ...]:
    """The regressors of the ball's axes x and y, for accelerations of the ball; `half_side_m`: of
    the plate.
    """
    step = _step([run.exposed_s for run in runs])
    return tuple(
        Regressors(tuple(_ball(run, a, half_side_m) for run in runs), BALL_STATES, step, np.inf)
        for a in range(2)
    )


def servo_regressors(runs: Sequence[Signals], output: str, tau_s: float) -> Regressors:
    """The regressors of the servo `output` ("servo_x" or "servo_y"), for volts; `tau_s`: its time
    constant.
    """
    a = SERVO.index(output)
    step = _step([run.t_s for run in runs])
    return Regressors(tuple(_servo(run, a) for run in runs), SERVO_STATES, step, tau_s)


def _step(times: Sequence[np.ndarray]) -> float:
    return float(np.median(np.concatenate([np.diff(t) for t in times if len(t) > 1])))


def _speed(x: np.ndarray, t: np.ndarray, span_s: float) -> np.ndarray:
    """Backward difference quotient over `span_s`, as a share of its 99 % quantile."""
    m = within(t, span_s)
    v = np.zeros_like(x)
    v[m:] = ((x[m:] - x[:-m]).T / (t[m:] - t[:-m])).T
    return v / (float(np.quantile(np.abs(v), 0.99)) + 1e-12)


def _before(columns: list[np.ndarray]) -> np.ndarray:
    """The columns as they were one sample earlier: at the begin of each interval."""
    matrix = np.column_stack(columns)
    return np.vstack([matrix[:1], matrix[:-1]])


def _mean_since(t: np.ndarray, t_s: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Means (n,) of an angle between each of the times t (n,) and the one before; the first: its
    value there."""
    area = cumulative_trapezoid(angle, t_s, initial=0.0)
    mean = np.diff(np.interp(t, t_s, area)) / np.diff(t)
    return np.concatenate([np.interp(t[:1], t_s, angle), mean])


def _ball(run: Signals, a: int, half_side_m: float) -> np.ndarray:
    t, place = run.exposed_s, run.ball_m / half_side_m
    if len(t) < 2:
        return np.zeros((len(t), 2 + len(LAGS_S) + len(OTHER_LAGS_S) + BALL_STATES))
    v = _speed(run.ball_m, t, SPEED_S[BALL])
    x, y, u = place[:, a], place[:, 1 - a], v[:, a]
    state = [x, y, x * x, x * y, y * y, x**3, u, v[:, 1 - a], u * np.abs(u), np.abs(u)]
    state += [np.tanh(u / TURNS[1])]
    pairs = [(lag, a) for lag in LAGS_S] + [(lag, 1 - a) for lag in OTHER_LAGS_S]
    driven = [_mean_since(t - lag, run.t_s, run.theta_rad[:, axis]) for lag, axis in pairs]
    return np.column_stack([np.ones(len(t)), _clock(t), *driven, _before(state)])


def _servo(run: Signals, a: int) -> np.ndarray:
    t, volts, angle = run.t_s, run.volts_V[:, a], run.theta_rad[:, a]
    if len(t) < 2:
        return np.zeros((len(t), 4 + len(VOLT_LAGS_S) + 2 * len(HINGES) + SERVO_STATES))
    w = _speed(angle, t, SPEED_S["servo"])
    largest = float(np.max(np.abs(volts), initial=0.0))
    driven = [volts, np.abs(run.volts_V[:, 1 - a])]
    driven += [np.interp(t - lag, t, volts) for lag in VOLT_LAGS_S]
    driven += [np.maximum(s * volts - h * largest, 0.0) for h in HINGES for s in (1.0, -1.0)]
    state = [np.tanh(w / share) for share in TURNS]
    state += [np.abs(w), w * np.abs(w), angle, angle**2, angle**3]
    return np.column_stack([np.ones(len(t)), _before([_clock(t), *driven, *state])])


def _clock(t: np.ndarray) -> np.ndarray:
    """Time from -0.5 at the begin to 0.5 at the end."""
    return (t - t.mean()) / max(float(np.ptp(t)), 1e-9)
