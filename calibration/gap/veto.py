"""A name has to predict what its fit has not seen: the proof can take it back.

What is tried was chosen on all data; its numbers are held out. D, with its standard error se, is
what a name gains 1 s ahead (`calibration.gap.held_out`), C the cost one sample ahead:

1. All names of an output together: C with them is lower, and D > -se: 1 s ahead they do no harm (a
   small effect may not show there). "A or B" is refuted by what refutes both.
2. Each name beside the others: as rule 1. Where it does harm on one servo and is proven on the
   other by rule 7, it is not told on the one. Where something without a name is left, a name may
   stand for a part of it: it needs D > SURE_Z se on one of its outputs, and is certain only where
   it predicts that output better one sample ahead than each rival in its place, as in rule 7.
3. The 95 % interval of its size excludes the nominal value, and the size is not at the end of its
   range on any axis, where it would have to be larger to be what its name says.
4. Its best rival in its place does not predict better 1 s ahead: D < SURE_Z se of the rival's gain.
5. Its size is a constant, what it explains does not come before it, and it is not known to stand in
   for something else (`calibration.gap.constancy`, `.specification`). If not, something else acts
   on the output, or acts otherwise: the probability of its names is at most DOUBTED_PROBABILITY.
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
   So has a drift that a single run tells and does not show to be even; and a constant beside a term
   without a name that depends on the place, which has a mean.

Where none of the names is certain, the verdict is "undecided". Where there is none, every parameter
of the model has to be a constant (`calibration.gap.constancy`), or an effect without a name is
missing.

Errors are bounded at the OUTLIER_SHARE quantile of the model without, so that a push that nobody
recorded does not decide; for harm at OUTLIER_RATIO times that as well, where D < -SURE_Z se, since
a wrong name may fail seldom and by much. A name that is refuted leaves the model. Nothing is
missing where no name is left, those of every output do harm by rule 1, and a flexible model
predicts no more than the model without them (`calibration.gap.specification`). What is left has to
stand without it by rules 1 to 4 and 6. Where none is left, or a rival predicted better, or others
fell with the first that were refuted, the naming is repeated without these, at most MAX_ROUNDS
times: the imitation may have kept the right one out.
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

from calibration.gap.constancy import changing, inconstancy, trend_of_one_run
from calibration.gap.decision_rule import (
    DOUBTED_PROBABILITY,
    MAX_ROUNDS,
    MIN_COMPLETENESS,
)
from calibration.gap.harm import (
    harm,
    harm_of_one,
    harmed,
    harmed_axes,
    in_words,
    keys_of_name,
    outputs_of_name,
    rival_as_good,
    rival_is_better,
    rival_stands,
    unproven,
)
from calibration.gap.held_out import Prediction, held_out
from calibration.gap.model.intervals import Spread, deviations
from calibration.gap.model.state import State, drop_effects, plain
from calibration.gap.name.decide import Decision, decide, significant, verdict_of
from calibration.gap.name.load_friction import (
    FILES_FRICTION,
    FRICTION,
    RIGID_SHAFTS,
    model_of_rigid_shafts,
    names_files_friction,
)
from calibration.gap.name.naming_steps import NamingStep, Tell, untold
from calibration.gap.name.stepwise import Accepted, settled_baseline
from calibration.gap.sizes import faint, not_a_size
from calibration.gap.specification import (
    another_response,
    completeness,
    misfit_of_a_fall,
    part_of_what_is_left,
    predictable,
    untimely,
    weaker_at_centre,
)
from calibration.gap.unnamed.basis import unnamed_terms
from rig.effects import Effect


def decide_by_proof(before: State, tell: Tell = untold) -> tuple[Decision, tuple[str, ...]]:
    """The decision on a settled baseline whose names the held-out data do not refute, and in words
    the reasons of those that they did. Where a Coulomb friction is named that is the rig file's, it
    is decided anew with shafts that do not wind up; where it is named again, it is doubted."""
    decision, reasons = _proved(before, tell)
    known = model_of_rigid_shafts(decision.naming.before, decision.state)
    if known is not None:
        rigid, told = _proved(settled_baseline(before.evidence, known), tell)
        if names_files_friction(rigid.naming.before, rigid.state):
            kept = [one.doubted() if one.name == FRICTION else one for one in decision.accepted]
            decision, reasons = _with(decision, kept), (*reasons, FILES_FRICTION)
        else:
            decision, reasons = rigid, (RIGID_SHAFTS, *told)
    if not decision.accepted and (change := changing(plain(decision.state))):
        decision = replace(decision, verdict="unknown-effect", change=change)
    return decision, reasons


def _proved(before: State, tell: Tell) -> tuple[Decision, tuple[str, ...]]:
    """`decide_by_proof` on one nominal model, whose parameters are taken for constants."""
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
        outputs = [o for o in outputs_of_name(one, known) if o in decision.state.evidence.outputs]
        levels = decision.state.evidence.levels
        refuted = replace(first.state, evidence=first.state.evidence.with_levels(levels))
        mine, other = held_out(decision.state, outputs), held_out(refuted, outputs)
        if sum(p.cost for p in other.values()) < sum(p.cost for p in mine.values()):
            one = one.doubted()
            reasons.append(f"not certain: {one.name}: {_names(first.accepted)} predicts better")
        kept.append(one)
    return _with(decision, kept), tuple(reasons)


def judge(decision: Decision) -> tuple[Decision, list[str], tuple[str, ...]]:
    """The decision without the names that the held-out data refute, those of them without which the
    naming is to be repeated, and the reasons in words.

    What is left is doubted beside all that was found, which takes up what no name explains, and has
    to stand without what was refuted.
    """
    if not decision.accepted:
        return decision, [], ()
    tried = _try(decision)
    for one in decision.accepted:
        if worse := harmed_axes(decision, one, tried.after):
            told, barred, more = judge(_off_axes(decision, one, worse))
            return told, barred, (*worse.values(), *more)
    lost, outdone, reasons = _refuted(decision, tried)
    gone = [*lost, *outdone]
    standing = tuple(one for one in decision.accepted if one not in gone)
    kept, doubts = _doubted(replace(decision, accepted=standing), tried)
    if not gone:
        return _with(decision, kept), [], tuple(doubts)
    doubted = replace(decision, accepted=(*kept, *gone))
    left, more = _standing(_without(doubted, gone, all_harm=tried.all_harm))
    fell = len(left.accepted) < len(kept)
    barred = [one.name for one in outdone] + [one.name for one in lost if fell]
    return left, barred, (*reasons, *doubts, *more)


def _standing(left: Decision) -> tuple[Decision, tuple[str, ...]]:
    """What is left of a decision by rules 1 to 4 and 6, again and again, and the reasons in
    words."""
    if not left.accepted:
        return left, ()
    tried = _try(left)
    lost, outdone, reasons = _refuted(left, tried)
    if not (lost or outdone):
        return left, ()
    less, more = _standing(_without(left, [*lost, *outdone], all_harm=tried.all_harm))
    return less, (*reasons, *more)


@dataclass(frozen=True, eq=False)
class _Tried:
    """What names are judged by: the state without the unnamed term and the spread of its
    parameters, by output the predictions without all names and with them, and their completeness
    (`calibration.gap.specification`)."""

    alone: State
    spread: Mapping[str, Spread]
    before: dict[str, Prediction]
    after: dict[str, Prediction]
    complete: Mapping[str, float]

    @property
    def all_harm(self) -> bool:
        """Whether the names do harm on each of their outputs."""
        before, after = self.before, self.after
        return all(o in after and harmed(before[o], after[o]) for o in self.complete)


def _try(decision: Decision) -> _Tried:
    """Fit and predict what the names of a decision are judged by."""
    state = decision.state
    known = state.nominal.catalogue
    acting = {output for one in decision.accepted for output in outputs_of_name(one, known)}
    outputs = [o for o in state.evidence.outputs if o in acting]
    after = held_out(state, outputs)
    bare = drop_effects(state, [key for one in decision.accepted for key in keys_of_name(one)])
    begun = replace(decision.naming.before, evidence=state.evidence)
    before = _better(held_out(bare, outputs), held_out(begun, outputs))
    alone = plain(state)
    complete = {output: completeness(plain(bare), alone, output) for output in outputs}
    return _Tried(alone, deviations(alone), before, after, complete)


def _refuted(decision: Decision, tried: _Tried) -> tuple[list[Accepted], list[Accepted], list[str]]:
    """The names that rules 1 to 3 and 6 refute, those that a rival outdoes by rule 4, and the
    reasons in words."""
    accepted, known = decision.accepted, decision.state.nominal.catalogue
    lost: list[Accepted] = []
    reasons: list[str] = []
    for one in accepted:
        if reason := not_a_size(tried.alone, one, tried.spread):
            lost.append(one)
            reasons.append(f"not named: {one.name}: {reason}")
    for output, share in tried.complete.items():
        here = [
            one for one in accepted if output in outputs_of_name(one, known) and one not in lost
        ]
        reason = ""
        if output in tried.after:
            reason = harm(output, tried.before[output], tried.after[output])
        if reason and rival_stands(here, output, tried.before):
            reason = ""
        reason = reason or _incomplete(output, share)
        if reason and here:
            lost += here
            reasons.append(f"not named: {_names(here)}: {reason}")
    beside = bool(decision.unnamed or lost)
    each, left = decision.state.evidence.each, [one for one in accepted if one not in lost]
    asked = left if len(left) > 1 or beside else []
    harms = each(lambda one: harm_of_one(decision, one, tried.after, beside=beside), asked)
    lost += [one for one, reason in zip(asked, harms, strict=True) if reason]
    left = [one for one in left if one not in lost]
    better = each(lambda one: rival_is_better(one, tried.after), left)
    outdone = [one for one, reason in zip(left, better, strict=True) if reason]
    told = (*zip(asked, harms, strict=True), *zip(left, better, strict=True))
    reasons += [f"not named: {one.name}: {reason}" for one, reason in told if reason]
    return lost, outdone, reasons


def _better(one: dict[str, Prediction], other: dict[str, Prediction]) -> dict[str, Prediction]:
    """By output the prediction that errs less 1 s ahead or, where no log lasts that long, costs
    less: a fit without names that begins beside them may end in a worse minimum than the one with
    which naming began."""
    return {o: min(p, other.get(o, p), key=lambda e: (e.rms, e.cost)) for o, p in one.items()}


def _leans(decision: Decision, alone: State, one: Accepted, kept: Collection[Accepted]) -> str:
    """Why a name may be another's mean, rest, trend or part, in words; "" if it is none. alone: the
    state without the unnamed term; kept: all names that stand."""
    outputs = outputs_of_name(one, alone.nominal.catalogue)
    left = decision.unnamed.output if decision.unnamed else ""
    return (
        part_of_what_is_left(one, outputs, decision.unnamed)
        or rival_as_good(alone, one, left)
        or misfit_of_a_fall(alone, one, kept)
        or trend_of_one_run(decision.state, one)
    )


def _with(decision: Decision, accepted: Iterable[Accepted]) -> Decision:
    """The decision with the probabilities of its names as in `accepted`."""
    accepted = tuple(accepted)
    verdict = verdict_of(accepted, decision.unnamed)
    return replace(decision, accepted=accepted, verdict=verdict)


def _names(accepted: Iterable[Accepted]) -> str:
    return " + ".join(one.name for one in accepted)


def _doubted(decision: Decision, tried: _Tried) -> tuple[list[Accepted], list[str]]:
    """The names with what rules 5 to 7 and 9 leave of their probability, and why in words."""
    alone, known = tried.alone, tried.alone.nominal.catalogue
    sure, doubts = dict(tried.complete), []
    for one in decision.accepted:
        outputs = outputs_of_name(one, known)
        stands_in = another_response(alone, one) or weaker_at_centre(
            alone, one, decision.accepted, tried.spread
        )
        for output in (o for o in outputs if o in alone.evidence.outputs):
            size = stands_in or inconstancy(alone, one, output)
            if reason := size or untimely(alone, one, output):
                sure[output] = min(sure[output], DOUBTED_PROBABILITY)
                doubts.append(f"not certain: {one.name}: {reason}")
    kept = [_capped(one, sure, known) for one in decision.accepted]
    for i, one in enumerate(kept):
        weak = unproven(one, tried.before, tried.after, known) or faint(alone, one, tried.spread)
        if reason := weak or _leans(decision, alone, one, kept):
            kept[i] = one.doubted()
            doubts.append(f"not certain: {one.name}: {reason}")
    return kept, doubts


def _incomplete(output: str, share: float) -> str:
    """The reason of rule 6 in words; "" if the names of this output explain enough."""
    if share >= MIN_COMPLETENESS:
        return ""
    known = f"what {in_words(output)}'s signals explain of each other"
    return f"it explains {100 * share:.0f} % of {known}: something else acts"


def _off_axes(decision: Decision, one: Accepted, axes: Collection[str]) -> Decision:
    """The decision with a name off some of its axes, back inside its tolerances there."""
    state = drop_effects(decision.state, [(one.name, axis) for axis in axes])
    left = replace(one, axes=tuple(axis for axis in one.axes if axis not in axes))
    accepted = tuple(left if other is one else other for other in decision.accepted)
    return replace(decision, accepted=accepted, state=state)


def _capped(one: Accepted, share: Mapping[str, float], known: Mapping[str, Effect]) -> Accepted:
    """The name with the smallest completeness of its outputs."""
    shares = [share[output] for output in outputs_of_name(one, known) if output in share]
    return replace(one, explained=min(shares, default=1.0))


def _without(decision: Decision, lost: Collection[Accepted], *, all_harm: bool) -> Decision:
    """The decision without the names in `lost`, which are back inside their tolerances; `all_harm`:
    on each of their outputs the names do harm."""
    kept = tuple(one for one in decision.accepted if one not in lost)
    keys = [key for one in lost for key in keys_of_name(one)]
    state = drop_effects(decision.state, keys)
    unnamed, none = decision.unnamed, "undecided"
    if not kept and unnamed is None:  # at the noise without the names first, as `decide` does
        looked_at = (decision.naming.before, state)
        found = (significant(unnamed_terms(one)) for one in looked_at)
        unnamed = next((term for term in found if term is not None), None)
        state = unnamed.state if unnamed else state
    if not kept:
        outputs = {o for one in lost for o in outputs_of_name(one, state.nominal.catalogue)}
        seen = outputs & set(state.evidence.outputs)
        complete = all_harm and all(predictable(state, o) == 0.0 for o in seen)
        none = "nothing-missing" if complete else none
    verdict = verdict_of(kept, unnamed, none)
    return replace(decision, accepted=kept, state=state, verdict=verdict, unnamed=unnamed)
