"""What a name does to predictions of data that its fit has not seen, in the words of the veto.

The rules, and D and se of which they speak, are those of `calibration.gap.veto`.
"""

from collections.abc import Mapping
from dataclasses import replace
from math import degrees

from calibration.gap.decision_rule import OUTLIER_RATIO, RIVAL_MARGIN, SURE_Z, is_certain
from calibration.gap.held_out import Prediction, gained, held_out
from calibration.gap.model.parameters import BALL
from calibration.gap.model.state import Key, State, drop_effects, outputs_of
from calibration.gap.name.decide import Decision
from calibration.gap.name.stepwise import Accepted
from rig.effects import Effect


def outputs_of_name(one: Accepted, known: Mapping[str, Effect]) -> tuple[str, ...]:
    return outputs_of(known[one.name], one.axes)


def keys_of_name(one: Accepted) -> list[Key]:
    return [(one.name, axis) for axis in one.axes]


def in_words(output: str) -> str:
    return "the ball" if output == BALL else output.replace("_", " ")


def _size(output: str, value: float) -> str:
    return f"{1e3 * value:.3g} mm" if output == BALL else f"{degrees(value):.3g} degrees"


def harmed(without: Prediction, with_it: Prediction) -> bool:
    """Whether the errors 1 s ahead grow: most of them, or for certain a few by much."""
    (most, se), (all_, wide) = (gained(without, with_it, r) for r in (1.0, OUTLIER_RATIO))
    return most < -se or all_ < -SURE_Z * wide


def harm(output: str, without: Prediction, with_it: Prediction) -> str:
    """The reason of the rule 1 in words; "" if there is none."""
    if harmed(without, with_it):
        return (
            f"1 s ahead on data not used, {in_words(output)} errs by {_size(output, without.rms)} "
            f"without and {_size(output, with_it.rms)} with it"
        )
    if with_it.cost >= without.cost:
        return f"it predicts {in_words(output)} no better on data not used"
    return ""


def harm_of_one(
    decision: Decision, one: Accepted, after: dict[str, Prediction], *, beside: bool
) -> str:
    """The reason of rule 2 in words; "" if the name helps on one of its outputs, and harms on
    none. `beside`: something without a name is left."""
    outputs = [o for o in outputs_of_name(one, decision.state.nominal.catalogue) if o in after]
    without = held_out(drop_effects(decision.state, keys_of_name(one)), outputs)
    reasons = {output: harm(output, without[output], after[output]) for output in outputs}
    worse = [o for o in outputs if harmed(without[o], after[o])]
    if worse or (outputs and all(reasons.values())):
        return reasons[(worse or outputs)[0]]
    if beside and (reason := unproven(one, without, after, decision.state.nominal.catalogue)):
        return f"something without a name is left, and {reason}"
    return ""


def harmed_axes(
    decision: Decision, one: Accepted, after: Mapping[str, Prediction]
) -> dict[str, str]:
    """By axis the reason of rule 2 in words, where a name does harm on one of its servos and is
    proven on the other; an effect of both servos in one, or of which both axes show in one output,
    is judged as a whole."""
    effect = decision.state.nominal.catalogue[one.name]
    own = {axis: outputs_of(effect, (axis,)) for axis in one.axes}
    outputs = [o for shown in own.values() for o in shown if o in after]
    if min(len(own), len(outputs)) < 2 or len(set(own.values())) < len(own):
        return {}
    without = held_out(drop_effects(decision.state, keys_of_name(one)), outputs)
    worse = {axis: o for axis, (o,) in own.items() if harmed(without[o], after[o])}
    others = [o for axis, (o,) in own.items() if axis not in worse]
    if not others or not all(_proven(without[o], after[o]) for o in others):
        return {}
    return {
        axis: f"not named on {in_words(o)}: {one.name}: {harm(o, without[o], after[o])}"
        for axis, o in worse.items()
    }


def unproven(
    one: Accepted,
    without: Mapping[str, Prediction],
    with_it: Mapping[str, Prediction],
    known: Mapping[str, Effect],
) -> str:
    """The reason of rule 7 in words; "" if the error 1 s ahead falls for certain on an output of
    the name, or there are too few windows to say."""
    outputs = [o for o in outputs_of_name(one, known) if o in with_it and o in without]
    if not outputs or any(_proven(without[output], with_it[output]) for output in outputs):
        return ""
    return (
        "1 s ahead on data not used it is not certain that "
        f"{in_words(outputs[0])} is predicted better with it"
    )


def _proven(without: Prediction, with_it: Prediction) -> bool:
    """Whether rule 7 calls a gain certain, or has too few windows to say."""
    d, se = gained(without, with_it)
    if d >= SURE_Z * se:
        return True
    return d > 0.0 and is_certain(without.costs - with_it.costs)


def rival_stands(names: list[Accepted], output: str, before: dict[str, Prediction]) -> bool:
    """Whether the only name of an output is told as one of two, of which the other does no harm by
    rule 1: "A or B" is refuted by what refutes both."""
    close = [r for one in names for r in one.rivals[:1] if one.margin < RIVAL_MARGIN]
    if len(names) != 1 or not close:
        return False
    return not harm(output, before[output], held_out(close[0].state, [output])[output])


def rival_as_good(alone: State, one: Accepted, left: str) -> str:
    """Why a name on the output `left`, where something has no name, may be one of two, in words; ""
    if it predicts better one sample ahead than each rival in its place for certain. `alone`: the
    state without the unnamed term.

    A rival with more numbers pays for them, and may be the one that would leave nothing.
    """
    if left not in outputs_of_name(one, alone.nominal.catalogue):
        return ""
    own = held_out(alone, [left])
    for rival in (rival for rival in one.rivals if rival.nameable):
        evidence = rival.state.evidence.with_levels(alone.evidence.levels)
        other = held_out(replace(rival.state, evidence=evidence), [left])
        if left in own and not is_certain(other[left].costs - own[left].costs):
            return f"beside what has no name, {rival.name} in its place predicts as well"
    return ""


def rival_is_better(one: Accepted, after: dict[str, Prediction]) -> str:
    """The reason of rule 4 in words; "" if the best rival that the logs could show predicts no
    better 1 s ahead."""
    for rival in [rival for rival in one.rivals if rival.nameable][:1]:
        outputs = [o for o in outputs_of_name(one, rival.state.nominal.catalogue) if o in after]
        others = held_out(rival.state, outputs)
        for output in outputs:
            d, se = gained(after[output], others[output])
            if d > SURE_Z * se:
                return (
                    f"1 s ahead on data not used, {in_words(output)} errs by "
                    f"{_size(output, after[output].rms)} with it and by "
                    f"{_size(output, others[output].rms)} with {rival.name} in its place"
                )
    return ""
