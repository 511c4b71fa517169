"""Open the seal and hold the answers of one entry against the truth."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from math import nan
from pathlib import Path
from typing import Any

import numpy as np

from experiments.analysis.statistics import wilson
from experiments.benchmark.answers import NO_ANSWER, read_answers
from experiments.benchmark.design import ENGINES, KINDS, engine_of, kind_of
from experiments.blind.analysis_jobs import FAILED
from experiments.blind.score_summary import calibration, quantiles, share
from experiments.blind.seal import SEAL, open_seal, sealed_hash
from experiments.blind.trial import BlindTrial
from experiments.blind.trial_score import TrialScore, score_trial
from rig.effects import BY_NAME

TABLES = {"own": "own simulator", "foreign": "independent plant", "mujoco": "MuJoCo"}
TABLES |= {"positions": "tables that take an angle"}


def score_set(folder: Path, out: Path, *, first: int | None = None) -> dict[str, Any]:
    """The numbers of the answers in `out` to the set in `folder`, see `summary`.

    first: score so many cases alone, in the set's order; a case without an answer counts as not
    answered. ValueError (one line): the truth does not fit the set's hash, or an answer is
    malformed or to another set. FileNotFoundError: no set, no truth, or no answers.
    """
    trials = truth_of(folder)
    answers, seconds = read_answers(folder, out, [trial.name for trial in trials])
    return summary(scores_of(trials[:first], answers, seconds))


def truth_of(folder: Path) -> list[BlindTrial]:
    """The set's truth, by case. ValueError: it does not fit the hash, or hides what the catalogue
    does not have. FileNotFoundError: none.
    """
    digest = sealed_hash(folder)
    if digest is None:
        raise FileNotFoundError(f"{folder / SEAL}: no such file; is {folder} a benchmark?")
    try:
        trials = open_seal(folder, digest)
    except FileNotFoundError:
        raise FileNotFoundError(
            f"{folder}: the sealed truth is not there, nothing to score with"
        ) from None
    for trial in trials:
        for name, by_axis in trial.hidden.items():
            if name not in BY_NAME or not all(
                v for keys in by_axis.values() for v in keys.values()
            ):
                raise ValueError(
                    f"{folder}: '{name}' hidden in {trial.name} is no effect of a size"
                )
    return trials


def scores_of(
    trials: Sequence[BlindTrial],
    answers: Mapping[str, Mapping[str, Any]],
    seconds: Mapping[str, float],
) -> list[TrialScore]:
    """The score of every trial; answers, seconds: by the trial's name, which may be missing."""
    return [
        score_trial(t, answers.get(t.name, NO_ANSWER), seconds.get(t.name, nan)) for t in trials
    ]


def summary(scores: Sequence[TrialScore]) -> dict[str, Any]:
    """Every number of the table, as JSON types: "all", "kinds" and "engines" (see `_group`),
    calibration, Brier score, sizes, coverage, seconds.
    """
    stated = [pair for m in scores for pair in m.stated if np.isfinite(pair[0])]
    by_kind = {kind: [m for m in scores if kind_of(m.trial) == kind] for kind in KINDS}
    by_engine = {name: [m for m in scores if engine_of(m.trial) == name] for name in ENGINES}
    covered = [held for m in scores for held in m.covered]
    return {
        "all": _group(scores),
        "kinds": {kind: _group(group) for kind, group in by_kind.items() if group},
        "engines": {TABLES[name]: _group(group) for name, group in by_engine.items() if group},
        "calibration": calibration(stated),
        "brier": float(np.mean([(p - right) ** 2 for p, right in stated])) if stated else nan,
        "sizes": quantiles([e for m in scores for e in m.errors]),
        "covered": asdict(wilson(sum(covered), len(covered))) | {"k": sum(covered)},
        "seconds": quantiles([m.seconds for m in scores]),
    }


def _group(scores: Sequence[TrialScore]) -> dict[str, Any]:
    """Shares of a group of logs: right, wrong and sure, and what was said."""
    said = {"named": "named", "unknown": "unknown-effect", "undecided": "undecided"}
    said |= {"nothing": "nothing-missing", "no answer": FAILED}
    return {
        "right": share(scores, lambda m: m.right),
        "wrong and sure": share(scores, lambda m: m.confident_wrong),
        **{
            word: share(scores, lambda m, verdict=verdict: m.verdict == verdict)
            for word, verdict in said.items()
        },
    }
