"""Bounded Gauss-Newton with Huber's loss over a few knobs: the one estimator of the workflow.

Minimises C = sum rho(z_i) + sum log s_i over the parts that the knobs feel; z standardised
innovations, s their expected deviations (they change where play hides the motor from the encoder).
C is minus the log-likelihood, so a difference of C is a log-likelihood ratio. Differences are
secants of a step that matters (backlash and friction have no derivative at zero).
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import lsq_linear

from calibration.gap.evidence import Evidence, Roll
from calibration.gap.knobs import Believed, Knob

HUBER = 3.0
ITERATIONS = 6
CLOSE = 0.05  # a gain in C below this ends the fit
FAR = 5.0  # a gain in C beyond which the secants are old
Bounds = Mapping[str, tuple[float, float]]


def loss(roll: Roll, mask: np.ndarray) -> float:
    """C of one part; infinite where a roll-out broke down."""
    if not roll.z.any():
        return float("inf")
    z = np.abs(roll.z)
    rho = np.where(z <= HUBER, 0.5 * z * z, HUBER * (z - 0.5 * HUBER))
    return float(np.sum(mask * (rho + roll.log_std)))


def weights(z: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Huber's weights (n,): 1 within HUBER deviations, less beyond."""
    return mask * np.minimum(1.0, HUBER / np.maximum(np.abs(z), 1e-300))


@dataclass(frozen=True, eq=False)
class Fit:
    """A setting of the knobs, its roll-outs and costs by part.

    columns: secants d z/d knob, (part, knob) -> (n,), as far as they are known near this setting.
    """

    setting: dict[str, float]
    rolls: dict[str, Roll]
    costs: dict[str, float]
    columns: Mapping[tuple[str, str], np.ndarray] = field(default_factory=dict)

    @property
    def cost(self) -> float:
        return sum(self.costs.values())

    def z(self, part: str) -> np.ndarray:
        return self.rolls[part].z


def evaluate(evidence: Evidence, believed: Believed, setting: Mapping[str, float],
             parts: Iterable[str]) -> Fit:  # fmt: skip
    """The cost of a setting as it is."""
    model, parts = believed.model(setting), list(parts)
    rolls = dict(zip(parts, evidence.rolls([(model, part) for part in parts]), strict=True))
    costs = {part: loss(roll, evidence.masks[part]) for part, roll in rolls.items()}
    return Fit(dict(setting), rolls, costs)


def differences(evidence: Evidence, believed: Believed, at: Fit,
                knobs: Sequence[Knob], bounds: Bounds) -> dict[str, np.ndarray]:  # fmt: skip
    """Secants d z/d knob: part -> (n, k). Those that `at` knows are taken from there."""
    columns = {part: np.zeros((len(roll.z), len(knobs))) for part, roll in at.rolls.items()}
    todo = []
    for i, knob in enumerate(knobs):
        for part in knob.parts:
            if part in columns and (part, knob.name) in at.columns:
                columns[part][:, i] = at.columns[part, knob.name]
        parts = [p for p in knob.parts if p in columns and (p, knob.name) not in at.columns]
        if not parts:
            continue
        value = at.setting.get(knob.name, knob.believed)
        low, high = bounds[knob.name]
        step = knob.step if value + knob.step <= high or value - knob.step < low else -knob.step
        model = believed.model(at.setting | {knob.name: value + step})
        todo += [(i, step, model, part) for part in parts]
    rolls = evidence.rolls([(model, part) for _, _, model, part in todo])
    for (i, step, _, part), roll in zip(todo, rolls, strict=True):
        columns[part][:, i] = roll.slope(at.rolls[part], step)
    return columns


def known(columns: Mapping[str, np.ndarray], knobs: Sequence[Knob],
          without: Collection[str]) -> dict[tuple[str, str], np.ndarray]:  # fmt: skip
    """Columns by part and knob, those of the effects `without` left out (they bend too much)."""
    return {
        (part, knob.name): columns[part][:, i]
        for part in columns
        for i, knob in enumerate(knobs)
        if part in knob.parts and knob.effect not in without
    }


def normal_equations(
    evidence: Evidence, at: Fit, columns: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """J'WJ (k, k) and J'Wz (k,) over the parts."""
    k = next(iter(columns.values())).shape[1]
    a, b = np.zeros((k, k)), np.zeros(k)
    for part, j in columns.items():
        w = weights(at.rolls[part].z, evidence.masks[part])
        wj = j * w[:, None]
        a += wj.T @ j
        b += wj.T @ at.rolls[part].z
    return a, b


def bounded_step(a: np.ndarray, b: np.ndarray, low: np.ndarray, high: np.ndarray,
                 scale: np.ndarray) -> np.ndarray:  # fmt: skip
    """argmin d'Ad/2 + b'd within low <= d <= high; `scale` (k,) the knobs' steps, for conditioning.

    A knob that the data do not feel stays where it is (a small ridge in units of its step).
    """
    h = a * np.outer(scale, scale)
    h[np.diag_indices_from(h)] += 1e-3
    upper = np.linalg.cholesky(h).T
    right = np.linalg.solve(upper.T, -b * scale)
    low, high = np.minimum(low / scale, -1e-12), np.maximum(high / scale, 1e-12)
    return lsq_linear(upper, right, (low, high), method="bvls").x * scale


def fit(evidence: Evidence, believed: Believed, start: Fit, bounds: Bounds, *,
        iterations: int = ITERATIONS, bent: Collection[str] = ()) -> Fit:  # fmt: skip
    """Turn the knobs of `bounds` (name -> low, high) from `start` until C stops falling.

    Secants are taken once, those of the effects `bent` (play, delays, periods) at every step; where
    the cost stalls after a way that mattered, all are taken anew.
    """
    knobs = [believed.knobs[name] for name in bounds]
    best = _inside(evidence, believed, start, bounds)
    scale = np.array([knob.step for knob in knobs])
    taken_at = start.cost
    for _ in range(iterations):
        columns = differences(evidence, believed, best, knobs, bounds)
        best = replace(best, columns={**best.columns, **known(columns, knobs, bent)})
        a, b = normal_equations(evidence, best, columns)
        value = np.array([best.setting.get(k.name, k.believed) for k in knobs])
        low, high = (np.array([bounds[k.name][i] for k in knobs]) for i in (0, 1))
        step = bounded_step(a, b, low - value, high - value, scale)
        better = _along(evidence, believed, best, knobs, value, step)
        gain = best.cost - better.cost if better is not None else 0.0
        best = better or best
        if gain < CLOSE:
            if taken_at - best.cost < FAR:
                break
            best, taken_at = replace(best, columns={}), best.cost
    return best


def _inside(evidence: Evidence, believed: Believed, start: Fit, bounds: Bounds) -> Fit:
    """The start with every free knob inside its bounds."""
    moved = {}
    for name, (low, high) in bounds.items():
        value = start.setting.get(name, believed.knobs[name].believed)
        moved[name] = min(max(value, low), high)
    if all(start.setting.get(n, believed.knobs[n].believed) == v for n, v in moved.items()):
        return start
    inside = evaluate(evidence, believed, start.setting | moved, start.rolls)
    return replace(inside, columns=start.columns)


def _along(evidence: Evidence, believed: Believed, at: Fit, knobs: Sequence[Knob],
           value: np.ndarray, step: np.ndarray) -> Fit | None:  # fmt: skip
    """The first of full, third and ninth step that lowers C; None when none does."""
    for part in (1.0, 0.33, 0.1):
        setting = dict(zip((k.name for k in knobs), (value + part * step).tolist(), strict=True))
        tried = evaluate(evidence, believed, at.setting | setting, at.rolls)
        tried = replace(tried, columns=at.columns)
        if tried.cost < at.cost:
            return tried
    return None
