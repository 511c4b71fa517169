"""Blind trials on logs that were really recorded: hide an effect in them, ask, compare.

The logs as they came are one of the trials: what they are said to lack already does not count as a
mistake when something is hidden on top.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from experiments.assemble import load_rig
from experiments.blind import sizes
from experiments.blind.inject import WITHOUT_VOLTS, axes_with, inject, possible
from experiments.blind.marks import Mark, comparable
from experiments.blind.score import share
from experiments.blind.trial import Trial, rig_data
from experiments.importing import read_log
from rig.effects import BY_NAME
from rig.log import Log

CLEAN, HIDDEN = "as it came", "onto"


@cache
def _log(path: str) -> Log:
    return read_log(Path(path))


def draw_onto(
    paths: Sequence[Path], *, seed: int, each: int, rig_file: Path | None = None
) -> list[Trial]:
    """The clean trial and `each` of every effect that can be hidden in all of these logs.

    Errors as of `read_log` and `read_rig`; ValueError where nothing can be hidden.
    """
    logs = [_log(str(path)) for path in paths]
    names = sorted(set.intersection(*(set(possible(log)) for log in logs)))
    if not names:
        raise ValueError("nothing can be hidden in these logs: they have no channel in common")
    told = rig_data(load_rig(rig_file)) if rig_file else {}
    files = tuple(str(path) for path in paths)
    blank = Trial("onto-0000", CLEAN, "", files, (0,) * len(files), {}, told, engine="onto")
    trials = [blank]
    for number, name in enumerate(name for name in names for _ in range(each)):
        rng = np.random.default_rng([seed, 2, number])
        drawn = _draw(logs, name, rng)
        if drawn is not None:
            by_axis, times = drawn
            trials.append(
                replace(
                    blank, name=f"onto-{number + 1:04d}", kind=HIDDEN, variant=name,
                    hidden={name: by_axis}, factor=times,
                )
            )  # fmt: skip
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


def onto_log(trial: Trial, path: str, seed: int) -> Log:
    """The log at `path` with the trial's effect hidden in it; a `logs.LogMaker`."""
    rig = trial.believed_rig if trial.believed else load_rig(None)
    return inject(
        _log(path), trial.hidden, ratio=rig.linkage.ratio, delay_s=rig.camera.delay_s
    )  # fmt: skip


@dataclass(frozen=True)
class Line:
    """One hidden effect in a real log: hidden and found size (beyond what the log as it came was
    said to have), whether it was named, what else was named that the clean log was not."""

    effect: str
    axes: str
    hidden: float
    found: float
    named: bool
    more: tuple[str, ...]
    verdict: str
    volts_left_out: bool


def onto_report(marks: Sequence[Mark], answers: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """How well hidden effects are named in these logs; `answers` by trial name."""
    clean = next(m for m in marks if m.trial.kind == CLEAN)
    base = {e["name"]: e for e in answers[clean.trial.name].get("effects") or []}
    before = base if clean.verdict == "named" else {}
    lines = [
        _line(m, answers[m.trial.name], before) for m in marks if m.trial.kind == HIDDEN
    ]  # fmt: skip
    asked = [m for m in marks if m.trial.kind == HIDDEN]
    right = {m.trial.name: line for m, line in zip(asked, lines, strict=True)}
    return {
        "as it came": {"verdict": clean.verdict, "named": list(clean.named)},
        "named": share(asked, lambda m: right[m.trial.name].named),
        "named and nothing more": share(
            asked, lambda m: right[m.trial.name].named and not right[m.trial.name].more
        ),
        "lines": [asdict(line) for line in sorted(lines, key=lambda one: one.effect)],
    }


def _line(m: Mark, answer: dict[str, Any], before: dict[str, Any]) -> Line:
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


def onto_markdown(report: dict[str, Any]) -> str:
    """The report as a Markdown table, a line a hidden effect."""
    clean = report["as it came"]
    named = ", ".join(clean["named"]) or "no name"
    body = [f"As they came: {clean['verdict']} ({named}).", ""]
    body += ["| hidden | axis | size | found | named | named besides | verdict |"]
    body += ["|---|---|---|---|---|---|---|"]
    for line in report["lines"]:
        name = line["effect"] + (" (volts left out)" if line["volts_left_out"] else "")
        said = f"{line['found']:.3g}" if line["found"] == line["found"] else "-"
        cells = [
            name,
            line["axes"],
            f"{line['hidden']:.3g}",
            said,
            "yes" if line["named"] else "no",
        ]
        body.append("| " + " | ".join([*cells, ", ".join(line["more"]), line["verdict"]]) + " |")
    return "\n".join(body) + "\n"
