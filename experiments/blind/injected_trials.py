"""Blind trials on recorded logs: an effect is injected into them, and has to be named.

The logs as they came are one of the trials: what is named in them already is no wrong name when an
effect is injected on top.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from experiments.blind import sizes
from experiments.blind.inject import WITHOUT_VOLTS, axes_with, inject, possible
from experiments.blind.score_summary import share
from experiments.blind.trial import BlindTrial, rig_data
from experiments.blind.trial_score import TrialScore, comparable
from experiments.records.importing import read_log
from experiments.runs.assemble import load_rig
from rig.effects import BY_NAME
from rig.log import Log

CLEAN, HIDDEN = "as it came", "onto"


@cache
def _log(path: str) -> Log:
    return read_log(Path(path))


def draw_injected_trials(
    paths: Sequence[Path], *, seed: int, each: int, rig_file: Path | None = None
) -> list[BlindTrial]:
    """One trial of the logs as they came and up to `each` of every effect that all logs can hide,
    drawn from `seed`.

    paths: recorded logs of one table; rig_file: its nominal rig. Draws whose effect the logs cannot
    hide are left out after 20 tries. ValueError, FileNotFoundError: a log or the rig file cannot be
    read, or nothing can be hidden because the logs have no channel in common.
    """
    logs = [_log(str(path)) for path in paths]
    names = sorted(set.intersection(*(set(possible(log)) for log in logs)))
    if not names:
        raise ValueError("nothing can be hidden in these logs: they have no channel in common")
    told = rig_data(load_rig(rig_file)) if rig_file else {}
    files = tuple(str(path) for path in paths)
    blank = BlindTrial("onto-0000", CLEAN, "", files, (0,) * len(files), {}, told, engine="onto")
    trials = [blank]
    for number, name in enumerate(name for name in names for _ in range(each)):
        rng = np.random.default_rng([seed, 2, number])
        drawn = _draw(logs, name, rng)
        if drawn is not None:
            by_axis, times = drawn
            trials.append(
                replace(
                    blank,
                    name=f"onto-{number + 1:04d}",
                    kind=HIDDEN,
                    variant=name,
                    hidden={name: by_axis},
                    factor=times,
                )
            )
    order = np.random.default_rng([seed, 3]).permutation(len(trials))
    return [replace(trials[i], name=f"onto-{k:04d}") for k, i in enumerate(order)]


def _draw(logs: Sequence[Log], name: str, rng: np.random.Generator):
    """Values and factor that all logs can take, on axes that they have; None after 20 tries."""
    per_axis = BY_NAME[name].axes == ("x", "y")
    axes = set.intersection(*(set(axes_with(log, name)) for log in logs)) if per_axis else set()
    for _ in range(20):
        by_axis, times = sizes.draw_effect(name, rng)
        if per_axis:
            axis = sorted(axes)[rng.integers(len(axes))]
            by_axis = {axis: next(iter(by_axis.values()))}
        try:
            for log in logs:
                inject(log, {name: by_axis}, ratio=load_rig(None).linkage.ratio)
        except ValueError:
            continue
        return by_axis, times
    return None


def injected_log(trial: BlindTrial, path: str, seed: int) -> Log:
    """The log at `path` with the trial's effects injected; a `logs.LogMaker` (`seed` is not used).

    ValueError, FileNotFoundError: the log cannot be read, or an effect cannot be hidden in it.
    """
    rig = trial.nominal_rig if trial.believed else load_rig(None)
    return inject(_log(path), trial.hidden, ratio=rig.linkage.ratio, delay_s=rig.camera.delay_s)


@dataclass(frozen=True)
class Line:
    """One effect hidden in recorded logs, and what the answer said of it.

    effect: name; axes: with spaces between; hidden: size on the first axis, SI; found: answered
    size minus the size answered for the logs as they came (NaN: none answered); named: whether the
    effect was named; more: wrong names that the logs as they came did not get; verdict: of the
    answer; volts_left_out: whether the injected log has no volts.
    """

    effect: str
    axes: str
    hidden: float
    found: float
    named: bool
    more: tuple[str, ...]
    verdict: str
    volts_left_out: bool


def injection_report(
    scores: Sequence[TrialScore], answers: dict[str, dict[str, Any]]
) -> dict[str, Any]:
    """How well the effects hidden in recorded logs were named, as JSON types.

    answers: answer (JSON of `rig gap`) by trial name, of the same trials as `scores`, one of which
    is the trial of the logs as they came. Keys: "as it came" (verdict, named), the shares "named"
    and "named and nothing more", "lines" (each a `Line` as dict). StopIteration, KeyError: that
    trial or an answer is missing.
    """
    clean = next(m for m in scores if m.trial.kind == CLEAN)
    base = {e["name"]: e for e in answers[clean.trial.name].get("effects") or []}
    before = base if clean.verdict == "named" else {}
    lines = [_line(m, answers[m.trial.name], before) for m in scores if m.trial.kind == HIDDEN]
    asked = [m for m in scores if m.trial.kind == HIDDEN]
    right = {m.trial.name: line for m, line in zip(asked, lines, strict=True)}
    return {
        "as it came": {"verdict": clean.verdict, "named": list(clean.named)},
        "named": share(asked, lambda m: right[m.trial.name].named),
        "named and nothing more": share(
            asked, lambda m: right[m.trial.name].named and not right[m.trial.name].more
        ),
        "lines": [asdict(line) for line in sorted(lines, key=lambda one: one.effect)],
    }


def _line(m: TrialScore, answer: dict[str, Any], before: dict[str, Any]) -> Line:
    name, by_axis = next(iter(m.trial.hidden.items()))
    axis = next(iter(by_axis))
    key = next(iter(comparable(name, by_axis[axis])))
    found = {e["name"]: e for e in answer.get("effects") or []}
    now, was = (_size(effects.get(name), name, axis, key) for effects in (found, before))
    return Line(
        name,
        " ".join(by_axis),
        comparable(name, by_axis[axis])[key],
        now - (was if was == was else 0.0),
        name in m.found,
        tuple(extra for extra in m.extra if extra not in before),
        m.verdict,
        name in WITHOUT_VOLTS,
    )


def _size(effect: dict[str, Any] | None, name: str, axis: str, key: str) -> float:
    values = ((effect or {}).get("parameters") or {}).get(axis) or {}
    plain = comparable(name, {k: float(v["value"]) for k, v in values.items()})
    return plain.get(key, float("nan")) if values else float("nan")


def injection_markdown(report: dict[str, Any]) -> str:
    """The report of `injection_report` as a Markdown table, one line per hidden effect."""
    clean = report["as it came"]
    named = ", ".join(clean["named"]) or "no name"
    body = [f"As they came: {clean['verdict']} ({named}).", ""]
    body += ["| hidden | axis | size | found | named | named besides | verdict |"]
    body += ["|---|---|---|---|---|---|---|"]
    for line in report["lines"]:
        name = line["effect"] + (" (volts left out)" if line["volts_left_out"] else "")
        stated = f"{line['found']:.3g}" if line["found"] == line["found"] else "-"
        cells = [
            name,
            line["axes"],
            f"{line['hidden']:.3g}",
            stated,
            "yes" if line["named"] else "no",
        ]
        body.append("| " + " | ".join([*cells, ", ".join(line["more"]), line["verdict"]]) + " |")
    return "\n".join(body) + "\n"
