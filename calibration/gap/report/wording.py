"""The findings in plain words: the sentence that sums them up, and notes."""

import re
from collections.abc import Mapping, Sequence
from math import hypot

from calibration.gap.decision_rule import (
    CHANCE_ONE_IN,
    DOUBTED_PROBABILITY,
    NAME_THRESHOLD,
    RANGE_END_STEPS,
    RIVAL_MARGIN,
)
from calibration.gap.findings import Interval, Named
from calibration.gap.model.change import Change
from calibration.gap.model.parameters import CALIBRATED, PERIODIC, SERVO, Parameter
from calibration.gap.model.state import State
from calibration.gap.name.decide import Decision
from calibration.gap.name.stepwise import Accepted
from calibration.gap.report.findings_of_decision import ball_height_m
from calibration.gap.report.units import parameter_unit, sig
from calibration.gap.unnamed.wording import describe
from rig.effects import Effect

RECALIBRATE = "recalibrate the servo"
VAGUE_WIDTH = 0.5  # width of an interval over its value beyond which it is not known


def notes(decision: Decision, servo: Mapping[str, Interval]) -> tuple[str, ...]:
    """Notes to print beside the names: on assumed friction, the servo's K and tau, the ball's
    height, parameters at the limit of their range, and the thresholds of chance. `servo`: as from
    `calibrated`."""
    state = decision.state
    return (
        _assumed_note(state)
        + _servo_notes(state, servo)
        + _height_note(state)
        + _edge_notes(state)
        + _change_note(decision)
        + _chance_note(decision)
    )


def _assumed_note(state: State) -> tuple[str, ...]:
    """The note on friction that the nominal model has without anybody having measured it."""
    servos = [output for output in SERVO if output in state.evidence.outputs]
    told = " and ".join(servos).replace("_", " ")
    if not state.nominal.load_friction or not servos:
        return ()
    return (
        f"{state.nominal.assumed_friction_V:.2g} V of dry friction on {told} is explained by "
        "the assumed friction of arm and joints, which nobody measured ([drive] of the rig file; "
        "set both to 0 for a bare motor)",
    )


def vague(value: Interval) -> bool:
    """Whether the interval of K or tau is wider than VAGUE_WIDTH times its value, so that the logs
    say little of it."""
    return value.high - value.low > VAGUE_WIDTH * abs(value.value)


def far_off(value: Interval, nominal: float, limit: float) -> bool:
    """Whether K or tau differs from the rig file's value `nominal` by more than the share `limit`,
    with an interval that excludes it and is not vague."""
    sure = not value.low <= nominal <= value.high and not vague(value)
    return sure and abs(value.value / nominal - 1) > limit


def _servo_notes(state: State, servo: Mapping[str, Interval]) -> tuple[str, ...]:
    """Notes on K, tau and a motor's lag: outside CALIBRATED, or beyond what a servo's lag may
    differ, "recalibrate the servo"; or not known."""
    rig, found = state.nominal.rig.servo, []
    for label, value in servo.items():
        key, axis = re.sub("_[xy]_", "_", label), "x" if "_x_" in label else "y"
        if label.startswith("motor"):
            nominal, limit = getattr(rig.on(axis), key), state.nominal.tolerance("servo_lag", axis)
            if abs(value.value - nominal) > limit:
                found.append(
                    f"{RECALIBRATE}: {label} is {value.value:.3g}, the rig file says {nominal:.3g} "
                    f"(tolerance {1e3 * limit:.0f} ms)"
                )
            continue
        nominal, limit = getattr(rig, key), CALIBRATED[key]
        if vague(value):
            found.append(
                f"these logs do not tell {label}: {value.value:.3g} [{value.low:.3g}, "
                f"{value.high:.3g}], the rig file says {nominal:.4g}"
            )
        elif far_off(value, nominal, limit):
            found.append(
                f"{RECALIBRATE}: {label} is {value.value:.4g}, the rig file says "
                f"{nominal:.4g} (tolerance {100 * limit:.0f} %)"
            )
    return tuple(found)


def _edge_notes(state: State) -> tuple[str, ...]:
    """Notes on sizes at the end of their range: they may stand in for something else."""
    setting, found = state.fit.setting, []
    for effect, axis in state.named:
        parameter, *more = state.nominal.of(effect, axis)
        value = setting.get(parameter.name, parameter.nominal)
        if any(
            end and abs(value - end) < RANGE_END_STEPS * parameter.step for end in parameter.range
        ):
            key, told = parameter.key, value
            if effect in PERIODIC:  # turned by its sine and cosine
                cosine = setting.get(more[0].name, more[0].nominal)
                key, told = PERIODIC[effect], hypot(value, cosine)
            found.append(
                f"{effect}: {axis} {key} = {told:.3g} is the most it may be: it may "
                "stand in for something else; check geometry and units in rig.toml"
            )
    return tuple(found)


def _height_note(state: State) -> tuple[str, ...]:
    """The note on a scale that comes with a shift as the plate tilts: a higher ball."""
    more = ball_height_m(state) - state.nominal.rig.camera.ball_height_m
    if not more or ("camera_scale", "xy") not in state.named:
        return ()
    way = "higher" if more > 0 else "lower"
    return (
        f"the scale comes with a shift as the plate tilts: the ball's centre lies "
        f"{1e3 * abs(more):.0f} mm {way} than its pictures were taken for",
    )


def _change_note(decision: Decision) -> tuple[str, ...]:
    """The note on a parameter that changes, beside something else without a name."""
    if decision.change is None or decision.unnamed is None:
        return ()
    return (f"a constant of the model changes: {change_words(decision.change)}",)


def change_words(change: Change) -> str:
    """What changes, from what to what, and what else may."""
    one = change.parameter
    unit, factor = parameter_unit(one.effect, one.key)
    ends = " to ".join(sig(factor * value) for value in (change.begin, change.end))
    others = dict.fromkeys(_parameter_words(other) for other in change.others)
    others.pop(_parameter_words(one), None)
    text = f"{_parameter_words(one)} from {ends} {unit}".strip()
    text += " during the run" if change.runs == 1 else f" over the {change.runs} runs"
    return f"{text} (or {', '.join(others)})" if others else text


def _parameter_words(one: Parameter) -> str:
    """An effect's name, or K or tau, with its axis."""
    name = one.effect or {"gain_rad_s_V": "K", "time_constant_s": "tau"}[one.key]
    return name if one.axis == "xy" else f"{name} {one.axis}"


def _chance_note(decision: Decision) -> tuple[str, ...]:
    chance = decision.chance
    if chance is None:
        return ()
    scores = ", ".join(
        f"{score:.1f} on {output.replace('_', ' ')}" for output, score in chance.scores.items()
    )
    return (
        f"by chance alone the best name on a log like this scores {scores} in 1 of {CHANCE_ONE_IN} "
        f"({chance.draws} draws): a name needs more, and at least {NAME_THRESHOLD:g}",
    )


def sentence(
    decision: Decision, names: tuple[Named, ...], servo: Mapping[str, Interval] | None = None
) -> str:
    """The verdict as one or two sentences in plain words, for the user. `servo`: as from
    `calibrated`."""
    known = decision.state.nominal.catalogue
    told = [_effect_words(name, known) for name in names]
    left = decision.unnamed and describe(decision.unnamed)
    if decision.verdict == "nothing-missing":
        if any(n.startswith(RECALIBRATE) for n in _servo_notes(decision.state, servo or {})):
            return (
                "Nothing is missing once the servo is recalibrated: with its own numbers the model "
                "explains the log; the notes say how far off the file's are."
            )
        return "Nothing is missing: the model explains the log within the declared tolerances."
    if decision.verdict == "unknown-effect" and decision.unnamed:
        channel = decision.unnamed.channel
        return f"Something that has no name in the catalogue acts on {channel}: {left}."
    if decision.change:
        return (
            "Something that has no name in the catalogue acts: what the model takes for a constant "
            f"changes, {change_words(decision.change)}."
        )
    if not decision.accepted:
        return (
            "Something is missing, but no effect of the catalogue that fits these logs also "
            "predicts data that were not fitted: none is named."
        )
    rivals = {one.name: _close(one) for one in decision.accepted}
    pairs = [
        (words, name, rivals.get(name.name, [])) for words, name in zip(told, names, strict=True)
    ]
    either = [" or ".join((words, *close)) for words, _, close in pairs if close]
    sure = [words for words, name, close in pairs if not close and not _doubted(name)]
    perhaps = [words for words, name, close in pairs if not close and _doubted(name)]
    parts = [f"The model lacks {_listed(sure)}."] if sure else []
    if either:
        parts.append(f"{'; '.join(either)}: this log cannot tell them apart.")
    if perhaps:
        who, what = "It" if sure else "The model", _listed(perhaps)
        parts.append(f"{who} may lack {what}: this is not certain, the notes say why.")
    parts += [f"Something without a name is left: {left}."] if left else []
    return " ".join(parts)


def _close(one: Accepted) -> list[str]:
    """The rivals that the logs do not tell from a name."""
    return [rival.name for rival in one.rivals if rival.margin < RIVAL_MARGIN]


def _listed(words: Sequence[str]) -> str:
    """`a, b and c`."""
    *most, last = words
    return f"{', '.join(most)} and {last}" if most else last


def _doubted(name: Named) -> bool:
    return name.probability <= DOUBTED_PROBABILITY


def _effect_words(name: Named, known: Mapping[str, Effect]) -> str:
    """The name with its first size on each axis: `gear_backlash (x 0.97 deg, y 0.95 deg)`."""
    sizes = []
    for axis, pairs in name.parameters.items():
        for key, value in list(pairs.items())[:1]:
            unit, factor = parameter_unit(name.name, key, known)
            where = "" if axis == "xy" else f"{axis} "
            sizes.append(f"{where}{sig(factor * value.value)} {unit}".strip())
    return f"{name.name} ({', '.join(sizes)})" if sizes else name.name
