"""`gap.html`: what is missing from the model, for someone who knows the lab but not the method."""

from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import replace
from math import degrees
from pathlib import Path
from typing import Any, TypeVar

from calibration.gap.agreement import sentences
from calibration.gap.findings import Findings, Named
from calibration.gap.report.units import interval_words, key_words, parameter_unit, shown_unit, sig
from experiments.gap.stages import locate_stage, name_stage, next_stage, prove_stage, stage
from experiments.gap.when import when_words
from experiments.gap.words import (
    VERDICT_WORDS,
    added_toml,
    are_rivals,
    channel_words,
    doubts,
    floors,
    nominal_of,
    percent,
    recalibration,
    sentence_of,
    spoken,
)
from experiments.records.run_folder import read_meta, write_results
from experiments.reports.figures import SOURCES
from experiments.reports.report import Block, Code, Section, Table, write_page
from rig.files import put_aside
from rig.rigfile import write_rig

B = TypeVar("B", bound=Block | None)
SHORT_CHANNELS = 4
RIG_NOT_GIVEN = "none was given, so the one in each run's run.json, else the default table's"


def origin_words(logs: Sequence[Path], *, demo: bool = False) -> str:
    """Where the runs of an analysis come from, for the tag of its page: "virtual rig", "measured",
    both; "" where no run.json says it. demo: they are the demo's."""
    sources = set()
    for log in logs:
        with suppress(OSError, ValueError):
            sources.add(SOURCES[read_meta(log)["source"]])
    return ", ".join((["demo"] if demo else []) + sorted(sources))


def write_findings(
    found: Findings, folder: Path, *, names: Sequence[str], rig_file: Path | None = None, **of: Any
) -> Path:
    """Write all files of an analysis in `folder`, and return the path of the page gap.html.

    These are results.json, the extended model as rig.toml (where something was added, else one of
    an earlier analysis becomes rig.toml.1), and the page with its figures. names: of the logs;
    rig_file: the one that was given; of: the other arguments of `write_gap_report`. OSError: the
    folder cannot be written.
    """
    write_results(folder, found.to_json())
    if found.rig_after is not None and (found.effects or found.unknown):
        write_rig(found.rig_after, folder / "rig.toml", doubts(found))
    elif (folder / "rig.toml").exists():
        put_aside(folder / "rig.toml")
    return write_gap_report(found, folder, names=names, rig_file=rig_file, **of)


def write_gap_report(
    found: Findings,
    folder: Path,
    *,
    names: Sequence[str],
    rig_file: Path | None = None,
    origin: str = "",
    remark: str = "",
    recorded_here: bool = True,
) -> Path:
    """Write gap.html, self-contained, and its figures (PNG) in `folder`; return the page's path.

    names: of the logs; rig_file: the one that was given, which the page names; origin: as of
    `origin_words`; remark: a sentence before the summary, on what was hidden or on runs that do not
    suffice; recorded_here: whether runs of this rig are among the logs, so that it can make more.
    OSError: the folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    known = found.known
    stages = [
        _spoken(section, known)
        for section in (
            locate_stage(found, folder, names),
            name_stage(found, folder),
            add_stage(found, names),
            prove_stage(found, folder),
            next_stage(found, next_command if recorded_here else command_of_files),
        )
    ]
    by_log = set(sentences(found.by_log, names))  # a table of its own tells them
    when = when_words(found, logs=len(names), files=not recorded_here)
    return write_page(
        folder / "gap.html",
        title="Where model and table disagree",
        summary=[spoken(said, known) for said in (remark, when, *summary(found)) if said],
        origin=origin,
        sections=stages,
        template="gap.html",
        numbered=True,
        verdict=found.verdict,
        verdict_words=VERDICT_WORDS.get(found.verdict, found.verdict),
        sentence=spoken(found.sentence, known),
        answer_table=_spoken_block(answer_table(found), known),
        names=list(names),
        rig_words=str(rig_file) if rig_file is not None else RIG_NOT_GIVEN,
        notes=[spoken(note, known) for note in found.notes if note not in by_log],
        told="angle told"
        if found.rig_before is not None and found.rig_before.servo.takes_angle
        else "volts",
    )


def _spoken(section: Section, known: Collection[str]) -> Section:
    """A section with the effects' names in words; what is typed or stands in a file stays."""
    return replace(section, blocks=[_spoken_block(block, known) for block in section.blocks])


def _spoken_block(block: B, known: Collection[str]) -> B:
    if isinstance(block, str):
        return spoken(block, known)
    if isinstance(block, Table):
        rows = [[spoken(cell, known) for cell in row] for row in block.rows]
        return replace(block, rows=rows)
    return block


def answer_table(found: Findings) -> Table | None:
    """What is missing, in words, how large on each axis, and how sure; None where nothing has a
    name."""
    rows = [
        [
            effect.name,
            sentence_of(effect.name, found.known),
            *(_size_on(effect, axis, found) for axis in "xy"),
            percent(effect.probability),
        ]
        for effect in found.effects
    ]
    head = ("missing", "what it is", "x [95 %]", "y [95 %]", "sure")
    if are_rivals(found):
        head = ("one of these", *head[1:])
    return Table(head, rows, words=2) if rows else None


def _size_on(effect: Named, axis: str, found: Findings) -> str:
    """The size of an effect on an axis, which may be that of both; "" where it is not named."""
    pairs = effect.parameters.get(axis) or effect.parameters.get("xy") or {}
    for key, interval in list(pairs.items())[:1]:
        return interval_words(interval, *parameter_unit(effect.name, key, found.known))
    return ""


def next_command(protocol: str) -> str:
    """The command lines to type for the next experiment with a protocol."""
    return (
        f"rig run {protocol} --arm with --rig rig.toml --out next\n"
        "rig gap LOG... next/runs/* --rig rig.toml"
    )


def command_of_files(_protocol: str) -> str:
    """The same for recordings that another program made, and which it has to make again."""
    return "rig gap LOG... NEW --rig rig.toml"


def summary(found: Findings) -> list[str]:
    """At most two sentences for the head of the page, none where nothing improved.

    They give the gap before and after [noise floors] and the ball's error one second ahead [mm].
    """
    lines = []
    gap = found.gap
    closed = [
        f"{channel_words(c)} from {floors(before)} to {floors(gap.after[c])}"
        for c, before in gap.before.items()
        if c in gap.after and before >= 1.05
    ]
    if closed and found.steps[1:]:
        where = "data not used for the fit" if gap.held_out else "the data of the fit"
        lines.append(
            f"With the model extended, the gap shrinks on {where}: "
            f"{', '.join(closed[:SHORT_CHANNELS])} noise floors (1.0 is perfect)."
        )
    ahead = gap.ahead_1s_mm
    if "before" in ahead and "after" in ahead and ahead["after"] < 0.98 * ahead["before"]:
        floor = (
            f"; fitted to these data themselves the model reaches {sig(ahead['floor'])} mm"
            if "floor" in ahead
            else ""
        )
        lines.append(
            f"One second ahead the ball is predicted to within {sig(ahead['after'])} mm instead of "
            f"{sig(ahead['before'])} mm{floor}."
        )
    return lines


def add_stage(found: Findings, names: Sequence[str]) -> Section:
    """Section "Add": parameters of the named effects, together and by log (`names`), servo numbers,
    text for rig.toml, noise."""
    blocks: list[Block] = []
    if found.effects:
        blocks.append(_parameter_table(found))
        blocks += [_log_table(found, names)] if found.by_log else []
        blocks += [
            f"{effect.name}: {sentence_of(effect.name, found.known)}"
            for effect in found.effects
            if sentence_of(effect.name, found.known)
        ]
    if found.calibrated:
        blocks += _servo_blocks(found)
    toml = added_toml(found)
    if toml:
        blocks.append("What was added to the model, as it stands in the new rig.toml:")
        blocks.append(Code("\n".join([*(f"# {doubt}" for doubt in doubts(found)), toml])))
    if found.unknown is not None and found.unknown.formula:
        blocks.append(f"The unnamed term in formula: {found.unknown.formula}.")
    if found.noise:
        blocks.append(_noise_table(found))
    question = (
        "How large is it? The effect's numbers with 95 % intervals, beside what a well-kept rig "
        "stays within (tolerance) and what any rig could have (range)."
    )
    return stage("Add", question, blocks, "This stage did not run: there is nothing to add.")


def _parameter_table(found: Findings) -> Table:
    rows = []
    for effect in found.effects:
        known = found.known.get(effect.name)
        for axis, pairs in effect.parameters.items():
            for key, interval in pairs.items():
                unit, factor = parameter_unit(effect.name, key, found.known)
                tolerance, span = "-", "-"
                for i, p in enumerate(known.parameters if known else ()):
                    if p.key == key:
                        span = f"{factor * p.low:.3g} to {factor * p.high:.3g} {unit}".strip()
                        if i == 0 and known and known.tolerance:
                            tolerance = f"{factor * known.tolerance:.3g} {unit}".strip()
                both = "both" if axis == "xy" else axis
                value = interval_words(interval, unit, factor)
                rows.append([effect.name, both, key_words(key), value, tolerance, span])
    head = ("effect", "axis", "quantity", "value [95 %]", "tolerance", "range")
    caption = "Sizes as fitted" + (
        "; the rivals' too, of which at most one is right." if are_rivals(found) else "."
    )
    return Table(head, rows, caption, words=3)


def _log_table(found: Findings, names: Sequence[str]) -> Table:
    """The sizes of the names in every log alone."""
    rows = []
    for one in found.by_log:
        unit, factor = parameter_unit(one.name, one.key, found.known)
        sizes = [interval_words(size, unit, factor) if size else "not told" for size in one.sizes]
        place = "both" if one.axis == "xy" else one.axis
        alone = sum(size is not None for size in one.sizes) < 2
        agree = "cannot say" if alone else "yes" if one.agree else "no"
        rows.append([f"{one.name}, {place}", *sizes, agree])
    logs = [
        names[i] if i < len(names) else f"log {i + 1}" for i in range(len(found.by_log[0].sizes))
    ]
    caption = (
        "The size of each name in every log alone [95 %]. The logs agree where the sizes differ by "
        "no more than chance and a healthy table's tolerance allow (1 in 100)."
    )
    return Table(("effect", *logs, "logs agree"), rows, caption, words=1)


def _servo_blocks(found: Findings) -> list[Block]:
    """The calibrated numbers beside the rig file's, and what to do about them."""
    rows, far, marks = [], [], {}
    for key, interval in found.calibrated.items():
        unit, factor = ("ms", 1000.0) if key.endswith("_s") else ("", 1.0)
        label = key.removesuffix("_s") if unit == "ms" else key
        if key.endswith("_rad_s_V"):
            unit, label = "rad/s/V", key.removesuffix("_rad_s_V")
        elif key.endswith(("_rad", "_m")):
            unit, factor = shown_unit(key.rpartition("_")[2])
            label = key.rpartition("_")[0]
        off, too_far = recalibration(key, interval, found.rig_before)
        nominal = nominal_of(key, found.rig_before)
        told = f"{sig(factor * nominal)} {unit}" if nominal is not None else "-"
        by = f"{100 * off:+z.1f} %" if off is not None else "-"
        if too_far:
            far.append(f"{label.replace('_', ' ')} is off by {by}")
            marks[len(rows)] = "strong"
        rows.append([label.replace("_", " "), interval_words(interval, unit, factor), told, by])
    head = ("servo", "fitted [95 %]", "rig file", "off by")
    caption = "Gain K and time constant of the servos are always fitted and never an effect."
    blocks: list[Block] = [Table(head, rows, caption, marks=marks)]
    if far:
        said = f"Recalibrate the servo: {'; '.join(far)} (limits: 5 % for the gain, 10 % for the "
        blocks.append(f"{said}time constant).")
    return blocks


# What `rig.prediction.innovations.noise` names: words, unit as shown, factor from SI.
NOISES = {
    "servo_process": ("servo's speed, random walk", "deg/s per root of a second", degrees(1)),
    "servo_measured": ("reading of a servo's angle", "deg", degrees(1)),
    "ball_process": ("ball's velocity, random walk", "mm/s per root of a second", 1e3),
    "ball_measured": ("ball's place as seen", "mm", 1e3),
    "ball_memory_s": ("time in which an error of the camera fades (0: none lasts)", "ms", 1e3),
}


def _noise_table(found: Findings) -> Table:
    seen = {channel.partition("_")[0] for channel in found.gap.floors} or {"servo", "ball"}
    rows = []
    for key, value in found.noise.items():
        if key.partition("_")[0] in seen:
            name, unit, factor = NOISES[key]
            rows.append([name, sig(factor * value), unit])
    return Table(("noise, as estimated on the logs", "value", "unit"), rows)
