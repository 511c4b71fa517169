"""What `rig gap` prints: the answer in about a dozen lines.

What the logs cannot show stands with the smallest amplitude that they would have shown.
"""

from collections.abc import Mapping

from calibration.gap.findings import Findings, Named
from calibration.gap.report.units import interval_words, key_words, parameter_unit, sig
from experiments.gap.when import when_words
from experiments.gap.words import (
    are_rivals,
    channel_words,
    floors,
    percent,
    recalibration,
)
from rig.effects import BY_NAME, Effect

UNTESTABLE_SHOWN, NOTES_SHOWN, WHERE_SHOWN = 4, 3, 2


def summary_lines(found: Findings, *, recorded_here: bool = True, logs: int = 0) -> list[str]:
    """Lines for a terminal: verdict, where, effects, gap, servo, limits, next experiment, notes.

    recorded_here: as of `experiments.gap.report.write_gap_report`; logs: how many there are.
    """
    lines = [f"{found.verdict}{_sure(found)}: {found.sentence}"]
    if when := when_words(found, logs=logs, files=not recorded_here):
        lines.append(_line("when", when))
    for w in found.where[:WHERE_SHOWN]:
        where = f"{channel_words(w.channel)}, {w.region}"
        lines.append(
            _line("where", f"{where}: errors {floors(w.gap)} times what noise alone gives")
        )
    label = "rival" if are_rivals(found) else "effect"
    lines += [_line(label, effect_words(effect, found.known)) for effect in found.effects]
    if found.unknown is not None:
        left = found.unknown
        formula = f"; {left.formula}" if left.formula else ""
        lines.append(_line("unnamed", f"{channel_words(left.channel)}: {left.shape}{formula}"))
    lines += _gap_lines(found)
    lines += _servo_lines(found)
    if found.untestable:
        shown = found.untestable[:UNTESTABLE_SHOWN]
        names = [f"{u.name} ({u.why})" for u in shown]
        more = len(found.untestable) - len(names)
        names += [f"{more} more"] if more > 0 else []
        lines.append(_line("cannot see", ", ".join(names)))
    if found.next_experiment is not None:
        n = found.next_experiment
        told = " from ".join(n.separates)
        asked = f"rig run {n.protocol}"
        if not recorded_here:
            asked = f"a recording like the protocol {n.protocol}"
        lines.append(_line("next", f"{asked} ({n.seconds:g} s) tells {told}"))
    lines += [_line("note", note) for note in found.notes[:NOTES_SHOWN]]
    if len(found.notes) > NOTES_SHOWN:
        lines.append(_line("note", f"{len(found.notes) - NOTES_SHOWN} more in the report"))
    return lines


def _sure(found: Findings) -> str:
    """How sure the names of a verdict are, behind it; rivals' sentence tells it itself."""
    if found.verdict != "named" or not found.effects:
        return ""
    how = dict.fromkeys(percent(one.probability) for one in sorted(found.effects, key=_probability))
    return f" ({' to '.join([*how][:: max(1, len(how) - 1)])} sure)"


def _probability(effect: Named) -> float:
    return effect.probability


def _line(label: str, text: str) -> str:
    return f"  {label:10s} {text}"


def effect_words(effect: Named, known: Mapping[str, Effect] = BY_NAME) -> str:
    """One line on a named effect: name, probability, parameters with 95 % intervals, twins.

    known: the effects by name, of which the units are taken.
    """
    parts = []
    for axis, pairs in effect.parameters.items():
        for key, interval in pairs.items():
            where = "" if axis == "xy" else f"{axis} "
            unit, factor = parameter_unit(effect.name, key, known)
            parts.append(f"{where}{key_words(key)} {interval_words(interval, unit, factor)}")
    twins = f"; or its twins {', '.join(effect.twins)}" if effect.twins else ""
    sizes = f": {', '.join(parts)}" if parts else ""
    return f"{effect.name} ({percent(effect.probability)}){sizes}{twins}"


def _gap_lines(found: Findings) -> list[str]:
    """Before and after by channel, and one second ahead."""
    lines = []
    gap = found.gap
    if gap.before:
        pairs = []
        for channel, before in gap.before.items():
            after = f" -> {floors(gap.after[channel])}" if channel in gap.after else ""
            pairs.append(f"{channel_words(channel)} {floors(before)}{after}")
        where = "on data not used for the fit" if gap.held_out else "on the data of the fit"
        lines.append(
            _line("gap", f"{', '.join(pairs)} ({where}; 1.0 = noise alone, by the {gap.floor})")
        )
    lines += [_ahead_line("ball", gap.ahead_1s_mm, "mm")] if gap.ahead_1s_mm else []
    lines += [
        _ahead_line(channel_words(channel), ahead, "deg")
        for channel, ahead in gap.ahead_1s_deg.items()
    ]
    return lines


def _ahead_line(channel: str, ahead: Mapping[str, float], unit: str) -> str:
    """The error 1 s ahead of one channel: before, after, and that of a fit to the judged data."""
    after = f" -> {sig(ahead['after'])}" if "after" in ahead else ""
    floor = f" (fitted to these data: {sig(ahead['floor'])})" if "floor" in ahead else ""
    return _line("1 s ahead", f"{channel} {sig(ahead['before'])}{after} {unit}{floor}")


def _servo_lines(found: Findings) -> list[str]:
    """Calibrated numbers that are too far from the rig file's."""
    far = []
    for key, interval in found.calibrated.items():
        off, too_far = recalibration(key, interval, found.rig_before)
        if too_far and off is not None:
            far.append(f"{key} = {sig(interval.value)} ({100 * off:+.0f} %)")
    return [_line("servo", f"recalibrate the servo: {', '.join(far)}")] if far else []
