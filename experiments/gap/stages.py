"""The five stages of a gap report as titled blocks: the question, what was found, in words."""

from collections.abc import Callable, Sequence
from math import isfinite, nan
from pathlib import Path

from calibration.gap.findings import UNITS, Findings
from calibration.gap.prove import OUTLIER_Z
from calibration.gap.report.units import effect_words, shown_unit, sig
from experiments.gap import figures
from experiments.gap.words import (
    NO_EXPERIMENT,
    are_rivals,
    channel_words,
    closed_loop_words,
    closed_share,
    floors,
    percent,
    smallest_words,
)
from experiments.reports.report import Block, Code, Picture, Pictures, Section, Table
from experiments.runs.protocol import read_protocol
from rig.parameters import CHANNELS


def stage(title: str, question: str, blocks: Sequence[Block], missing: str) -> Section:
    """Section of `blocks`; without any, the text `missing` in a section marked as not run.

    question: what the stage answers, shown under its title.
    """
    return Section(title, blocks or [missing], question, ran=bool(blocks))


def channels_of(*gaps: dict[str, float]) -> list[str]:
    """Channels that appear in any of the gaps (channel -> floors), in the order of CHANNELS."""
    return [c for c in CHANNELS if any(c in gap for gap in gaps)]


def picture(figure, folder: Path, name: str, caption: str) -> Pictures:
    """Save the figure as NAME.png in `folder` and wrap it with its caption.

    OSError: the file cannot be written.
    """
    return Pictures([Picture(figures.save(figure, folder, name), caption)])


def locate_stage(found: Findings, folder: Path, names: Sequence[str]) -> Section:
    """Section "Locate": where the model is wrong, by channel, time, state and place.

    names: of the logs. Writes its figures in `folder`; OSError: they cannot be written.
    """
    blocks: list[Block] = []
    if found.where:
        rows = [[channel_words(w.channel), w.region, floors(w.gap)] for w in found.where]
        blocks.append(
            Table(("channel", "where", "gap [floors]"), rows, "Where it is worst.", words=2)
        )
    if found.gap.before:
        blocks.append(_level_table(found))
    moments = [p for p in found.profiles if p.quantity == "time"]
    states = [p for p in found.profiles if p.quantity != "time"]
    if moments:
        caption = (
            "The gap over time, one log after the other, in the order in which they are named "
            "above: a steady gap is a steady cause, a burst is an event. Errors beyond "
            f"{OUTLIER_Z:.0f} of their expected deviations, which the table leaves out, count here."
        )
        blocks.append(picture(figures.over_time(moments, names), folder, "gap-over-time", caption))
    for side in ("servo", "ball"):
        mine = [p for p in states if p.channel.startswith(side)]
        if mine:
            caption = f"{side.capitalize()} channels: the same errors sorted by what the table did."
            if side == "ball":
                caption += (
                    " A cause betrays itself by where it rises: play after reversals, friction at "
                    "low speed, a bent linkage at large angles."
                )
            figure = figures.over_state(mine)
            blocks.append(picture(figure, folder, f"gap-over-state-{side}", caption))
    for i, found_map in enumerate(found.maps):
        caption = (
            "Mean error over the plate, seen from above: a pattern is a force or a lens; grey "
            "where the ball never was."
        )
        figure = figures.plate_map(found_map)
        blocks.append(picture(figure, folder, f"plate-map-{i + 1}", caption))
    question = (
        "Where does the model fail? Its one-step errors are sorted by channel, time and state. "
        "Below about 1.05 floors there is nothing to find in a channel."
    )
    return stage("Locate", question, blocks, "This stage did not run.")


def _level_table(found: Findings) -> Table:
    """The gaps of every channel in floors and in units."""
    rows = []
    for channel in channels_of(found.gap.before):
        unit, factor = shown_unit(UNITS[channel])
        floor = found.gap.floors.get(channel, nan)
        before = found.gap.before[channel]
        small = f"{sig(factor * floor)} {unit}" if isfinite(floor) else "-"
        size = f"{sig(factor * floor * before)} {unit}" if isfinite(floor) else "-"
        rows.append([channel_words(channel), floors(before), size, small])
    head = ("channel", "gap [floors]", "error (RMS)", "noise floor")
    floor = f"The noise floor is that of the {found.gap.floor}."
    return Table(head, rows, f"The model as it came. {floor}")


def name_stage(found: Findings, folder: Path) -> Section:
    """Section "Name": which effect makes the errors, its twins and rivals, what cannot be seen.

    Writes its figure in `folder`; OSError: it cannot be written.
    """
    blocks: list[Block] = []
    accepted = [effect.name for effect in found.effects] if found.verdict == "named" else []
    if found.ranking:
        caption = (
            "The likeliest names. A probability follows from a score: how much better the name "
            "explains the errors (log-likelihood, less what its parameters cost) than deviations "
            "within the tolerances. Names joined by = make the same data and cannot be told apart "
            "by any experiment. Refused: the score was enough, but what was asked next was not; "
            "the notes say what."
        )
        figure = figures.ranking(found.ranking, accepted)
        blocks.append(picture(figure, folder, "ranking", caption))
    for effect in found.effects:
        if effect.twins:
            blocks.append(
                f"{effect.name} has structural twins: {_words(effect.twins)}. Any of them "
                "makes the same data; look at the hardware to tell."
            )
    if found.verdict == "undecided" and found.effects:
        names = [f"{e.name} ({percent(e.probability)})" for e in found.effects]
        apart = f"It is {' or '.join(names)}: these logs do not tell them apart."
        apart = apart if len(names) == 2 else found.sentence  # which says who rivals whom
        doubt = f"It may be {', '.join(names)}, or something else: the notes say why."
        blocks.append(apart if are_rivals(found) else doubt)
    if found.unknown is not None:
        left = found.unknown
        formula = f" A formula that holds on held-out data: {left.formula}." if left.formula else ""
        start = "Besides, something" if found.verdict == "named" else "Something"
        channel = channel_words(left.channel)
        blocks.append(
            f"{start} is left that no name explains, in {channel}: {left.shape}.{formula}"
        )
    if found.untestable:
        rows = [
            [u.name, u.why, smallest_words(u.name, u.smallest, found.known)]
            for u in found.untestable
        ]
        caption = "What these logs cannot show: such an effect may be there all the same."
        head = ("effect", "why", "smallest that would have shown")
        blocks.append(Table(head, rows, caption, words=3))
    question = "Which physical effect makes those errors? Every effect of the catalogue is tried."
    return stage("Name", question, blocks, "This stage did not run.")


def _words(names: Sequence[str]) -> str:
    return ", ".join(map(effect_words, names))


def prove_stage(found: Findings, folder: Path) -> Section:
    """Section "Prove": whether the gap closes on data that was not used for the fit.

    Writes its figures in `folder`; OSError: they cannot be written.
    """
    blocks: list[Block] = []
    if len(found.steps) > 1:
        caption = (
            "The gap effect by effect, on all data: its numbers differ from those of the tables, "
            "which are on held-out data. The dotted line is a perfect model."
        )
        figure = figures.shrinking(found.steps)
        blocks.append(picture(figure, folder, "gap-shrinking", caption))
    if found.gap.after:
        blocks.append(_before_after(found))
    if found.proof:
        blocks.append(_proof_table(found))
    if any(row.ahead_1s_mm is not None for row in found.proof):
        caption = "How far off the predicted ball is after one second, on the same held-out data."
        floor = found.gap.ahead_1s_mm.get("floor")
        figure = figures.ahead(found.proof, floor)
        blocks.append(picture(figure, folder, "error-1s-ahead", caption))
    if found.closed_loop:
        rows = [
            [r.quantity, r.unit, sig(r.measured), sig(r.before), sig(r.after), r.nearer]
            for r in found.closed_loop
        ]
        head = ("quantity", "unit", "recorded", "model before", "model after", "after is")
        caption = (
            "The recording simulated in closed loop, with the controller settings recorded with it "
            "or, of a file, those that its commands tell: does the model now behave like the table?"
        )
        blocks.append(Table(head, rows, caption, words=2))
        blocks += filter(None, [closed_loop_words(found.closed_loop)])
    question = (
        "Fitted on one part of the data, does the named effect close the gap on the other? (The "
        "name was looked for in all of it, the numbers were not.) The error 1 s ahead decides: one "
        "sample ahead a rival name or an unnamed curve may fit as well or better."
    )
    missing = "This stage did not run: nothing was added to the model."
    return stage("Prove", question, blocks, missing)


def _before_after(found: Findings) -> Table:
    rows = []
    for channel in channels_of(found.gap.before, found.gap.after):
        before = found.gap.before.get(channel, nan)
        after = found.gap.after.get(channel, nan)
        share = closed_share(before, after)
        rows.append([channel_words(channel), floors(before), floors(after), share])
    where = (
        "On data not used for the fit"
        if found.gap.held_out
        else "On the data of the fit itself (there was none to hold out)"
    )
    head = ("channel", "before [floors]", "after [floors]", "gap closed")
    return Table(head, rows, f"{where}, over the same floor before and after.")


def _proof_table(found: Findings) -> Table:
    channels = channels_of(*(row.gap for row in found.proof))
    servos = channels_of(*(row.ahead_1s_deg for row in found.proof))
    rows = [
        [
            row.model,
            *(floors(row.gap.get(channel, nan)) for channel in channels),
            sig(row.ahead_1s_mm),
            *(sig(row.ahead_1s_deg.get(channel)) for channel in servos),
        ]
        for row in found.proof
    ]
    named = [i for i, row in enumerate(found.proof) if row.model.startswith("named")]
    gaps = (f"{channel_words(c)} [floors]" for c in channels)
    degrees = (f"{channel_words(c)} 1 s ahead [deg]" for c in servos)
    head = ("model", *gaps, "ball 1 s ahead [mm]", *degrees)
    return Table(
        head, rows, "The models on the same held-out data.", marks=dict.fromkeys(named, "strong")
    )


def next_stage(found: Findings, command: Callable[[str], str]) -> Section:
    """Section "Next": the experiment to do next, or why none is proposed.

    command: makes the command lines of a protocol's name.
    """
    question = "Which experiment would tell more, for the least time on the rig?"
    plan = found.next_experiment
    if plan is None:
        blocks: list[Block] = [NO_EXPERIMENT[found.verdict]]
        if found.verdict == "undecided":
            blocks.append(Code(command("steps")))
        return Section("Next", blocks, question, ran=False)
    one, other = plan.separates
    expected = (
        f" The expected separation is {sig(plan.separation)} (10 decides)."
        if plan.separation
        else ""
    )
    asked = read_protocol(plan.protocol).title
    text = (
        f"Run the protocol {plan.protocol} ({plan.seconds:g} s on the rig): it separates {one} "
        f"from {other} best.{expected} Where the protocol cannot be run, record the like of it: "
        f"{asked[:1].lower()}{asked[1:]}. Then give the new run to rig gap with these logs."
    )
    return Section("Next", [text, Code(command(plan.protocol))], question)
