"""Noise levels of the filters, from what the data say of each other, whatever the rig's model.

    (q, r) = argmin sum m (rho(e/s)/kappa + log s)

e: what a flexible model leaves of the innovations (`calibration.gap.model.flexible`).

Process noise is what no smooth function of the measured signals explains over HORIZON_S, so the
filter sees every sample that is so far from the one before. One sample ahead is not enough: at 100
Hz white noise that is large enough explains any misfit, and the noise of a controller that
differentiates the position enters the plate with it. Levels that were estimated beside the model
alone would take its misfit in. rho is Huber's loss at NOISE_HUBER_Z with its consistency factor
kappa for Gaussian residuals (Huber and Ronchetti, Robust Statistics, 2009, ch. 6), so that a push
does not raise the level.

Ball: process noise q (white acceleration) [m/s2/sqrt(Hz)], camera noise r [m] and its AR(1)
coefficient rho from frame to frame, by maximum likelihood at the rate of the camera; q is at least
what the rounding of the angles does to the ball (`rounding_process`), which a flexible model can
follow but not foresee. Servo, per axis: process noise q and the encoder's r [rad], where it moves:
the error of a resting encoder is a constant.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize
from scipy.stats import norm

from calibration.gap.model.cost import weights
from calibration.gap.model.data import HORIZON_S, MIN_WEIGHT, Evidence, Roll, every, gather
from calibration.gap.model.flexible import Regressors, ball_regressors, servo_regressors
from calibration.gap.model.parameters import BALL, SERVO, Model
from rig.parameters import GRAVITY_M_S2

NOISE_HUBER_Z = 1.0
CONSISTENCY = 2.0 * norm.cdf(NOISE_HUBER_Z) - 1.0  # E[psi(z) z] of a standard normal z
MIN_COLOUR_GAIN = 6.0  # log-likelihood that an AR(1) camera noise has to gain; chosen
DIVERGED_COST = 1e9  # of noise levels under which a filter overflows
SMALLEST_M = 2e-6
# For which a rounded angle errs by the same: a plate rests so long behind the play of its joints
# between two reversals, an arm within a count. Chosen.
ROUNDING_LASTS_S = 0.5
RHOS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)


def estimate(evidence: Evidence, model: Model, outputs: tuple[str, ...]) -> np.record:
    """Noise levels (dtype NOISE) of these outputs by the module's equation, beside the flexible
    model on top of `model`; levels of other outputs stay as in the evidence."""
    levels = evidence.levels.copy()
    for output in outputs:
        if output == BALL:
            _ball(evidence, model, levels)
        else:
            _servo(evidence, model, levels, SERVO.index(output))
    return levels


def thinned(evidence: Evidence, output: str) -> tuple[Evidence, list[np.ndarray]]:
    """The evidence of a servo whose filter is corrected once each HORIZON_S, and the places (m,) of
    these corrections in every run."""
    chosen = [
        every(run.t_s, np.zeros(len(run.t_s), bool), HORIZON_S[output]) for run in evidence.runs
    ]
    runs = [replace(run, corrected=at) for run, at in zip(evidence.runs, chosen, strict=True)]
    few = gather(runs, evidence.levels)
    return few.of([output]), [np.flatnonzero(at) for at in chosen]


def _moving(mask: np.ndarray) -> np.ndarray:
    """The weights (n,) without those of an arm that rests, MIN_WEIGHT of the largest: its encoder
    repeats one count, and its process noise is nothing that friction holds. All where it never
    moves."""
    moves = mask > MIN_WEIGHT * mask.max(initial=0.0)
    return mask * moves if moves.any() else mask


def _level(roll: Roll, z: np.ndarray, mask: np.ndarray) -> float:
    """The module's cost of residuals z (n,) in the place of those of `roll`."""
    size = np.abs(z)
    h = NOISE_HUBER_Z
    rho = np.where(size <= h, 0.5 * size * size, h * (size - 0.5 * h)) / CONSISTENCY
    return float(np.sum(mask * (rho + roll.log_std)))


def _search(cost: Callable[[np.ndarray], float], start: list[float]) -> np.ndarray:
    """argmin by Nelder and Mead over logarithms: first steps of a factor 2, 5 % at the end."""
    simplex = np.array(
        [start] + [[v + 0.7 * (i == j) for j, v in enumerate(start)] for i in range(len(start))]
    )
    options = {"initial_simplex": simplex, "xatol": 0.05, "fatol": 0.5, "maxfev": 60}

    def finite(x: np.ndarray) -> float:
        value = cost(x)
        return value if np.isfinite(value) else DIVERGED_COST

    return minimize(finite, start, method="Nelder-Mead", options=options).x


def _servo(evidence: Evidence, model: Model, levels: np.record, a: int) -> None:
    output, smallest = SERVO[a], 0.02 * levels["servo_measured"][a]
    few, places = thinned(evidence, output)
    mask, here = _moving(few.masks[output]), np.zeros(len(few.masks[output]), np.bool_)
    starts = np.cumsum([0, *(len(run.t_s) for run in few.runs[:-1])])
    here[np.concatenate([at + start for at, start in zip(places, starts, strict=True)])] = True
    rows = servo_regressors(evidence.runs, output, model.time_constant_s[a]).over(places)

    def cost(x: np.ndarray) -> float:
        levels["servo_process"][a], levels["servo_measured"][a] = np.exp(x)
        penalty = 1e6 if np.exp(x[1]) < smallest or not -12 < x[0] < 8 else 0.0
        roll = few.with_levels(levels).roll(model, output)
        z, m = roll.z[here], mask[here]
        left = rows.unexplained(z, weights(z, m), *np.exp(x))
        return _level(Roll(left, roll.log_std[here]), left, m) + penalty

    start = [float(np.log(levels[n][a])) for n in ("servo_process", "servo_measured")]
    best = np.exp(_search(cost, start))
    levels["servo_process"][a], levels["servo_measured"][a] = best


def _ball(evidence: Evidence, model: Model, levels: np.record) -> None:
    levels["ball_memory_s"] = 0.0
    rows = ball_regressors(evidence.runs, float(model.record["half_side"].max()))
    least = rounding_process(model.record, levels)

    def cost(x: np.ndarray) -> float:
        levels["ball_process"], levels["ball_measured"] = np.exp(x)
        penalty = 1e6 if np.exp(x[1]) < SMALLEST_M or np.exp(x[0]) < least else 0.0
        return _ball_level(evidence.with_levels(levels), model, rows) + penalty

    start = max(float(levels["ball_process"]), 1.01 * least), float(levels["ball_measured"])
    white = _search(cost, [float(v) for v in np.log(start)])
    levels["ball_process"], levels["ball_measured"] = np.exp(white)
    levels["ball_memory_s"] = _memory_s(evidence, model, levels.copy(), rows)


def rounding_process(p: np.record, levels: np.record) -> float:
    """The ball's process noise [m/s2/sqrt(Hz)] by the rounding of the servo angles, of standard
    deviation s (`levels`) over T = ROUNDING_LASTS_S: white noise of the same power at frequency 0,

        q = k g (r/L) s sqrt(2 T)

    with k g the acceleration on a slope and r/L the lever of `p` (record PLANT).
    """
    angle = np.asarray(levels["servo_measured"])
    slope = float(np.sqrt(np.mean((p["ratio"] * angle) ** 2)))
    return float(p["factor"]) * GRAVITY_M_S2 * slope * float(np.sqrt(2.0 * ROUNDING_LASTS_S))


def _ball_level(evidence: Evidence, model: Model, rows: Sequence[Regressors]) -> float:
    """The module's cost of both axes of the ball at the levels of the evidence."""
    roll, mask, levels = evidence.roll(model, BALL), evidence.masks[BALL], evidence.levels
    noise = float(levels["ball_process"]), float(levels["ball_measured"])
    z, w = roll.z.reshape(-1, 2), weights(roll.z, mask).reshape(-1, 2)
    left = [rows[a].unexplained(z[:, a], w[:, a], *noise) for a in range(2)]
    return _level(roll, np.column_stack(left).ravel(), mask)


def _memory_s(
    evidence: Evidence, model: Model, levels: np.record, rows: Sequence[Regressors]
) -> float:
    """The time in which the camera's noise forgets itself [s], from frame to frame; 0 where an
    AR(1) noise gains less than MIN_COLOUR_GAIN."""
    frame_s = rows[0].step_s
    costs = {}
    for rho in RHOS:
        levels["ball_memory_s"] = -frame_s / np.log(rho) if rho else 0.0
        costs[rho] = _ball_level(evidence.with_levels(levels), model, rows)
    best = min(costs, key=lambda rho: costs[rho])
    if costs[0.0] - costs[best] < MIN_COLOUR_GAIN:
        return 0.0
    near = [rho for rho in RHOS if abs(RHOS.index(rho) - RHOS.index(best)) <= 1]
    if len(near) == 3:  # the lowest point of the parabola through three
        a, b, _ = np.polyfit(near, [costs[rho] for rho in near], 2)
        best = float(np.clip(-0.5 * b / a, near[0], near[2])) if a > 0 else best
    return float(-frame_s / np.log(best))


def least_noise(one: np.record, other: np.record) -> np.record:
    """The smaller of each of two noise levels (dtype NOISE): what is left beside the better
    model."""
    least = one.copy()
    for name in least.dtype.names or ():
        least[name] = np.minimum(one[name], other[name])
    return least
