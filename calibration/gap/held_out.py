"""Predictions of data that were not fitted, and what a name gains on them.

The logs are split in two (`calibration.gap.prove.split`); a model is fitted on each part in turn
and predicts the other 1 s ahead from the inputs alone, and one sample ahead. With e_k the errors
1 s ahead of an output, in the same windows for two models,

    D = mean_k (e_k^2 without - e_k^2 with),   se = std_b(...)/sqrt(B)

with B blocks of the windows that overlap, b the means in each.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from math import inf

import numpy as np

from calibration.gap.decision_rule import MIN_WINDOWS, OUTLIER_SHARE
from calibration.gap.model.cost import losses
from calibration.gap.model.data import Evidence
from calibration.gap.model.parameters import Model
from calibration.gap.model.state import State
from calibration.gap.prove import ahead, model_of, on, split

OVERLAPPING = 4  # errors of the ball in a second: two windows of two axes
COST_BLOCK_S = 1.0  # longer than innovations are correlated; chosen


@dataclass(frozen=True, eq=False)
class Prediction:
    """Errors 1 s ahead (k,) of an output on data that were not fitted [m or rad], and the cost one
    sample ahead by blocks of COST_BLOCK_S (B,). `rms`: the typical error."""

    errors: np.ndarray
    costs: np.ndarray

    @property
    def cost(self) -> float:
        """The cost C one sample ahead, without unit."""
        return float(self.costs.sum())

    @property
    def rms(self) -> float:
        """RMS error 1 s ahead [m or rad]; infinite where no log lasts long enough for one."""
        return float(np.sqrt(np.mean(self.errors**2))) if self.errors.size else inf


def held_out(state: State, outputs: Iterable[str]) -> dict[str, Prediction]:
    """The predictions of a state's model by output, each part of the logs predicted by the fit on
    the other; outputs that one part lacks are left out."""
    first, other = split(state.evidence)
    outputs = [o for o in outputs if all(half.masks[o].any() for half in (first, other))]

    def judged(pair: tuple[Evidence, Evidence]) -> list[Prediction]:
        train, test = pair
        model, test = model_of(on(state, train, outputs)), test.of(outputs)
        return [Prediction(ahead(test, model, o), _costs(test, model, o)) for o in outputs]

    both = state.evidence.each(judged, ((first, other), (other, first)))
    return {
        output: Prediction(
            np.concatenate([part.errors for part in parts]),
            np.concatenate([part.costs for part in parts]),
        )
        for output, parts in zip(outputs, zip(*both, strict=True), strict=True)
    }


def _costs(evidence: Evidence, model: Model, output: str) -> np.ndarray:
    """The cost by blocks of COST_BLOCK_S (B,) in which the output has weight."""
    (t, run), mask = evidence.times(output), evidence.masks[output]
    used = mask > 0
    places = np.column_stack([run, t // COST_BLOCK_S])[used]
    block = np.unique(places, axis=0, return_inverse=True)[1].ravel()
    return np.bincount(block, losses(evidence.roll(model, output), mask)[used])


def gained(without: Prediction, with_it: Prediction, ratio: float = 1.0) -> tuple[float, float]:
    """D and its standard error of the module's equation [m2 or rad2], errors bounded at `ratio`
    times the quantile; (0, 0) with fewer than MIN_WINDOWS windows."""
    if len(without.errors) < MIN_WINDOWS or len(without.errors) != len(with_it.errors):
        return 0.0, 0.0
    most = ratio**2 * np.quantile(without.errors**2, OUTLIER_SHARE)
    d = np.minimum(without.errors**2, most) - np.minimum(with_it.errors**2, most)
    blocks = np.array([b.mean() for b in np.array_split(d, len(d) // OVERLAPPING)])
    return float(d.mean()), float(blocks.std() / np.sqrt(len(blocks)))
