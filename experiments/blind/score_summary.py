"""Many trial scores as numbers: shares with Wilson intervals, medians, coverage, power."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict
from math import nan
from typing import Any

import numpy as np

from experiments.analysis.statistics import wilson
from experiments.blind.trial_score import TrialScore
from rig.effects import CATALOGUE

GOAL_PROTOCOLS = ("steps", "battery")  # the others are reported beside
EDGES = (0.15, 0.3, 0.6, 1.0, 1.5, 2.5, 4.0, 6.0)  # of amplitude over smallest
Share = dict[str, Any]


def share(scores: Sequence[TrialScore], test: Callable[[TrialScore], bool]) -> Share:
    """The share of scores that pass `test`, with Wilson's 95 % interval (1927).

    Keys: value, low, high (0 to 1; value is NaN without scores), n (all) and k (those that pass).
    """
    k = sum(bool(test(m)) for m in scores)
    return asdict(wilson(k, len(scores))) | {"k": k}


def summary(scores: Sequence[TrialScore]) -> dict[str, Any]:
    """Every number of the results table, from the scores of trials on one engine, as JSON types.

    Keys: trials (count), kinds, protocols, effects, strangers, camera, realistic (shares by group),
    nothing (false alarms by noise), axes, confident wrong (shares), confusion, sizes, proof,
    calibration, power, seconds (quantiles). Trials with one hidden effect count for the goals if
    they were recorded with a protocol of `GOAL_PROTOCOLS`; where no trial was, all of them count.
    """
    single = [m for m in scores if m.trial.kind == "single"]
    goals = [m for m in single if m.trial.battery in GOAL_PROTOCOLS] or single
    every, scores = scores, [m for m in scores if m.trial.kind != "single"] + goals
    by_kind = {k: [m for m in scores if m.trial.kind == k] for k in _kinds(scores)}
    hidden = [m for m in scores if m.trial.kind in ("single", "pair", "shape")]
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
        "confident wrong": share(scores, lambda m: m.confident_wrong),
        "confusion": confusion(by_kind.get("single", [])),
        "sizes": _sizes([m for m in hidden if m.right]),
        "proof": _proof([m for m in hidden if m.right]),
        "calibration": calibration([pair for m in scores for pair in m.stated]),
        "power": power([m for m in every if m.trial.kind in ("single", "weak")]),
        "seconds": quantiles([m.seconds for m in every]),
    }


def _kinds(scores: Sequence[TrialScore]) -> list[str]:
    return sorted({m.trial.kind for m in scores})


def _of_kind(scores: Sequence[TrialScore]) -> dict[str, Any]:
    """What became of the trials of one kind."""
    return {
        "right": share(scores, lambda m: m.right),
        "detected": share(scores, lambda m: m.verdict in ("named", "unknown-effect", "undecided")),
        "wrong name": share(scores, lambda m: bool(m.extra)),
        "undecided": share(scores, lambda m: m.verdict == "undecided"),
        "undecided, truth among them": share(
            scores, lambda m: m.verdict == "undecided" and m.truth_among
        ),
        "unknown": share(scores, lambda m: m.verdict == "unknown-effect"),
        "failed": share(scores, lambda m: m.verdict == "failed"),
        "right of named": share([m for m in scores if m.verdict == "named"], lambda m: m.right),
        "hidden found": _found(scores),
        "verdicts": dict(Counter(m.verdict for m in scores)),
    }


def _found(scores: Sequence[TrialScore]) -> Share:
    """Share of all hidden effects that were named (trials may hide several)."""
    total = sum(len(m.trial.hidden) for m in scores)
    k = sum(len(m.found) for m in scores)
    return asdict(wilson(k, total)) | {"k": k}


def _by(scores: Sequence[TrialScore], key: Callable[[TrialScore], str]) -> dict[str, Any]:
    groups: dict[str, list[TrialScore]] = {}
    for m in scores:
        groups.setdefault(key(m), []).append(m)
    return {name: _of_kind(group) for name, group in sorted(groups.items())}


def _nothing(scores: Sequence[TrialScore]) -> dict[str, Any]:
    """False alarms by variant of the noise, and over all."""
    groups: dict[str, list[TrialScore]] = {"all": list(scores)} if scores else {}
    for variant in sorted({m.trial.variant for m in scores}, key=lambda v: (v != "plain", v)):
        groups[variant] = [m for m in scores if m.trial.variant == variant]
    return {
        variant: {
            "named": share(group, lambda m: bool(m.named)),
            "unknown": share(group, lambda m: m.verdict == "unknown-effect"),
            "undecided": share(group, lambda m: m.verdict == "undecided"),
            "names": dict(Counter(name for m in group for name in m.named)),
        }
        for variant, group in groups.items()
    }


def confusion(scores: Sequence[TrialScore]) -> dict[str, dict[str, int]]:
    """The confusion matrix as {hidden effect: {answer: count}}, of trials with one hidden effect.

    A right answer counts under the hidden effect's name, a wrong name under that name, more than
    one name under "several", and any other answer under its verdict.
    """
    table: dict[str, dict[str, int]] = {}
    for m in scores:
        hidden = next(iter(m.trial.hidden))
        if m.right:
            stated = hidden
        elif m.verdict == "named":
            stated = m.named[0] if len(m.named) == 1 else "several"
        else:
            stated = m.verdict
        row = table.setdefault(hidden, {})
        row[stated] = row.get(stated, 0) + 1
    order = [effect.name for effect in CATALOGUE]
    return {name: table[name] for name in order if name in table}


def _sizes(scores: Sequence[TrialScore]) -> dict[str, Any]:
    """Parameters of what was named rightly."""
    covered = [c for m in scores for c in m.covered]
    errors = [e for m in scores for e in m.errors]
    by_effect: dict[str, list[float]] = {}
    for m in scores:
        for name in m.found if len(m.trial.hidden) == 1 else ():
            by_effect.setdefault(name, []).extend(m.errors)
    return {
        "error": quantiles(errors),
        "shape error": quantiles([e for m in scores for e in m.shape_errors]),
        "covered": asdict(wilson(sum(covered), len(covered))) | {"k": sum(covered)},
        "by effect": {name: quantiles(values) for name, values in sorted(by_effect.items())},
    }


def _proof(scores: Sequence[TrialScore]) -> dict[str, Any]:
    return {
        "closed": quantiles([m.closed for m in scores]),
        "ahead": quantiles([m.ahead for m in scores]),
    }


def quantiles(values: Sequence[float]) -> dict[str, float]:
    """Tenth, median, ninetieth of a hundred, and the count; NaN values are left out."""
    found = np.array([v for v in values if np.isfinite(v)])
    if len(found) == 0:
        return {"p10": nan, "median": nan, "p90": nan, "n": 0}
    p10, median, p90 = np.quantile(found, [0.1, 0.5, 0.9])
    return {"p10": float(p10), "median": float(median), "p90": float(p90), "n": len(found)}


def calibration(stated: Sequence[tuple[float, bool]], bins: int = 10) -> dict[str, Any]:
    """Expected calibration error of the stated probabilities (Naeini et al., 2015), and its bins.

    ECE = sum over bins of n_b/n |mean probability - share right|, with `bins` bins of equal width.
    stated: (probability, name is right) pairs, of which those without a finite probability are left
    out. Keys: error (NaN without pairs), bins (probability, right and n of each bin that is not
    empty), n.
    """
    pairs = np.array([(p, right) for p, right in stated if np.isfinite(p)], float).reshape(-1, 2)
    which = np.minimum((pairs[:, 0] * bins).astype(int), bins - 1)
    rows, error = [], 0.0
    for b in np.unique(which):
        p, right = pairs[which == b].mean(axis=0)
        n = int((which == b).sum())
        rows.append({"probability": float(p), "right": float(right), "n": n})
        error += n / len(pairs) * abs(p - right)
    return {"error": float(error) if rows else nan, "bins": rows, "n": len(pairs)}


def power(scores: Sequence[TrialScore]) -> list[dict[str, Any]]:
    """The power curve: a row for each effect, protocol and bin of the amplitude that has trials.

    Keys of a row: effect, protocol, from and to (edges of the factor over the smallest amplitude,
    see `EDGES`), and the shares detected (any verdict but "nothing-missing"), right and wrong name.
    """
    cells: dict[tuple[str, str, int], list[TrialScore]] = {}
    for m in scores:
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
