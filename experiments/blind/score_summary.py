"""Many marks as numbers: shares with Wilson's intervals, medians, coverage, calibration, power."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict
from math import nan
from typing import Any

import numpy as np

from experiments.blind.marks import Mark
from experiments.statistics import wilson
from rig.effects import CATALOGUE

GOAL_PROTOCOLS = ("steps", "battery")  # the others are reported beside
EDGES = (0.15, 0.3, 0.6, 1.0, 1.5, 2.5, 4.0, 6.0)  # of amplitude over smallest
Share = dict[str, Any]


def share(marks: Sequence[Mark], test: Callable[[Mark], bool]) -> Share:
    """Share of the marks that pass, with its 95 % interval and the counts."""
    k = sum(bool(test(m)) for m in marks)
    return asdict(wilson(k, len(marks))) | {"k": k}


def summary(marks: Sequence[Mark]) -> dict[str, Any]:
    """Every number of the table, of marks of one engine.

    The goals are for the protocols of `GOAL_PROTOCOLS`, where there are any such trials.
    """
    single = [m for m in marks if m.trial.kind == "single"]
    goals = [m for m in single if m.trial.battery in GOAL_PROTOCOLS] or single
    every, marks = marks, [m for m in marks if m.trial.kind != "single"] + goals
    by_kind = {k: [m for m in marks if m.trial.kind == k] for k in _kinds(marks)}
    hidden = [m for m in marks if m.trial.kind in ("single", "pair", "shape")]
    return {
        "trials": len(every),
        "kinds": {kind: _of_kind(group) for kind, group in by_kind.items()},
        "protocols": _by(single, lambda m: m.trial.battery),
        "effects": _by(by_kind.get("single", []), lambda m: next(iter(m.trial.hidden))),
        "strangers": _by(by_kind.get("stranger", []), lambda m: m.trial.variant),
        "camera": _by(by_kind.get("camera", []), lambda m: m.trial.variant),
        "realistic": _by(by_kind.get("realistic", []), lambda m: m.trial.variant),
        "nothing": _nothing(by_kind.get("nothing", [])),
        "axes": share([m for m in hidden if m.right], lambda m: m.axes_right),
        "confident wrong": share(marks, lambda m: m.confident_wrong),
        "confusion": confusion(by_kind.get("single", [])),
        "sizes": _sizes([m for m in hidden if m.right]),
        "proof": _proof([m for m in hidden if m.right]),
        "calibration": calibration([pair for m in marks for pair in m.said]),
        "power": power([m for m in every if m.trial.kind in ("single", "weak")]),
        "seconds": _quantiles([m.seconds for m in every]),
    }


def _kinds(marks: Sequence[Mark]) -> list[str]:
    return sorted({m.trial.kind for m in marks})


def _of_kind(marks: Sequence[Mark]) -> dict[str, Any]:
    """What became of the trials of one kind."""
    return {
        "right": share(marks, lambda m: m.right),
        "detected": share(marks, lambda m: m.verdict in ("named", "unknown-effect", "undecided")),
        "wrong name": share(marks, lambda m: bool(m.extra)),
        "undecided": share(marks, lambda m: m.verdict == "undecided"),
        "undecided, truth among them": share(marks, lambda m: m.verdict == "undecided" and m.among),
        "unknown": share(marks, lambda m: m.verdict == "unknown-effect"),
        "failed": share(marks, lambda m: m.verdict == "failed"),
        "right of named": share([m for m in marks if m.verdict == "named"], lambda m: m.right),
        "hidden found": _found(marks),
        "verdicts": dict(Counter(m.verdict for m in marks)),
    }


def _found(marks: Sequence[Mark]) -> Share:
    """Share of all hidden effects that were named (trials may hide several)."""
    total = sum(len(m.trial.hidden) for m in marks)
    k = sum(len(m.found) for m in marks)
    return asdict(wilson(k, total)) | {"k": k}


def _by(marks: Sequence[Mark], key: Callable[[Mark], str]) -> dict[str, Any]:
    groups: dict[str, list[Mark]] = {}
    for m in marks:
        groups.setdefault(key(m), []).append(m)
    return {name: _of_kind(group) for name, group in sorted(groups.items())}


def _nothing(marks: Sequence[Mark]) -> dict[str, Any]:
    """False alarms by variant of the noise, and over all."""
    groups: dict[str, list[Mark]] = {"all": list(marks)} if marks else {}
    for variant in sorted({m.trial.variant for m in marks}, key=lambda v: (v != "plain", v)):
        groups[variant] = [m for m in marks if m.trial.variant == variant]
    return {
        variant: {
            "named": share(group, lambda m: bool(m.named)),
            "unknown": share(group, lambda m: m.verdict == "unknown-effect"),
            "undecided": share(group, lambda m: m.verdict == "undecided"),
            "names": dict(Counter(name for m in group for name in m.named)),
        }
        for variant, group in groups.items()
    }


def confusion(marks: Sequence[Mark]) -> dict[str, dict[str, int]]:
    """Hidden effect -> what was answered -> count, of trials with one hidden effect.

    A right answer stands under the hidden name; several names under "several".
    """
    table: dict[str, dict[str, int]] = {}
    for m in marks:
        hidden = next(iter(m.trial.hidden))
        if m.right:
            said = hidden
        elif m.verdict == "named":
            said = m.named[0] if len(m.named) == 1 else "several"
        else:
            said = m.verdict
        row = table.setdefault(hidden, {})
        row[said] = row.get(said, 0) + 1
    order = [effect.name for effect in CATALOGUE]
    return {name: table[name] for name in order if name in table}


def _sizes(marks: Sequence[Mark]) -> dict[str, Any]:
    """Parameters of what was named rightly."""
    covered = [c for m in marks for c in m.covered]
    errors = [e for m in marks for e in m.errors]
    by_effect: dict[str, list[float]] = {}
    for m in marks:
        for name in m.found if len(m.trial.hidden) == 1 else ():
            by_effect.setdefault(name, []).extend(m.errors)
    return {
        "error": _quantiles(errors),
        "shape error": _quantiles([e for m in marks for e in m.shape_errors]),
        "covered": asdict(wilson(sum(covered), len(covered))) | {"k": sum(covered)},
        "by effect": {name: _quantiles(values) for name, values in sorted(by_effect.items())},
    }


def _proof(marks: Sequence[Mark]) -> dict[str, Any]:
    return {
        "closed": _quantiles([m.closed for m in marks]),
        "ahead": _quantiles([m.ahead for m in marks]),
    }


def _quantiles(values: Sequence[float]) -> dict[str, float]:
    """Tenth, median, ninetieth of a hundred, and the count; NaN values are left out."""
    found = np.array([v for v in values if np.isfinite(v)])
    if len(found) == 0:
        return {"p10": nan, "median": nan, "p90": nan, "n": 0}
    p10, median, p90 = np.quantile(found, [0.1, 0.5, 0.9])
    return {"p10": float(p10), "median": float(median), "p90": float(p90), "n": len(found)}


def calibration(said: Sequence[tuple[float, bool]], bins: int = 10) -> dict[str, Any]:
    """Expected calibration error of the probabilities, and its bins (mean p, share right, n)."""
    pairs = np.array([(p, right) for p, right in said if np.isfinite(p)], float).reshape(-1, 2)
    which = np.minimum((pairs[:, 0] * bins).astype(int), bins - 1)
    rows, error = [], 0.0
    for b in np.unique(which):
        p, right = pairs[which == b].mean(axis=0)
        n = int((which == b).sum())
        rows.append({"probability": float(p), "right": float(right), "n": n})
        error += n / len(pairs) * abs(p - right)
    return {"error": float(error) if rows else nan, "bins": rows, "n": len(pairs)}


def power(marks: Sequence[Mark]) -> list[dict[str, Any]]:
    """By effect, protocol and amplitude over the smallest: detected, right, wrongly named."""
    cells: dict[tuple[str, str, int], list[Mark]] = {}
    for m in marks:
        b = int(np.clip(np.searchsorted(EDGES, m.trial.factor, "right") - 1, 0, len(EDGES) - 2))
        cells.setdefault((next(iter(m.trial.hidden)), m.trial.battery, b), []).append(m)
    return [
        {
            "effect": effect,
            "protocol": protocol,
            "from": EDGES[b],
            "to": EDGES[b + 1],
            "detected": share(group, lambda m: m.verdict != "nothing-missing"),
            "right": share(group, lambda m: m.right),
            "wrong name": share(group, lambda m: bool(m.extra)),
        }
        for (effect, protocol, b), group in sorted(cells.items())
    ]
