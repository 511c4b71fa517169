"""Words of the gap workflow for people: no jargon."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict
from math import inf, isfinite
from pathlib import PurePath
from typing import Any

import tomli_w

from calibration.gap.decision_rule import DOUBTED_PROBABILITY
from calibration.gap.findings import ClosedLoopRow, Findings, Interval
from calibration.gap.model.parameters import CALIBRATED
from calibration.gap.report.units import effect_words, key_words, parameter_unit, sig
from calibration.gap.report.wording import far_off
from rig.effects import BY_NAME, Effect
from rig.parameters import Rig
from rig.rigfile import SECTIONS

# Why no experiment is proposed, by verdict.
NO_EXPERIMENT = {
    "named": "No experiment is proposed: no two names are left that a run could tell apart.",
    "nothing-missing": "No experiment is needed: nothing is missing.",
    "unknown-effect": "No experiment is proposed: no two names are left to tell apart.",
    "undecided": "This stage did not run: there are no two names to tell apart yet. Record a log "
    "with more motion, such as the one made by the protocol steps.",
}

VERDICT_WORDS = {
    "named": "what is missing has a name",
    "nothing-missing": "nothing is missing",
    "unknown-effect": "something is missing that has no name",
    "undecided": "undecided",
}


def channel_words(channel: str) -> str:
    """A channel's name for people: `ball_x` -> `ball x`."""
    return channel.replace("_", " ")


def floors(gap: float | None) -> str:
    """A gap in noise floors, decimals chosen by its size: 1.04, 41.0, 410; "-" if not known."""
    if gap is None or not isfinite(gap):
        return "-"
    return f"{gap:.2f}" if abs(gap) < 10 else f"{gap:.1f}" if abs(gap) < 100 else f"{gap:.0f}"


def percent(probability: float) -> str:
    """A probability (0 to 1) in percent, at most "> 99 %" and at least "< 1 %"; "-" for NaN."""
    if not isfinite(probability):
        return "-"
    if probability > 0.99:
        return "> 99 %"
    return "< 1 %" if probability < 0.01 else f"{100 * probability:.0f} %"


def farther_note(rows: Sequence[ClosedLoopRow]) -> tuple[str, ...]:
    """The note on what the extended model does worse in closed loop, where it does more worse than
    better; () elsewhere."""
    worse, better = ([r for r in rows if r.nearer == how] for how in ("farther", "nearer"))
    if len(worse) <= len(better):
        return ()
    parts = [
        f"{r.quantity} {sig(r.measured)} {r.unit} recorded, {sig(r.before)} before, {sig(r.after)}"
        for r in worse
    ]
    words = "in closed loop the extended model is farther from the recording than the one before"
    return (f"{words}: {'; '.join(parts)} after",)


def closed_loop_words(rows: Sequence[ClosedLoopRow]) -> str:
    """A sentence on what the extended model does better and worse in closed loop; "" without any
    number that both models have."""
    told = [r for r in rows if r.nearer]
    if not told:
        return ""
    better, worse = ([r.quantity for r in told if r.nearer == how] for how in ("nearer", "farther"))
    return (
        f"In closed loop the extended model is nearer to the recording than the one before in "
        f"{len(better)} of {len(told)} numbers, farther in {', '.join(worse) or 'none'}."
    )


def smallest_words(
    effect: str, smallest: dict[str, float], known: Mapping[str, Effect] = BY_NAME
) -> str:
    """The smallest amplitude that a log would have shown, in shown units; "-" without any.

    smallest: parameter key -> value (SI); known: as of `parameter_unit`.
    """
    parts = []
    for key, value in smallest.items():
        unit, factor = parameter_unit(effect, key, known)
        parts.append(f"{key_words(key)} {sig(factor * value)} {unit}".strip())
    return ", ".join(parts) or "-"


def sentence_of(effect: str, known: Mapping[str, Effect] = BY_NAME) -> str:
    """The sentence on one of the `known` effects; "" for another."""
    return known[effect].sentence if effect in known else ""


def spoken(text: str, known: Collection[str] = BY_NAME) -> str:
    """A text with the effects' names as `effect_words` has them: `gear_backlash` -> `gear play`."""
    names = "|".join(map(re.escape, known))
    return re.sub(rf"\b({names})\b", lambda found: effect_words(found[0]), text)


def nominal_of(key: str, rig: Rig | None) -> float | None:
    """The rig file's value of the calibrated servo number `key`, such as `gain_x_rad_s_V`, in its
    unit.

    None without a rig, or where its servo has no such number.
    """
    return getattr(rig.servo, _without_axis(key), None) if rig is not None else None


def _without_axis(key: str) -> str:
    """`gain_x_rad_s_V` -> `gain_rad_s_V`."""
    return re.sub(r"_(x|y|xy)_", "_", key)


def recalibration(key: str, interval: Interval, rig: Rig | None) -> tuple[float | None, bool]:
    """Distance of the calibrated number `key` from the rig file's, as a share of it, and whether it
    is too large.

    The limits are those of `calibration.gap.model.parameters.CALIBRATED`. (None, False) without a
    nominal number.
    """
    nominal = nominal_of(key, rig)
    if not nominal:
        return None, False
    far = far_off(interval, nominal, CALIBRATED.get(_without_axis(key), inf))
    return interval.value / nominal - 1, far


def closed_share(before: float, after: float) -> str:
    """Share of a gap that is closed, (before - after)/(before - 1), in percent, or by how much it
    grew.

    before, after: gaps in noise floors; "no gap to close" below 1.05 (both, where it grew) or where
    one is not finite.
    """
    if not (isfinite(before) and isfinite(after)) or max(before, after) < 1.05:
        return "no gap to close"
    if after - before >= 0.05:
        return f"grew by {after - before:.2f}"
    return f"{100 * (before - after) / (before - 1):.0f} %" if before >= 1.05 else "no gap to close"


def added_toml(found: Findings) -> str:
    """The part of the extended rig.toml that differs from the nominal one, as TOML text.

    Numbers have five figures. "" where nothing was added.
    """
    changed: dict[str, Any] = {}
    before, after = found.rig_before, found.rig_after
    if before is not None and after is not None:
        for section in SECTIONS:
            old, new = asdict(getattr(before, section)), asdict(getattr(after, section))
            other = {key: value for key, value in new.items() if value != old[key]}
            if other:
                changed[section] = other
        effects = {k: v for k, v in after.effects.items() if before.effects.get(k) != v}
    else:
        effects = {
            e.name: {
                axis: {key: i.value for key, i in pairs.items()}
                for axis, pairs in e.parameters.items()
                if pairs
            }
            for e in found.effects
            if found.verdict == "named"
        }
    if effects:
        own = [PurePath(one.file).name for one in after.own] if after is not None else []
        changed["effects"] = ({"own": own} if own else {}) | effects
    text = tomli_w.dumps(_rounded(changed)).strip() if changed else ""
    return re.sub(r"\[\n([^\]]*?),?\n\]", lambda found: f"[{_one_line(found[1])}]", text)


def doubts(found: Findings) -> list[str]:
    """A sentence on each effect of the extended rig.toml that is not certain."""
    extended = {} if found.rig_after is None else found.rig_after.effects
    return [
        f"Not certain ({percent(one.probability)}): {one.name}; the notes of gap.html say why."
        for one in found.effects
        if one.name in extended
        and (found.verdict != "named" or one.probability <= DOUBTED_PROBABILITY)
    ]


def _one_line(numbers: str) -> str:
    return " ".join(numbers.split())


def _rounded(value: Any) -> Any:
    """The same with numbers of five figures, more than the intervals allow."""
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    return float(f"{value:.5g}") if isinstance(value, float) and isfinite(value) else value


def are_rivals(found: Findings) -> bool:
    """Whether `effects` are alternatives that the logs do not separate; the names of any other
    undecided answer are doubted, each for itself."""
    likely = any(one.probability > DOUBTED_PROBABILITY for one in found.effects)
    return found.verdict == "undecided" and likely
