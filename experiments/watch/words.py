"""What a watch found, as sentences and as JSON."""

from typing import Any

from calibration.gap.findings import Interval
from calibration.gap.model.parameters import Parameter
from calibration.gap.report.units import (
    effect_words,
    interval_words,
    key_words,
    shown_unit,
    sig,
)
from calibration.watch.change_detection import ONE_IN, Change
from calibration.watch.run_estimates import effect_of, unit_of
from experiments.records.run_folder import lost_words
from experiments.watch.watch import ACCEPTED, CHANGED, SKIPPED, UNCHANGED, JudgedRun, Watch
from rig.files import printable


def parameter_words(parameter: Parameter) -> str:
    """A parameter for people: `joint play x`, `gain y`, `camera yaw`."""
    axis = "" if parameter.axis == "xy" else f" {parameter.axis}"
    return effect_words(effect_of(parameter)) + axis


def change_words(found: Watch, change: Change) -> str:
    """A change as a sentence: what, since when, how much with its interval."""
    parameter = found.parameters[change.parameter]
    unit, factor = shown_unit(unit_of(parameter), parameter.key)
    size = interval_words(Interval(change.size, change.low, change.high), unit, factor)
    way = "grew" if change.size > 0 else "fell"
    key = key_words(parameter.key) if parameter.effect else ""
    name = parameter_words(parameter)
    name += f", {key}," if key and key not in name else ""
    since = found.counted[change.since].name
    return (
        f"{name} {way} by {size} from {sig(factor * change.before)} {unit}".rstrip()
        + f", since {since}{_likely(found, change)}"
    )


def _likely(found: Watch, change: Change) -> str:
    if change.earliest == change.latest:
        return ""
    first, last = found.counted[change.earliest].name, found.counted[change.latest].name
    return f" (may be from {first} to {last})"


def sentence(found: Watch) -> str:
    """The answer in one sentence."""
    judged = [one for one in found.runs if one.state in (UNCHANGED, CHANGED)]
    accepted = ", ".join(one.run.name for one in found.runs if one.state == ACCEPTED)
    if found.verdict == "no-new-run":
        return f"no new run to judge since {accepted} was accepted"
    if found.verdict == "nothing-changed":
        many = f"{len(judged)} run{'s' if len(judged) > 1 else ''}"
        return f"nothing changed in {many} since {accepted} was accepted"
    first, others = found.changes[0], found.changes[1:]
    more = ""
    if others:
        names = dict.fromkeys(parameter_words(found.parameters[o.parameter]) for o in others)
        more = f"; moved with it: {', '.join(names)}"
    return f"changed: {change_words(found, first)}{more}"


def run_words(found: Watch, one: JudgedRun) -> str:
    """What is said of one run, in one line: how it was judged, and which rows it lacks."""
    said = (_judged_words(found, one), lost_words(one.run.meta or {}))
    return printable("; ".join(filter(None, said)))


def statistic_words(found: Watch, one: JudgedRun) -> str:
    """The statistic of a judged run beside that from which a change is told; "" of others."""
    if one.strongest is None:
        return ""
    return f"statistic {abs(one.strongest.z):.2f}, a change from {found.threshold:.2f}"


def _judged_words(found: Watch, one: JudgedRun) -> str:
    if one.state == SKIPPED:
        return one.why
    if one.state == CHANGED:
        return "; ".join(change_words(found, change) for change in one.changes[:3])
    if one.state == ACCEPTED:
        return ""
    if one.strongest is None:
        return "too few runs to tell from chance"
    return f"largest: {parameter_words(found.parameters[one.strongest.parameter])}"


def as_json(found: Watch) -> dict[str, Any]:
    """The content of results.json; sizes in the units of the parameters (SI)."""
    return {
        "verdict": found.verdict,
        "sentence": sentence(found),
        "accepted": [one.run.name for one in found.runs if one.state == ACCEPTED],
        "one_false_alarm_in_runs": ONE_IN,
        "threshold": found.threshold,
        "changes": [_change(found, change) for change in found.changes],
        "parameters": [
            {
                "name": parameter_words(p),
                "effect": effect_of(p),
                "axis": p.axis,
                "key": p.key,
                "unit": unit_of(p),
                "accepted": found.model.value(p.name),
                "smallest_seen": float(found.smallest[j]),
            }
            for j, p in enumerate(found.parameters)
        ],
        "runs": [
            {
                "run": one.run.name,
                "created": (one.run.meta or {}).get("created"),
                "state": one.state,
                "why": one.why,
                "note": lost_words(one.run.meta or {}),
                "statistic": abs(one.strongest.z) if one.strongest else None,
                "changes": [_change(found, change) for change in one.changes],
                "values": None if one.row is None else found.values[one.row].tolist(),
                "standard_deviations": None if one.row is None else found.stds[one.row].tolist(),
            }
            for one in found.runs
        ],
    }


def _change(found: Watch, change: Change) -> dict[str, Any]:
    parameter = found.parameters[change.parameter]
    return {
        "effect": effect_of(parameter),
        "axis": parameter.axis,
        "key": parameter.key,
        "unit": unit_of(parameter),
        "since": found.counted[change.since].name,
        "earliest": found.counted[change.earliest].name,
        "latest": found.counted[change.latest].name,
        "before": change.before,
        "size": {"value": change.size, "low": change.low, "high": change.high},
        "statistic": change.z,
    }
