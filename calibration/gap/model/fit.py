"""Bounded Gauss-Newton with Huber's loss over a few parameters: the one estimator of the workflow.

Cost, over the outputs that depend on the parameters p, with e_i the innovations and s_i the
standard deviations that the filter expects of them (both depend on p; s does where backlash hides
the motor from the encoder):

    C(p) = sum_i m_i (rho(e_i/s_i) + log s_i),   rho(z) = z^2/2        for |z| <= h
                                                          h (|z| - h/2) beyond,  h = HUBER_Z

A parameter p_j that stays inside its tolerance t_j has a prior: what is minimised is

    C(p) + sum_j 3 (p_j - nominal_j)^2/(2 t_j^2),   of the variance t^2/3 of a uniform prior

(maximum a posteriori), so that parameters of which the logs say little stay nominal.

m_i are the weights of the samples (`Evidence.masks`). For Gaussian innovations C is minus the
log-likelihood but for a constant (Schweppe, IEEE Trans. Inf. Theory 11, 1965), so a difference of C
is a log-likelihood ratio; Huber's rho (Ann. Math. Stat. 35, 1964) bounds the influence of outliers.
Derivatives are secants over `Parameter.step`: backlash and friction have none at zero.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import lsq_linear

from calibration.gap.model.data import Evidence, Roll
from calibration.gap.model.parameters import COAST_KEY, NominalModel, Parameter

HUBER_Z = 3.0  # 0.27 % of Gaussian samples lie beyond
ITERATIONS = 40  # at most: a fit that is cut off loses to a worse model that is not; chosen
CONVERGED_GAIN = 0.05  # a gain in C below this ends the fit
STALE_SECANT_GAIN = 5.0  # a gain in C since the secants were taken beyond which they are renewed
# Where secants promise more than STALE_SECANT_GAIN and the step gains less than POOR_SHARE of that,
# they are too wide for a narrow valley and are taken NARROWER, to NARROWEST of a step; chosen.
POOR_SHARE, NARROWER, NARROWEST = 0.1, 0.3, 0.05
STEP_LENGTHS = (1.0, 0.33, 0.1)  # of the Gauss-Newton step, tried in turn
KINKED = ("play_rad", COAST_KEY)  # keys along which C has kinks inside its valley
Bounds = Mapping[str, tuple[float, float]]


def loss(roll: Roll, mask: np.ndarray) -> float:
    """Cost C of one output (the module's equation) for the prediction `roll` and the weights `mask`
    (n,); infinite where all residuals are 0, which no prediction of a measurement gives."""
    return float(np.sum(losses(roll, mask))) if roll.z.any() else float("inf")


def losses(roll: Roll, mask: np.ndarray) -> np.ndarray:
    """The terms (n,) of `loss`."""
    return mask * (huber(roll.z) + roll.log_std)


def huber(z: np.ndarray) -> np.ndarray:
    """Huber's loss rho (n,) of residuals (n,) in expected standard deviations."""
    size = np.abs(z)
    return np.where(size <= HUBER_Z, 0.5 * size * size, HUBER_Z * (size - 0.5 * HUBER_Z))


def weights(z: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Huber's weights (n,) times `mask`: 1 for residuals |z| <= HUBER_Z, HUBER_Z/|z| beyond."""
    return mask * np.minimum(1.0, HUBER_Z / np.maximum(np.abs(z), 1e-300))


@dataclass(frozen=True, eq=False)
class ParameterFit:
    """A setting of the parameters (name -> value), its predictions and costs by output.

    `columns`: secants dz/dp (n,) by (output, parameter name), as far as they are known near this
    setting.
    """

    setting: dict[str, float]
    rolls: dict[str, Roll]
    costs: dict[str, float]
    columns: Mapping[tuple[str, str], np.ndarray] = field(default_factory=dict)

    @property
    def cost(self) -> float:
        """Sum of the costs C of all outputs: minus a log-likelihood, without unit."""
        return sum(self.costs.values())

    def z(self, output: str) -> np.ndarray:
        """Residuals (n,) of an output, in expected standard deviations."""
        return self.rolls[output].z


def evaluate(
    evidence: Evidence, nominal: NominalModel, setting: Mapping[str, float], outputs: Iterable[str]
) -> ParameterFit:
    """The predictions and costs of a setting (parameter name -> value) on some outputs; nothing is
    fitted. `KeyError`: no such parameter."""
    model, outputs = nominal.model(setting), list(outputs)
    rolls = dict(zip(outputs, evidence.rolls([(model, output) for output in outputs]), strict=True))
    costs = {output: loss(roll, evidence.masks[output]) for output, roll in rolls.items()}
    return ParameterFit(dict(setting), rolls, costs)


def differences(
    evidence: Evidence,
    nominal: NominalModel,
    at: ParameterFit,
    parameters: Sequence[Parameter],
    bounds: Bounds,
    width: float = 1.0,
) -> dict[str, np.ndarray]:
    """Secants dz/dp by output, (n, k) for n residuals and k = len(`parameters`); those that `at`
    already has are taken from `at.columns`.

    The step is `width` times `Parameter.step`, backwards where it would leave `bounds` (name ->
    (low, high)) upwards. The column is 0 for an output that does not depend on the parameter.
    """
    columns = {
        output: np.zeros((len(roll.z), len(parameters))) for output, roll in at.rolls.items()
    }
    todo = []
    for i, parameter in enumerate(parameters):
        for output in parameter.outputs:
            if output in columns and (output, parameter.name) in at.columns:
                columns[output][:, i] = at.columns[output, parameter.name]
        outputs = [
            p for p in parameter.outputs if p in columns and (p, parameter.name) not in at.columns
        ]
        if not outputs:
            continue
        value = at.setting.get(parameter.name, parameter.nominal)
        low, high = bounds[parameter.name]
        step = width * parameter.step
        if value + step > high and value - step >= low:
            step = -step
        model = nominal.model(at.setting | {parameter.name: value + step})
        todo += [(i, step, model, output) for output in outputs]
    rolls = evidence.rolls([(model, output) for _, _, model, output in todo])
    for (i, step, _, output), roll in zip(todo, rolls, strict=True):
        columns[output][:, i] = roll.slope(at.rolls[output], step)
    return columns


def kept_columns(
    columns: Mapping[str, np.ndarray], parameters: Sequence[Parameter], dropping: Collection[str]
) -> dict[tuple[str, str], np.ndarray]:
    """Columns (n,) by (output, parameter name) out of `columns`, output -> (n, k), without those of
    the effects `dropping`, whose secants change from step to step (backlash, delays, periods)."""
    return {
        (output, parameter.name): columns[output][:, i]
        for output in columns
        for i, parameter in enumerate(parameters)
        if output in parameter.outputs and parameter.effect not in dropping
    }


def normal_equations(
    evidence: Evidence, at: ParameterFit, columns: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """J'WJ (k, k) and J'Wz (k,) summed over the outputs of `columns` (output -> J (n, k)); W:
    Huber's weights times the masks."""
    k = next(iter(columns.values())).shape[1]
    a, b = np.zeros((k, k)), np.zeros(k)
    for output, j in columns.items():
        w = weights(at.rolls[output].z, evidence.masks[output])
        wj = j * w[:, None]
        a += wj.T @ j
        b += wj.T @ at.rolls[output].z
    return a, b


def bounded_step(
    a: np.ndarray, b: np.ndarray, low: np.ndarray, high: np.ndarray, scale: np.ndarray
) -> np.ndarray:
    """argmin_d d'Ad/2 + b'd subject to low <= d <= high, all (k,), A (k, k); `scale` (k,): the
    parameters' steps. Solved by bounded-variable least squares (`scipy.optimize.lsq_linear`).

    A ridge of 1e-3 in units of the steps keeps a parameter on which no data depend where it is.
    `LinAlgError`: A + ridge is not positive definite.
    """
    h = a * np.outer(scale, scale)
    h[np.diag_indices_from(h)] += 1e-3
    upper = np.linalg.cholesky(h).T
    right = np.linalg.solve(upper.T, -b * scale)
    low, high = np.minimum(low / scale, -1e-12), np.maximum(high / scale, 1e-12)
    return lsq_linear(upper, right, (low, high), method="bvls").x * scale


def fit(
    evidence: Evidence,
    nominal: NominalModel,
    start: ParameterFit,
    bounds: Bounds,
    *,
    iterations: int = ITERATIONS,
    bent: Collection[str] = (),
    thorough: bool = False,
) -> ParameterFit:
    """Fit the parameters of `bounds` (name -> (low, high)) from `start` by bounded Gauss-Newton
    until C with the prior falls by less than CONVERGED_GAIN; all other parameters stay as in
    `start`.

    Secants are taken once, and at every step for the effects `bent` (backlash, delays, periods);
    those that `start` has are kept instead, also of `bent`, until all are taken anew: where a step
    gains less than POOR_SHARE of what they promise, over a smaller width, and where C stalls after
    it fell by STALE_SECANT_GAIN. Where no step along all lowers C, the parameters of backlash are
    moved one by one, once; `thorough`: all parameters are, as long as that gains
    STALE_SECANT_GAIN. `KeyError`: no such parameter.
    """
    parameters = [nominal.parameters[name] for name in bounds]
    best = _inside(evidence, nominal, start, bounds)
    scale = np.array([parameter.step for parameter in parameters])
    prior = np.array([inverse_variance(k, bounds[k.name]) for k in parameters])
    nominals = np.array([k.nominal for k in parameters])
    taken_at, width, done, searched = start.cost, 1.0, 0, False
    while done < iterations:
        columns = differences(evidence, nominal, best, parameters, bounds, width)
        best = replace(best, columns={**best.columns, **kept_columns(columns, parameters, bent)})
        a, b = normal_equations(evidence, best, columns)
        value = np.array([best.setting.get(k.name, k.nominal) for k in parameters])
        a[np.diag_indices_from(a)] += prior
        away = np.where(prior > 0.0, value - nominals, 0.0)
        b += prior * away
        low, high = (np.array([bounds[k.name][i] for k in parameters]) for i in (0, 1))
        step = bounded_step(a, b, low - value, high - value, scale)
        promised = -float(0.5 * step @ a @ step + b @ step)
        dearer = [float(prior @ (d * step * (away + 0.5 * d * step))) for d in STEP_LENGTHS]
        best, gain = _along(evidence, nominal, best, parameters, value, step, dearer)
        if gain < CONVERGED_GAIN and not searched:
            best, gain = _one_by_one(evidence, nominal, best, bounds, every=thorough)
            searched = not thorough or gain < STALE_SECANT_GAIN
        stale = gain < CONVERGED_GAIN and taken_at - best.cost >= STALE_SECANT_GAIN
        poor = promised > STALE_SECANT_GAIN and gain < POOR_SHARE * promised
        narrow = poor and width > NARROWEST
        width *= NARROWER if narrow else 1.0
        done += not narrow
        if narrow or stale:
            best, taken_at = replace(best, columns={}), best.cost
        elif gain < CONVERGED_GAIN:
            break
    return best


def _one_by_one(
    evidence: Evidence,
    nominal: NominalModel,
    at: ParameterFit,
    bounds: Bounds,
    *,
    every: bool,
) -> tuple[ParameterFit, float]:
    """Compass search: each width of backlash, and how far its arm coasts, or every parameter, alone
    by plus and minus STEP_LENGTHS of its step, and by how much C fell (Kolda, Lewis and Torczon,
    SIAM Review 45, 2003)."""
    first = at.cost
    for name, (low, high) in bounds.items():
        parameter = nominal.parameters[name]
        if not every and parameter.key not in KINKED:
            continue
        known = {at.setting.get(name, parameter.nominal)}  # bounds make them repeat
        for length in STEP_LENGTHS:
            value = at.setting.get(name, parameter.nominal)
            for end in (value - length * parameter.step, value + length * parameter.step):
                moved = min(max(end, low), high)
                if moved in known:
                    continue
                known.add(moved)
                setting = at.setting | {name: moved}
                here = [output for output in parameter.outputs if output in at.rolls]
                tried = evaluate(evidence, nominal, setting, here)
                rolls, costs = at.rolls | tried.rolls, at.costs | tried.costs
                if sum(costs.values()) < at.cost:
                    at = replace(at, setting=setting, rolls=rolls, costs=costs)
    return at, first - at.cost


def inverse_variance(parameter: Parameter, bounds: tuple[float, float]) -> float:
    """Inverse variance of the prior of the module's equation [1/unit^2]; 0 for a parameter without
    a tolerance, or one that is free to the ends of its range."""
    t = parameter.tolerance
    inside = np.isfinite(t) and t > 0 and bounds != parameter.range
    return 3.0 / t**2 if inside else 0.0


def _inside(
    evidence: Evidence, nominal: NominalModel, start: ParameterFit, bounds: Bounds
) -> ParameterFit:
    """The start with every free parameter inside its bounds."""
    moved = {}
    for name, (low, high) in bounds.items():
        value = start.setting.get(name, nominal.parameters[name].nominal)
        moved[name] = min(max(value, low), high)
    if all(start.setting.get(n, nominal.parameters[n].nominal) == v for n, v in moved.items()):
        return start
    inside = evaluate(evidence, nominal, start.setting | moved, start.rolls)
    return replace(inside, columns=start.columns)


def _along(
    evidence: Evidence,
    nominal: NominalModel,
    at: ParameterFit,
    parameters: Sequence[Parameter],
    value: np.ndarray,
    step: np.ndarray,
    dearer: Sequence[float],
) -> tuple[ParameterFit, float]:
    """The first of the shortened steps that lowers C with the prior, which rises by `dearer`, and
    by how much; `at` and 0 if none does."""
    for share, rise in zip(STEP_LENGTHS, dearer, strict=True):
        setting = dict(
            zip((k.name for k in parameters), (value + share * step).tolist(), strict=True)
        )
        tried = evaluate(evidence, nominal, at.setting | setting, at.rolls)
        tried = replace(tried, columns=at.columns)
        if tried.cost + rise < at.cost:
            return tried, at.cost - tried.cost - rise
    return at, 0.0
