"""Bounded Gauss-Newton with Huber's loss over a few parameters: the one estimator of the workflow.

The cost C (`cost`) is summed over the outputs that depend on the parameters p, as both the
innovations and the deviations expected of them do (these where backlash hides the motor from the
encoder). A parameter p_j that stays inside its tolerance t_j has a prior: what is minimised is

    C(p) + sum_j 3 (p_j - nominal_j)^2/(2 t_j^2),   of the variance t^2/3 of a uniform prior

(maximum a posteriori), so that parameters of which the logs say little stay nominal.
Derivatives are secants over `Parameter.step`: backlash and friction have none at zero.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.optimize import lsq_linear
from scipy.sparse.csgraph import connected_components

from calibration.gap.model.cost import loss, weights
from calibration.gap.model.data import Evidence, Roll
from calibration.gap.model.parameters import NominalModel, Parameter

ITERATIONS = 40  # at most: a fit that is cut off loses to a worse model that is not; chosen
CONVERGED_GAIN = 0.05  # a gain in C below this ends the fit
STALE_SECANT_GAIN = 5.0  # a gain in C since the secants were taken beyond which they are renewed
# Where secants promise more than STALE_SECANT_GAIN and the step gains less than POOR_SHARE of that,
# they are too wide for a narrow valley and are taken NARROWER, to NARROWEST of a step; chosen.
POOR_SHARE, NARROWER, NARROWEST = 0.1, 0.3, 0.05
ASTRAY = 0.5  # share of what secants promise by which the gain may differ before they are renewed
STEP_LENGTHS = (1.0, 0.33, 0.1)  # of the Gauss-Newton step, tried in turn
RIDGE = 1e-3  # of the normal matrix, in steps^-2: a parameter on which no data depend stays
# A fit is given up that lacks more than all it has gained, and GIVEN_UP times what any search along
# the axes gained; chosen: twice the most that followed in 81 fits of a run of `steps`, 10.7 times.
GIVEN_UP = 20.0
# Along a principal axis of the normal matrix, in standard deviations, tried in turn; chosen.
AXIS_LENGTHS = (9.0, 3.0, 1.0)
Bounds = Mapping[str, tuple[float, float]]


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

    The step is `_secant_step` within `bounds` (name -> (low, high)). The column is 0 for an output
    that does not depend on the parameter.
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
        step = _secant_step(value, width * parameter.step, bounds[parameter.name])
        model = nominal.model(at.setting | {parameter.name: value + step})
        todo += [(i, step, model, output) for output in outputs]
    rolls = evidence.rolls([(model, output) for _, _, model, output in todo])
    for (i, step, _, output), roll in zip(todo, rolls, strict=True):
        columns[output][:, i] = roll.slope(at.rolls[output], step)
    return columns


def _secant_step(value: float, step: float, bounds: tuple[float, float]) -> float:
    """The step of a secant: upwards, downwards where that leaves the bounds, and where both do, to
    the farther one; `step` between bounds that are one.

    A play beyond its tolerance tells nothing of one within it: by secants that reached ten times as
    far, fits of a gain asymmetry ended up to 180 above the minimum.
    """
    low, high = bounds
    if value + step <= high:
        return step
    if value - step >= low:
        return -step
    return max(high - value, low - value, key=abs) or step


def kept_columns(
    columns: Mapping[str, np.ndarray], parameters: Sequence[Parameter]
) -> dict[tuple[str, str], np.ndarray]:
    """Columns (n,) by (output, parameter name) out of `columns`, output -> (n, k)."""
    return {
        (output, parameter.name): columns[output][:, i]
        for output in columns
        for i, parameter in enumerate(parameters)
        if output in parameter.outputs
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

    RIDGE in units of the steps keeps a parameter on which no data depend where it is.
    `LinAlgError`: A + ridge is not positive definite.
    """
    h = a * np.outer(scale, scale)
    h[np.diag_indices_from(h)] += RIDGE
    upper = np.linalg.cholesky(h).T
    right = np.linalg.solve(upper.T, -b * scale)
    low, high = np.minimum(low / scale, -1e-12), np.maximum(high / scale, 1e-12)
    most = 10 * len(b)  # each frees a parameter, which may be bound again; chosen
    return lsq_linear(upper, right, (low, high), method="bvls", max_iter=most).x * scale


@dataclass(frozen=True, eq=False)
class _Problem:
    """What a fit minimises, over k `parameters` within `bounds` (name -> (low, high))."""

    evidence: Evidence
    nominal: NominalModel
    parameters: Sequence[Parameter]
    bounds: Bounds

    @cached_property
    def scale(self) -> np.ndarray:
        """The parameters' steps (k,)."""
        return np.array([parameter.step for parameter in self.parameters])

    @cached_property
    def ends(self) -> np.ndarray:
        """The low and the high ends (2, k)."""
        return np.array([self.bounds[parameter.name] for parameter in self.parameters]).T

    @cached_property
    def prior(self) -> np.ndarray:
        """Inverse variances (k,) of the module's equation."""
        return np.array([inverse_variance(k, self.bounds[k.name]) for k in self.parameters])

    def value(self, at: ParameterFit) -> np.ndarray:
        """The parameters (k,) in a setting."""
        return np.array([at.setting.get(k.name, k.nominal) for k in self.parameters])

    def away(self, value: np.ndarray) -> np.ndarray:
        """How far the parameters that have a prior lie from nominal (k,)."""
        nominal = np.array([parameter.nominal for parameter in self.parameters])
        return np.where(self.prior > 0.0, value - nominal, 0.0)

    def cost(self, at: ParameterFit) -> float:
        """C with the prior."""
        away = self.away(self.value(at))
        return at.cost + float(0.5 * self.prior @ (away * away))

    def moved(self, at: ParameterFit, step: np.ndarray) -> ParameterFit:
        """The fit (k,) further, within the bounds; `at` itself where they leave nothing of it."""
        value = self.value(at)
        there = np.clip(value + step, *self.ends)
        if np.array_equal(there, value):
            return at
        setting = dict(zip((k.name for k in self.parameters), there.tolist(), strict=True))
        changed = [
            k for k, old, new in zip(self.parameters, value, there, strict=True) if old != new
        ]
        felt = [output for output in at.rolls if any(output in k.outputs for k in changed)]
        tried = evaluate(self.evidence, self.nominal, at.setting | setting, felt)
        rolls, costs = at.rolls | tried.rolls, at.costs | tried.costs
        return ParameterFit(tried.setting, rolls, costs, at.columns)

    def equations(
        self, at: ParameterFit, columns: Mapping[str, np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """`normal_equations` with the prior."""
        a, b = normal_equations(self.evidence, at, columns)
        a[np.diag_indices_from(a)] += self.prior
        return a, b + self.prior * self.away(self.value(at))


def fit(
    evidence: Evidence,
    nominal: NominalModel,
    start: ParameterFit,
    bounds: Bounds,
    *,
    iterations: int = ITERATIONS,
    needed: float = np.inf,
) -> ParameterFit:
    """Fit the parameters of `bounds` (name -> (low, high)) from `start` by bounded Gauss-Newton
    until C with the prior falls by less than CONVERGED_GAIN; all other parameters stay as in
    `start`. A fit that has no chance of the cost `needed` is given up (GIVEN_UP).

    Secants are kept from step to step, those of `start` too, until C has fallen by
    STALE_SECANT_GAIN and falls by ASTRAY more or less than they promise, or not at all. Where new
    ones promise more than ten times what a step gains, they are taken over a smaller width. Where
    no step lowers C, it is searched along the principal axes, as long as that gains
    STALE_SECANT_GAIN. `KeyError`: no such parameter.
    """
    problem = _Problem(evidence, nominal, [nominal.parameters[name] for name in bounds], bounds)
    best = _inside(evidence, nominal, start, bounds)
    taken_at, width, done, searched = start.cost, 1.0, 0, False
    begun, most = best.cost, 0.0
    while done < iterations:
        columns = differences(evidence, nominal, best, problem.parameters, bounds, width)
        kept = kept_columns(columns, problem.parameters)
        best = replace(best, columns={**best.columns, **kept})
        a, b = problem.equations(best, columns)
        stale = taken_at - best.cost >= STALE_SECANT_GAIN
        best, gain, promised = _along_step(problem, best, a, b)
        if gain < CONVERGED_GAIN and not searched:
            best, gain = _along_axes(problem, best, a)
            searched, most = gain < STALE_SECANT_GAIN, max(most, gain)
            if best.cost - needed > max(begun - best.cost, GIVEN_UP * most):
                break
        wide = promised > STALE_SECANT_GAIN and gain < POOR_SHARE * promised
        narrow = wide and not stale and width > NARROWEST
        width *= NARROWER if narrow else 1.0
        done += not narrow
        astray = max(gain, promised) > STALE_SECANT_GAIN and abs(gain - promised) > (
            ASTRAY * promised
        )
        if narrow or (stale and (astray or gain < CONVERGED_GAIN)):
            best, taken_at = replace(best, columns={}), best.cost
        elif gain < CONVERGED_GAIN:
            break
    return best


def _along_step(
    problem: _Problem, at: ParameterFit, a: np.ndarray, b: np.ndarray
) -> tuple[ParameterFit, float, float]:
    """The first of the shortened Gauss-Newton steps that lowers C with the prior (`at`: none does),
    by how much, and how much was promised.

    Where the step of all parameters does not, that of those inside their bounds is tried: C may
    jump as a play leaves 0.
    """
    cost, promised = problem.cost(at), 0.0
    low, high = problem.ends - problem.value(at)
    inside = (low < 0.0) & (high > 0.0)
    for free in (np.ones_like(inside), inside):
        step, own = np.zeros(len(b)), np.ix_(free, free)
        step[free] = bounded_step(a[own], b[free], low[free], high[free], problem.scale[free])
        promised = max(promised, -float(0.5 * step @ a @ step + b @ step))
        for share in STEP_LENGTHS:
            tried = problem.moved(at, share * step)
            if (gain := cost - problem.cost(tried)) >= CONVERGED_GAIN:
                return tried, gain, -float(share * (0.5 * share * step @ a @ step + b @ step))
        if inside.all() or not inside.any():
            break
    return at, 0.0, promised


def _along_axes(problem: _Problem, at: ParameterFit, a: np.ndarray) -> tuple[ParameterFit, float]:
    """Compass search along `_axes`, and by how much C with the prior fell (Kolda, Lewis and
    Torczon, SIAM Review 45, 2003).

    A kink of backlash or friction stops a Gauss-Newton step that crosses it, not one along it.
    """
    first = problem.cost(at)
    for axis in _axes(problem, at, a):
        at = _along_axis(problem, at, a, axis)
    return at, first - problem.cost(at)


def _along_axis(
    problem: _Problem, at: ParameterFit, a: np.ndarray, axis: np.ndarray
) -> ParameterFit:
    """The lowest place met along an axis (k,): a step of AXIS_LENGTHS times it, either way, is
    repeated as long as C falls. Where C rises both ways as `a` promises, within ASTRAY, the shorter
    steps have nothing to find."""
    cost, here = problem.cost(at), problem.value(at)
    for length in AXIS_LENGTHS:
        told = True
        for step in (length * axis, -length * axis):
            tried = problem.moved(at, step)
            away = problem.value(tried) - here
            rise, promised = problem.cost(tried) - cost, 0.5 * away @ a @ away
            told = told and abs(rise - promised) <= ASTRAY * promised
            while (dear := problem.cost(tried)) < cost - CONVERGED_GAIN:
                at, cost, here = tried, dear, problem.value(tried)
                tried = problem.moved(at, step)
            if rise < -CONVERGED_GAIN:
                break  # the other way is back
        if told:
            break
    return at


def _axes(problem: _Problem, at: ParameterFit, a: np.ndarray) -> np.ndarray:
    """Directions (k, k), one a row, each as long as a standard deviation 1/sqrt(eigenvalue): the
    principal axes of `a` (k, k), J'WJ with the prior, over the parameters that lie inside their
    bounds, the weakest first, then each other parameter alone (a play of 0 is a model of its own:
    C may jump as it leaves 0). Parameters of different outputs share no axis."""
    h = a * np.outer(problem.scale, problem.scale)
    h[np.diag_indices_from(h)] += RIDGE
    low, high = problem.ends - problem.value(at)
    inside = (low < 0.0) & (high > 0.0)
    axes = np.diag(1.0 / np.sqrt(np.diag(h)))
    weakness = np.where(inside, np.diag(h), np.inf)
    for block in _blocks(h, inside):
        sizes, found = np.linalg.eigh(h[np.ix_(block, block)])
        axes[np.ix_(block, block)] = (found / np.sqrt(sizes)).T
        weakness[block] = sizes
    return axes[np.argsort(weakness, kind="stable")] * problem.scale


def _blocks(h: np.ndarray, inside: np.ndarray) -> list[np.ndarray]:
    """Numbers of the parameters `inside` (k,) that are coupled by `h` (k, k), a group a block."""
    among = np.flatnonzero(inside)
    count, label = connected_components(h[np.ix_(among, among)] != 0.0, directed=False)
    return [among[label == i] for i in range(count)]


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
