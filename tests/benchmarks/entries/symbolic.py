"""Symbolic regression of the discrepancy: gplearn's genetic programming finds a formula.

As its authors describe it: a population of formulas in the states, bred by tournaments on the mean
absolute error with a price on length (Koza 1992; gplearn). It learns on the first half of the log;
a formula that explains less than 10 % of the second half's variance is none. A formula is named
after the catalogue's term with which it correlates by more than 0.9, otherwise it is an effect
without a name. The method states no probabilities: they are null, and it is never sure.
"""

import warnings
from pathlib import Path

import numpy as np
from gplearn.functions import make_function
from gplearn.genetic import SymbolicRegressor

from tests.benchmarks.entries.signals import Equation, answer, counts, effect, read_case
from tests.benchmarks.entries.terms import equations

EXPLAINED, ALIKE = 0.10, 0.9
SIGN = make_function(function=lambda x: np.tanh(10 * x), name="sgn", arity=1)
SETTINGS = {
    "population_size": 300,
    "generations": 8,
    "function_set": ("add", "sub", "mul", "abs", SIGN),
    "const_range": (-2.0, 2.0),
    "parsimony_coefficient": 0.003,
    "random_state": 0,
    "n_jobs": 1,
}


def discrepancy(part: Equation) -> np.ndarray:
    """What is left of e without what a calibration leaves and a constant-free scale, unit size."""
    free = np.column_stack([part.free, np.zeros(len(part.e))])
    e = part.e - free @ np.linalg.lstsq(free, part.e, rcond=None)[0]
    return e / e.std()


def formula(part: Equation) -> tuple[np.ndarray, str] | None:
    """Values (n,) and text of the formula that holds on the second half, or None."""
    e = discrepancy(part)
    X = np.column_stack([s / max(s.std(), 1e-12) for s in part.states.values()])
    half = len(e) // 2
    model = SymbolicRegressor(**SETTINGS, feature_names=list(part.states))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of formulas that overflow on the way
        model.fit(X[:half], e[:half])
    found = model.predict(X)
    left, whole = np.mean((e - found)[half:] ** 2), np.mean(e[half:] ** 2)
    return (found, str(model._program)) if left < (1 - EXPLAINED) * whole else None


def likeness(a: np.ndarray, b: np.ndarray) -> float:
    """|a b|/(|a| |b|), for a formula's constant counts, too."""
    return abs(a @ b) / max(np.linalg.norm(a) * np.linalg.norm(b), 1e-12)


def answer_of(folder: Path) -> dict:
    effects: dict[str, dict] = {}
    unknown = None
    for part in equations(read_case(folder)):
        found = formula(part)
        if found is None:
            continue
        key = max(part.columns, key=lambda k: likeness(part.columns[k], found[0]))
        column = part.columns[key]
        if likeness(column, found[0]) < ALIKE:
            unknown = {"channel": part.channel, "shape": found[1]}
            continue
        size = float(column @ part.e / (column @ column))
        sd = float(np.std(part.e - size * column) / np.linalg.norm(column))
        if counts(key[0], size):
            one = effect(key[0], None, {(key[1], key[2]): (size, sd)})
            effects.setdefault(key[0], one)["parameters"] |= one["parameters"]
    if effects:
        return answer("named", [*effects.values()], unknown)
    return answer("unknown-effect", unknown=unknown) if unknown else answer("nothing-missing")
