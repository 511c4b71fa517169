"""A name has to predict what its fit has not seen: the proof can take it back.

What is tried was chosen on all data; its numbers are held out. D, with its standard error se, is
what a name gains 1 s ahead (`calibration.gap.held_out`), C the cost one sample ahead:

1. All names of an output together: C with them is lower, and D > -se: 1 s ahead they do no harm (a
   small effect may not show there). "A or B" is refuted by what refutes both.
2. Each name beside the others: as rule 1. Where something without a name is left,
   a name may stand for a part of it: it needs D > SURE_Z se on one of its outputs.
3. The 95 % interval of its size excludes the nominal value, and the size is not at the end of its
   range on any axis, where it would have to be larger to be what its name says.
4. Its best rival in its place does not predict better 1 s ahead: D < SURE_Z se of the rival's gain.
5. Its size is a constant, and what it explains does not come before it
   (`calibration.gap.specification`). If not, something else acts on the output, or acts otherwise:
   the probability of its names is at most DOUBTED_PROBABILITY.
6. The names of an output are complete: at least MIN_COMPLETENESS (`calibration.gap.specification`),
   which bounds their probability as well.
7. A name is certain only where the names of one of its outputs lower the error 1 s ahead: for
   certain, D > SURE_Z se, or D > 0 and C falls for certain, by more than SURE_Z of the standard
   errors that its falls by blocks of COST_BLOCK_S give (Vuong, Econometrica 57, 1989). If not, its
   probability is at most DOUBTED_PROBABILITY.
8. What was refuted in an earlier round predicts the held-out data no better one sample ahead. If it
   does, it was nearer to the truth than the name: its probability is at most DOUBTED_PROBABILITY.
9. The size of a name is certain where it differs from its nominal value by more than chance in
   FAMILY_P of the tests, by the clustered deviation of its interval. If not, its probability is at
   most DOUBTED_PROBABILITY: the likelihood counts residuals that hang together as if they did not.
   So has a drift that a single run tells: whatever changes slowly has a trend over one run.

Where none of the names is certain, the verdict is "undecided".

Errors are bounded at the OUTLIER_SHARE quantile of the model without, so that a push that nobody
recorded does not decide; for harm at OUTLIER_RATIO times that as well, where D < -SURE_Z se, since
a wrong name may fail seldom and by much. A name that is refuted leaves the model. Nothing is
missing where no name is left, those of every output do harm by rule 1, and a flexible model
predicts no more than the model without them (`calibration.gap.specification`). Where none is left,
or a rival predicted better, the naming is repeated without those that were refuted, at most
MAX_ROUNDS times: the imitation may have kept the right one out.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from math import degrees

import numpy as np

from calibration.gap.decision_rule import (
    DOUBTED_PROBABILITY,
    FAMILY_P,
    MAX_ROUNDS,
    MIN_COMPLETENESS,
    OUTLIER_RATIO,
    RANGE_END_STEPS,
    RIVAL_MARGIN,
    SURE_Z,
    is_certain,
)
from calibration.gap.held_out import Prediction, gained, held_out
from calibration.gap.model.intervals import deviations, interval
from calibration.gap.model.parameters import BALL, PERIODIC
from calibration.gap.model.state import Key, State, drop_effects, outputs_of, plain
from calibration.gap.name.decide import Decision, decide, significant, verdict_of
from calibration.gap.name.naming_steps import NamingStep, Tell, untold
from calibration.gap.name.stepwise import Accepted
from calibration.gap.specification import (
    completeness,
    inconstancy,
    predictable,
    trend_of_one_run,
    untimely,
)
from calibration.gap.unnamed.basis import unnamed_terms
from calibration.statistics import student_quantile
from rig.effects import Effect


def decide_by_proof(before: State, tell: Tell = untold) -> tuple[Decision, tuple[str, ...]]:
    """The decision on a settled baseline whose names the held-out data do not refute, and in words
    the reasons of those that they did."""
    barred: list[str] = []
    reasons: tuple[str, ...] = ()
    decision = tried = first = decide(before, tell=tell)
    for i in range(MAX_ROUNDS):
        tried = decide(tried.naming.before, barred, tell) if i else tried
        tell(NamingStep.PROOF, "does it predict what the fit has not seen?")
        judged, outdone, more = judge(tried)
        if i:
            judged, doubts = _beside_refuted(judged, first)
            more += doubts
        reasons += more
        if i == 0 or judged.accepted:
            decision = judged
        lost = sorted({one.name for one in tried.accepted} - {one.name for one in judged.accepted})
        if not lost or (judged.accepted and not outdone):
            break
        barred += outdone or lost
    return decision, reasons + decision.dropped


def _beside_refuted(decision: Decision, first: Decision) -> tuple[Decision, tuple[str, ...]]:
    """The decision of a later round with rule 8, and its reasons in words; `first`: the decision of
    which names were refuted."""
    kept, reasons = [], []
    for one in decision.accepted:
        known = decision.state.nominal.catalogue
        outputs = [o for o in _outputs(one, known) if o in decision.state.evidence.outputs]
        levels = decision.state.evidence.levels
        refuted = replace(first.state, evidence=first.state.evidence.with_levels(levels))
        mine, other = held_out(decision.state, outputs), held_out(refuted, outputs)
        if sum(p.cost for p in other.values()) < sum(p.cost for p in mine.values()):
            one = replace(one, explained=min(one.explained, DOUBTED_PROBABILITY))
            reasons.append(f"not certain: {one.name}: {_names(first.accepted)} predicts better")
        kept.append(one)
    return _with(decision, kept), tuple(reasons)


def judge(decision: Decision) -> tuple[Decision, list[str], tuple[str, ...]]:
    """The decision without the names that the held-out data refute, those of them that a rival
    outdoes, and the reasons in words."""
    accepted, state, reasons = decision.accepted, decision.state, []
    if not accepted:
        return decision, [], ()
    known = state.nominal.catalogue
    acting = {output for one in accepted for output in _outputs(one, known)}
    outputs = [o for o in state.evidence.outputs if o in acting]
    bare = drop_effects(state, [key for one in accepted for key in _keys(one)])
    before, after = held_out(bare, outputs), held_out(state, outputs)
    alone = plain(state)
    complete = {output: completeness(plain(bare), alone, output) for output in outputs}
    lost: list[Accepted] = []
    spread = deviations(alone)
    for one in accepted:
        if reason := _not_a_size(alone, one, spread):
            lost.append(one)
            reasons.append(f"not named: {one.name}: {reason}")
    for output in outputs:
        here = [one for one in accepted if output in _outputs(one, known) and one not in lost]
        reason = _harm(output, before[output], after[output]) if output in after else ""
        if reason and _rival_stands(here, output, before):
            reason = ""
        reason = reason or _incomplete(output, complete[output])
        if reason and here:
            lost += here
            reasons.append(f"not named: {_names(here)}: {reason}")
    beside = bool(decision.unnamed or lost)
    for one in accepted if len(accepted) - len(lost) > 1 or beside else ():
        if one not in lost and (reason := _harm_of_one(decision, one, after, beside=beside)):
            lost.append(one)
            reasons.append(f"not named: {one.name}: {reason}")
    outdone = []
    for one in accepted:
        if one not in lost and (reason := _rival_is_better(one, after)):
            outdone.append(one)
            reasons.append(f"not named: {one.name}: {reason}")
    lost += outdone
    sure, doubts = _doubted(alone, [one for one in accepted if one not in lost], complete)
    kept = [_capped(one, sure, known) for one in accepted if one not in lost]
    reasons += doubts
    for i, one in enumerate(kept):
        weak = _unproven(one, before, after, known) or _faint(alone, one, spread)
        if reason := weak or trend_of_one_run(state, one):
            kept[i] = replace(one, explained=min(one.explained, DOUBTED_PROBABILITY))
            reasons.append(f"not certain: {one.name}: {reason}")
    if not lost:
        return _with(decision, kept), [], tuple(reasons)
    all_harm = all(o in after and _harmed(before[o], after[o]) for o in outputs)
    left = _without(decision, tuple(kept), lost, all_harm=all_harm)
    return left, [one.name for one in outdone], tuple(reasons)


def _with(decision: Decision, accepted: Iterable[Accepted]) -> Decision:
    """The decision with the probabilities of its names as in `accepted`."""
    accepted = tuple(accepted)
    verdict = verdict_of(accepted, decision.unnamed)
    return replace(decision, accepted=accepted, verdict=verdict)


def _outputs(one: Accepted, known: Mapping[str, Effect]) -> tuple[str, ...]:
    return outputs_of(known[one.name], one.axes)


def _keys(one: Accepted) -> list[Key]:
    return [(one.name, axis) for axis in one.axes]


def _names(accepted: Iterable[Accepted]) -> str:
    return " + ".join(one.name for one in accepted)


def _name(output: str) -> str:
    return "the ball" if output == BALL else output.replace("_", " ")


def _size(output: str, value: float) -> str:
    return f"{1e3 * value:.3g} mm" if output == BALL else f"{degrees(value):.3g} degrees"


def _not_a_size(state: State, one: Accepted, spread: Mapping[str, tuple[float, int]]) -> str:
    """The reason of rule 3 in words; "" if no axis is at the end of its range, and the name stands
    on one of its axes."""
    stands = False
    for axis in one.axes:
        size, deviation, at_end = _size_of(state, one, axis, spread)
        if at_end:
            return "its size is at the end of its range, so it stands for something else"
        stands |= not size < interval(0.0, deviation).high
    return "" if stands else "the interval of its size holds its nominal value, or 0 of a limit"


def _size_of(
    state: State, one: Accepted, axis: str, spread: Mapping[str, tuple[float, int]]
) -> tuple[float, tuple[float, int], bool]:
    """Distance of a name's size on an axis from its nominal value, its standard deviation with the
    number of blocks behind it, and whether it is at the end of its range. Of a limit, whose nominal
    value is infinite, the distance is that from 0: it has to be known as well as that."""
    first, *more = state.nominal.of(one.name, axis)
    free = [first, more[0]] if one.name in PERIODIC else [first]
    values = [state.fit.setting.get(k.name, k.nominal) for k in free]
    origins = [k.nominal if np.isfinite(k.nominal) else 0.0 for k in free]
    sizes, value = np.subtract(values, origins), values[0]
    at_end = any(e and abs(value - e) < RANGE_END_STEPS * first.step for e in first.range)
    deviation = max(spread.get(k.name, (0.0, 2)) for k in free)
    return float(np.linalg.norm(sizes)), deviation, at_end


def _faint(state: State, one: Accepted, spread: Mapping[str, tuple[float, int]]) -> str:
    """The reason of rule 9 in words; "" if the size on one of the axes is beyond chance."""
    for axis in one.axes:
        size, deviation, _ = _size_of(state, one, axis, spread)
        if not size <= student_quantile(max(deviation[1] - 1, 2), FAMILY_P) * deviation[0]:
            return ""
    return "its size is not beyond what so many tests reach by chance"


def _doubted(
    state: State, accepted: list[Accepted], complete: Mapping[str, float]
) -> tuple[dict[str, float], list[str]]:
    """What bounds the probability of an output's names by rules 5 and 6, and rule 5 in words."""
    sure, doubts = dict(complete), []
    for one in accepted:
        outputs = _outputs(one, state.nominal.catalogue)
        for output in (o for o in outputs if o in state.evidence.outputs):
            if reason := inconstancy(state, one, output) or untimely(state, one, output):
                sure[output] = min(sure[output], DOUBTED_PROBABILITY)
                doubts.append(f"not certain: {one.name}: {reason}")
    return sure, doubts


def _incomplete(output: str, share: float) -> str:
    """The reason of rule 6 in words; "" if the names of this output explain enough."""
    if share >= MIN_COMPLETENESS:
        return ""
    return (
        f"it explains {100 * share:.0f} % of what {_name(output)}'s signals explain of each other: "
        "something else acts"
    )


def _harmed(without: Prediction, with_it: Prediction) -> bool:
    """Whether the errors 1 s ahead grow: most of them, or for certain a few by much."""
    (most, se), (all_, wide) = (gained(without, with_it, r) for r in (1.0, OUTLIER_RATIO))
    return most < -se or all_ < -SURE_Z * wide


def _harm(output: str, without: Prediction, with_it: Prediction) -> str:
    """The reason of the rule 1 in words; "" if there is none."""
    if _harmed(without, with_it):
        return (
            f"1 s ahead on data not used, {_name(output)} errs by {_size(output, without.rms)} "
            f"without and {_size(output, with_it.rms)} with it"
        )
    if with_it.cost >= without.cost:
        return f"it predicts {_name(output)} no better on data not used"
    return ""


def _harm_of_one(
    decision: Decision, one: Accepted, after: dict[str, Prediction], *, beside: bool
) -> str:
    """The reason of rule 2 in words; "" if the name helps on one of its outputs, and harms on
    none. `beside`: something without a name is left."""
    outputs = [o for o in _outputs(one, decision.state.nominal.catalogue) if o in after]
    without = held_out(drop_effects(decision.state, _keys(one)), outputs)
    reasons = {output: _harm(output, without[output], after[output]) for output in outputs}
    harmed = [o for o in outputs if _harmed(without[o], after[o])]
    if harmed or (outputs and all(reasons.values())):
        return reasons[(harmed or outputs)[0]]
    if beside and (reason := _unproven(one, without, after, decision.state.nominal.catalogue)):
        return f"something without a name is left, and {reason}"
    return ""


def _unproven(
    one: Accepted,
    without: Mapping[str, Prediction],
    with_it: Mapping[str, Prediction],
    known: Mapping[str, Effect],
) -> str:
    """The reason of rule 7 in words; "" if the error 1 s ahead falls for certain on an output of
    the name, or there are too few windows to say."""
    outputs = [o for o in _outputs(one, known) if o in with_it and o in without]
    if not outputs or any(_proven(without[output], with_it[output]) for output in outputs):
        return ""
    return (
        "1 s ahead on data not used it is not certain that "
        f"{_name(outputs[0])} is predicted better with it"
    )


def _proven(without: Prediction, with_it: Prediction) -> bool:
    """Whether rule 7 calls a gain certain, or has too few windows to say."""
    d, se = gained(without, with_it)
    if d >= SURE_Z * se:
        return True
    return d > 0.0 and is_certain(without.costs - with_it.costs)


def _rival_stands(names: list[Accepted], output: str, before: dict[str, Prediction]) -> bool:
    """Whether the only name of an output is told as one of two, of which the other does no harm by
    rule 1: "A or B" is refuted by what refutes both."""
    close = [r for one in names for r in one.rivals[:1] if one.margin < RIVAL_MARGIN]
    if len(names) != 1 or not close:
        return False
    return not _harm(output, before[output], held_out(close[0].state, [output])[output])


def _rival_is_better(one: Accepted, after: dict[str, Prediction]) -> str:
    """The reason of rule 4 in words; "" if the best rival that the logs could show predicts no
    better 1 s ahead."""
    for rival in [rival for rival in one.rivals if rival.nameable][:1]:
        outputs = [o for o in _outputs(one, rival.state.nominal.catalogue) if o in after]
        others = held_out(rival.state, outputs)
        for output in outputs:
            d, se = gained(after[output], others[output])
            if d > SURE_Z * se:
                return (
                    f"1 s ahead on data not used, {_name(output)} errs by "
                    f"{_size(output, after[output].rms)} with it and by "
                    f"{_size(output, others[output].rms)} with {rival.name} in its place"
                )
    return ""


def _capped(one: Accepted, share: Mapping[str, float], known: Mapping[str, Effect]) -> Accepted:
    """The name with the smallest completeness of its outputs."""
    shares = [share[output] for output in _outputs(one, known) if output in share]
    return replace(one, explained=min(shares, default=1.0))


def _without(
    decision: Decision, kept: tuple[Accepted, ...], lost: list[Accepted], *, all_harm: bool
) -> Decision:
    """The decision with the names `kept`, and those in `lost` back inside their tolerances;
    `all_harm`: on each of their outputs the names do harm."""
    keys = [key for one in lost for key in _keys(one)]
    state = drop_effects(decision.state, keys)
    unnamed, none = decision.unnamed, "undecided"
    if not kept and unnamed is None:  # at the noise without the names first, as `decide` does
        looked_at = (decision.naming.before, state)
        found = (significant(unnamed_terms(one)) for one in looked_at)
        unnamed = next((term for term in found if term is not None), None)
        state = unnamed.state if unnamed else state
    if not kept:
        outputs = {o for one in lost for o in _outputs(one, state.nominal.catalogue)}
        seen = outputs & set(state.evidence.outputs)
        complete = all_harm and all(predictable(state, o) == 0.0 for o in seen)
        none = "nothing-missing" if complete else none
    verdict = verdict_of(kept, unnamed, none)
    return replace(decision, accepted=kept, state=state, verdict=verdict, unnamed=unnamed)
