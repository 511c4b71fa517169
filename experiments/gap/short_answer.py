"""The answer of `rig gap` for somebody who sees it for the first time: a few plain sentences."""

from collections.abc import Collection, Sequence

from calibration.gap.decision_rule import DOUBTED_PROBABILITY
from calibration.gap.findings import Findings
from calibration.gap.report.units import effect_words, sig
from experiments.gap.when import when_words
from experiments.gap.words import (
    NO_EXPERIMENT,
    are_rivals,
    channel_words,
    closed_loop_words,
    percent,
)
from experiments.runs.protocol import read_protocol

# Chosen: steps of the ball tell most effects of plate and ball apart, squares on the servos alone
# those of the drive (tests/benchmarks/README.md).
WANTED = ("steps", "servo-squares")
NAMES = {"joint_backlash": "play in the joints", "gear_backlash": "play in the gears"}


def missing_protocols(protocols: Collection[str]) -> list[str]:
    """The protocols of WANTED that are not among those of the runs."""
    return [name for name in WANTED if name not in protocols]


def advice(protocols: Sequence[str]) -> str:
    """What to run first, where runs of these protocols are not enough to be sure; "" where they
    are.
    """
    absent = missing_protocols(protocols)
    if not absent:
        return ""
    seconds = sum(read_protocol(name).duration_s for name in absent)
    kinds = ", ".join(dict.fromkeys(protocols)) or "none"
    return (
        f"Not enough to tell play from friction (runs of: {kinds}): run "
        f"{' and '.join(absent)} first, {seconds:.0f} s."
    )


def verdict(found: Findings, *, enough: bool, contradiction: str = "") -> list[str]:
    """Sentences: what is missing, how sure, what speaks against it.

    enough: the runs can tell the usual causes apart, else nothing is called sure; contradiction:
    a sentence on what contradicts the names, "" for none.
    """
    lines = [_headline(found, sure=enough and not contradiction)]
    if contradiction:
        lines.append(contradiction)
    for effect in found.effects:
        if effect.twins:
            twins = " or ".join(map(_label, effect.twins))
            lines.append(
                f"What is called {_label(effect.name)} may be {twins}: they move a table alike, "
                "no run tells them apart."
            )
    return lines


def details(found: Findings, *, logs: int) -> list[str]:
    """Sentences: when and where it shows, what it changes, what to do next; logs: of how many runs
    of this rig."""
    lines = [*filter(None, [when_words(found, logs=logs, files=False)])]
    for where in found.where[:2]:
        times = f"errors {sig(where.gap, 2)} times what noise alone gives"
        lines.append(f"It shows in {channel_words(where.channel)}, {where.region}: {times}.")
    ahead = found.gap.ahead_1s_mm
    if "before" in ahead and "after" in ahead:
        best = f" (noise alone would leave {sig(ahead['floor'], 2)})" if "floor" in ahead else ""
        lines.append(
            f"The extended model predicts the ball 1 s ahead to {sig(ahead['after'], 2)} mm "
            f"instead of {sig(ahead['before'], 2)}{best}."
        )
    lines += filter(None, [closed_loop_words(found.closed_loop)])
    if found.untestable:
        names = ", ".join(effect_words(one.name) for one in found.untestable[:4])
        more = len(found.untestable) - 4
        others = f" and {more} more" if more > 0 else ""
        lines.append(f"These runs could not show: {names}{others}. The report says why.")
    if found.next_experiment is not None:
        n = found.next_experiment
        lines.append(f"Next: run {n.protocol} ({n.seconds:g} s).")
    else:
        lines.append(f"Next: {NO_EXPERIMENT[found.verdict]}")
    return lines


def _label(effect: str) -> str:
    return NAMES.get(effect, effect_words(effect))


def _headline(found: Findings, *, sure: bool) -> str:
    if not found.effects or found.verdict not in ("named", "undecided"):
        return found.sentence
    names = [_label(effect.name) for effect in found.effects]
    if are_rivals(found):
        return f"Undecided between: {', '.join(names)}."
    if not (sure and any(one.probability > DOUBTED_PROBABILITY for one in found.effects)):
        return f"Suspected, not proven: {', '.join(names)}."
    how = [percent(effect.probability) for effect in found.effects]
    if len(set(how)) == 1:
        each = " each" if len(how) > 1 else ""
        return f"Missing: {', '.join(names)} (sure: {how[0]}{each})."
    parts = ", ".join(f"{name} ({one})" for name, one in zip(names, how, strict=True))
    return f"Missing: {parts}."
