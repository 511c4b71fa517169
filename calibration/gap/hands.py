"""A hand at the ball: what it did is told, and the rest of the recording is asked without it.

A recording that somebody touched holds two things that are not the model: the hand, and what the
model lacks. The first shows as short pushes at several times (`calibration.gap.unnamed.forces`).
Nothing can be proved beside it: a prediction that a hand spoils is as wrong with a name as without.
So what was seen during the pushes is left out, as it is where a recording tells of them, and the
rest is asked anew. Its answer counts where its model predicts the rest's ball better 1 s ahead than
that of the whole, for certain; if not, the answer to the whole stands. So it does where nothing is
missing in the rest, since an effect may look like pushes. A single push, and a ball that is seen on
one axis alone, are asked about as they are: there are no pushes to leave out.

The rest was chosen by the misfit of a model, and may hold what a hand did before and after the
pushes that were seen. A name that the whole did not tell is certain only if it holds where hands
were farthest. On the half of the rest's exposures that lie farthest from any push, fitted and
predicted on them alone, the ball has to be predicted better 1 s ahead with it than without, for
certain. And no hand may be at work there, too: with all names, no error is so large that noise
alone reaches it in fewer than 1 of CHANCE_ONE_IN such halves.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from calibration.gap.decision_rule import CHANCE_ONE_IN, SURE_Z
from calibration.gap.harm import keys_of_name
from calibration.gap.held_out import gained, held_out
from calibration.gap.model.data import Evidence
from calibration.gap.model.parameters import BALL
from calibration.gap.model.state import State, drop_effects
from calibration.gap.name.decide import Decision, verdict_of
from calibration.gap.name.stepwise import Accepted
from calibration.gap.prove import model_of, unexpected
from calibration.gap.unnamed.along import WINDOWS_S
from calibration.gap.unnamed.term import UnnamedTerm
from calibration.gap.unnamed.wording import when
from rig.prediction.innovations import Signals

# Chosen: longer than a hand takes to catch a ball, push it or put it back, shorter than wind lasts.
LONGEST_S = 3.0
MARGIN_S = WINDOWS_S[0]  # the shortest push that is looked for: begins and ends are no surer
FEWEST = 0.5  # share of a run's exposures that has to be left; chosen


def touches(decision: Decision) -> UnnamedTerm | None:
    """The short ones of the pushes that a decision left without a name; None: there are none."""
    term = decision.unnamed
    if term is None or term.kind != "pushes":
        return None
    short = [
        (window, run)
        for window, run in zip(term.windows_s, term.runs, strict=True)
        if window[1] - window[0] < LONGEST_S
    ]
    windows, runs = zip(*short, strict=True) if short else ((), ())
    return replace(term, windows_s=windows, runs=runs) if short else None


def let_go(runs: Sequence[Signals], term: UnnamedTerm) -> list[Signals]:
    """The runs without the exposures of the pushes; none where one would keep too few."""
    found = []
    for i, run in enumerate(runs):
        own = [w for w, of in zip(term.windows_s, term.runs, strict=True) if of == i]
        found.append(_without(run, own))
    enough = (
        len(a.exposed_s) >= FEWEST * len(b.exposed_s) for a, b in zip(found, runs, strict=True)
    )
    return found if all(enough) else []


def _without(run: Signals, windows_s: Sequence[tuple[float, float]]) -> Signals:
    """The run without what was seen in some windows, after which the ball's filter starts anew."""
    t = run.exposed_s
    touched = np.zeros(len(t), bool)
    for begin, end in windows_s:
        touched |= (t > begin - MARGIN_S) & (t < end + MARGIN_S)
    fresh = np.zeros(len(t), bool) if run.fresh is None else run.fresh.copy()
    fresh[1:] |= touched[:-1] & ~touched[1:]
    kept = ~touched
    return replace(run, exposed_s=t[kept], ball_m=run.ball_m[kept], fresh=fresh[kept])


def counts(rest: Decision, whole: Decision) -> bool:
    """Whether the ball of the rest is predicted better by the model of its own decision than by
    that of the decision on the whole, fitted to it anew."""
    if BALL not in rest.state.evidence.outputs:
        return False
    before = replace(whole.state, evidence=rest.state.evidence)
    without, with_it = (held_out(state, (BALL,)) for state in (before, rest.state))
    if BALL not in without:
        return False
    d, se = gained(without[BALL], with_it[BALL])
    return d > SURE_Z * se


def agreed(rest: Decision, whole: Decision, term: UnnamedTerm) -> tuple[Decision, tuple[str, ...]]:
    """The decision on the rest in which a name that the selection on the whole did not find is
    certain only by the module's proof far from the pushes; and the reasons in words."""
    known = {one.name for one in whole.naming.accepted}
    doubtful = [
        one
        for one in rest.accepted
        if one.name not in known and not _holds_far_away(rest.state, one, term)
    ]
    accepted = tuple(one.doubted() if one in doubtful else one for one in rest.accepted)
    reasons = tuple(
        f"not certain: {one.name}: the whole does not tell it, nor the half farthest from the hand"
        for one in doubtful
    )
    verdict = verdict_of(accepted, rest.unnamed) if accepted else rest.verdict
    return replace(rest, accepted=accepted, verdict=verdict), reasons


def _holds_far_away(state: State, one: Accepted, term: UnnamedTerm) -> bool:
    """Whether a name predicts the ball better by the module's proof far from the pushes."""
    far = replace(state, evidence=far_away(state.evidence, term))
    without = drop_effects(far, keys_of_name(one))
    before, after = (held_out(model, (BALL,)) for model in (without, far))
    if BALL not in before:
        return False
    d, se = gained(before[BALL], after[BALL])
    squares = unexpected(far.evidence, model_of(far))
    return d > SURE_Z * se and bool(squares.max() < chi2.isf(1.0 / CHANCE_ONE_IN / len(squares), 1))


def far_away(evidence: Evidence, term: UnnamedTerm) -> Evidence:
    """The evidence with the weights of the ball on the half of its rows farthest from any push."""
    (t, run), mask = evidence.times(BALL), evidence.masks[BALL]
    away = np.full(len(t), np.inf)
    for (begin, end), of in zip(term.windows_s, term.runs, strict=True):
        apart = np.maximum(np.maximum(begin - t, t - end), 0.0)
        away = np.where(run == of, np.minimum(away, apart), away)
    used = mask > 0
    kept = away >= np.median(away[used]) if used.any() else used
    return replace(evidence, masks=evidence.masks | {BALL: mask * kept})


UNJUDGED = (
    "beside the pushes nothing else can be judged: write in a column push when the ball was "
    "touched, or leave them out with --from"
)


CLEAN = "without the pushes, nothing is missing in the rest"


def note(term: UnnamedTerm) -> str:
    """What was left out, in words."""
    return f"the ball was pushed {when(term.windows_s)}, as by a hand: left out"
