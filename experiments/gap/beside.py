"""What an analysis found beside what is known otherwise: a calibration, the virtual table's truth.

Only for a person who compares: the analysis has its answer before any of this is read.
"""

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from math import tau
from pathlib import Path

from calibration.bundle import load_draft
from calibration.gap.findings import Findings, Interval
from calibration.gap.report.units import (
    effect_words,
    interval_words,
    key_words,
    parameter_unit,
    sig,
)
from rig.effects import BY_NAME, Effect
from rig.files import json_of
from rig.rigfile import own_names, read_rig

Place = tuple[str, str, str]  # effect, axis, key of the parameter
HEAD = ("effect", "axis", "found", "Calibrate found", "truth", "")
AGREES, CONTRADICTS = "agrees", "contradicts"
# A size that is off by less contradicts nothing, if its interval leaves the other out or not: of
# ten intervals at 95 % one often does. Chosen: no controller is the worse for it.
NEAR_SHARE, NEAR = 0.1, "agrees within 10 %"
TRUE, DIFFERS = "agrees with the truth", "differs"
NOT_NAMED, NOT_THERE = "not named", "named, and is not there"
TOO_SMALL = "within the tolerance of a well-kept rig"
DEAD, HALF, SIDES = "dead_zone", "half_width_V", ("positive_V", "negative_V")


def found_values(found: Findings) -> dict[Place, Interval]:
    """Every parameter of the named effects."""
    return {
        (effect.name, axis, key): interval
        for effect in found.effects
        for axis, pairs in effect.parameters.items()
        for key, interval in pairs.items()
    }


def calibrated_values(
    file: Path, table: Path | None = None, truth: Mapping[Place, float] | None = None
) -> dict[Place, Interval]:
    """What a calibration found of effects: the play of gears and joints; {} without a readable
    calibration.

    table: rig file of the virtual table on which the play was measured, if there is such a file;
    truth: of the one that is asked about; {} where they differ.
    """
    values: dict[Place, Interval] = {}
    with suppress(OSError, ValueError):
        if truth is not None and table is not None and table.is_file():
            measured = read_rig(table)
            if _flat(measured.effects, measured.catalogue) != truth:
                return {}
        play = load_draft(file).play
        for what, by_axis in (play.plays if play else {}).items():
            for axis, one in by_axis.items():
                if what in ("gear", "joint"):
                    width = one.width_rad
                    interval = Interval(width.value, width.low, width.high)
                    values[f"{what}_backlash", axis, "play_rad"] = interval
    return values


def true_values(runs: Sequence[Path]) -> dict[Place, float] | None:
    """Effects of the virtual table that all these runs were made on, as truth.json says them.

    None: a run is not of a virtual table, or they were made on different ones.
    """
    tables = []
    for run in runs:
        try:
            rig = json_of(run / "truth.json")["rig"]
            tables.append(_flat(rig.get("effects") or {}, {*BY_NAME, *own_names(rig)}))
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None
    return tables[0] if tables and all(one == tables[0] for one in tables) else None


def _flat(
    effects: Mapping[str, Mapping[str, Mapping[str, float]]], known: Collection[str]
) -> dict[Place, float]:
    return {
        (name, axis, key): float(value)
        for name, by_axis in effects.items()
        if name in known
        for axis, pairs in by_axis.items()
        for key, value in pairs.items()
        if value
    }


def beside_rows(
    found: Mapping[Place, Interval],
    calibrated: Mapping[Place, Interval],
    truth: Mapping[Place, float] | None,
    known: Mapping[str, Effect] = BY_NAME,
) -> list[list[str]]:
    """Rows under HEAD, one a parameter that is found, calibrated or true; the last cell is the
    verdict on what was found. known: the effects by name, of which the units are taken.
    """
    apart = {a for name, a, key in (*found, *(truth or {})) if name == DEAD and key in SIDES}
    found = _by_side(found, apart)
    if truth is not None:
        exact = {place: Interval(true, true, true) for place, true in truth.items()}
        truth = {place: one.value for place, one in _by_side(exact, apart).items() if one.value}
    rows = []
    places: list[Place] = [*found, *calibrated, *(truth or {})]
    for place in dict.fromkeys(places):
        name, axis, key = place
        unit, factor = parameter_unit(name, key, known)
        cells = [
            interval_words(values[place], unit, factor) if place in values else ""
            for values in (found, calibrated)
        ]
        true = ""
        if truth is not None:
            true = f"{sig(factor * truth[place])} {unit}".strip() if place in truth else "none"
        label, what = effect_words(name), key_words(key)
        if what not in label:  # "joint play" says already what its width is of
            label += f", {what}"
        verdict = _verdict(place, found, calibrated, truth, known)
        if (
            verdict == NOT_NAMED
            and truth
            and place in truth
            and _is_small(truth[place], place, known)
        ):
            verdict = TOO_SMALL
        rows.append([label, "both" if axis == "xy" else axis, *cells, true, verdict])
    return rows


def _by_side(values: Mapping[Place, Interval], axes: Collection[str]) -> dict[Place, Interval]:
    """The values, with the two sides in place of a dead zone of these axes: a half width is added
    to both, as in the plant."""
    found, none = dict(values), Interval(0.0, 0.0, 0.0)
    for axis in axes:
        half = found.pop((DEAD, axis, HALF), None)
        for place in ((DEAD, axis, key) for key in SIDES):
            if half is not None:
                one = found.get(place, none)
                found[place] = Interval(
                    half.value + one.value, half.low + one.low, half.high + one.high
                )
    return found


def calibrated_beside(file: Path, table: Path) -> tuple[str, list[list[str]]]:
    """A sentence on whether the play that a calibration found on the virtual table of the rig file
    `table` is the true one, and rows of (what, found, true, verdict).

    OSError, ValueError: a file cannot be read, or the calibration holds no play.
    """
    rig = read_rig(table)
    truth = _flat(rig.effects, rig.catalogue)
    found = calibrated_values(file)
    if not found:
        raise ValueError(f"{file} holds no play")
    rows, wrong = [], []
    for place, one in found.items():
        name, axis, key = place
        unit, factor = parameter_unit(name, key)
        true = truth.get(place, 0.0)
        verdict = agreement(one, Interval(true, true, true))
        if verdict == CONTRADICTS and abs(one.value - true) <= BY_NAME[name].tolerance:
            verdict = AGREES
        label = f"{effect_words(name)}, {axis}"
        wrong += [label] * (verdict == CONTRADICTS)
        rows.append([label, interval_words(one, unit, factor), f"{sig(factor * true)} {unit}"])
        rows[-1].append(verdict.replace(CONTRADICTS, DIFFERS))
    return (f"{DIFFERS} from the truth: {', '.join(wrong)}" if wrong else TRUE), rows


def truth_lines(found: Findings, runs: Sequence[Path]) -> list[str]:
    """Lines on what was found beside the truth of the virtual table that these runs were made on;
    none where there is none.
    """
    truth = true_values(runs)
    if truth is None:
        return []
    return [
        f"{name} {axis}: found {one or 'nothing'}, truth {true}: {verdict}"
        for name, axis, one, _, true, verdict in beside_rows(
            found_values(found), {}, truth, found.known
        )
    ]


def _is_small(value: float, place: Place, known: Mapping[str, Effect]) -> bool:
    """Whether the true value of an effect's first parameter is within the declared tolerance, for
    which no rig lacks anything."""
    name, _, key = place
    effect = known[name]
    first = effect.parameters[0]
    return key == first.key and abs(value - first.null) <= effect.tolerance


def _verdict(
    place: Place,
    found: Mapping[Place, Interval],
    calibrated: Mapping[Place, Interval],
    truth: Mapping[Place, float] | None,
    known: Mapping[str, Effect],
) -> str:
    """An effect is there where its size is, its first parameter (a dead zone's two sides are sizes,
    too); of one that is not, what shapes it says nothing, and a shape that the truth does not tell
    is at its null. A shape that differs denies no name; a phase is one of a turn."""
    if place not in found:
        return NOT_NAMED
    one = found[place]
    if truth is not None:
        name, axis, key = place
        nulls = {parameter.key: parameter.null for parameter in known[name].parameters}
        sizes = SIDES if name == DEAD and key in SIDES else (next(iter(nulls)),)
        if all((name, axis, size) not in truth for size in sizes):
            return NOT_THERE if key in sizes else ""
        true = truth.get(place, nulls.get(key, 0.0))
        if key == "phase_rad":
            true += tau * round((one.value - true) / tau)
        verdict = agreement(one, Interval(true, true, true))
        return DIFFERS if verdict == CONTRADICTS and key not in sizes else verdict
    return agreement(one, calibrated[place]) if place in calibrated else ""


def agreement(one: Interval, other: Interval) -> str:
    """Whether two values of one size agree, in words."""
    if one.low <= other.high and other.low <= one.high:
        return AGREES
    near = abs(one.value - other.value) <= NEAR_SHARE * abs(other.value)
    return NEAR if near else CONTRADICTS


def contradictions(rows: Sequence[Sequence[str]]) -> str:
    """A sentence on what contradicts; "" where nothing does."""
    wrong = [f"{row[0]} {row[1]}" for row in rows if row[-1] in (CONTRADICTS, NOT_THERE)]
    if not wrong:
        return ""
    return (
        f"This contradicts what is known otherwise ({', '.join(wrong)}): the named effects stand "
        "for something else. Do not take the names over. (The report has the answer of the data "
        "alone.)"
    )
