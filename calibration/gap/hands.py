"""A hand at the ball: what it did is told, and the rest of the recording is asked without it.

A recording that somebody touched holds two things that are not the model: the hand, and what the
model lacks. The first shows as short pushes at several times (`calibration.gap.unnamed.forces`).
Nothing can be proved beside it: a prediction that a hand spoils is as wrong with a name as without.
So what was seen during the pushes is left out, as it is where a recording tells of them, and the
rest is asked anew. Its answer counts where its model predicts the rest's ball better 1 s ahead than
that of the whole, for certain; if not, the answer to the whole stands. A single push, and a ball
that is seen on one axis alone, are asked about as they are: there are no pushes to leave out.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibration.gap.decision_rule import SURE_Z
from calibration.gap.held_out import gained, held_out
from calibration.gap.model.parameters import BALL
from calibration.gap.name.decide import Decision, verdict_of
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


def agreed(rest: Decision, whole: Decision) -> tuple[Decision, tuple[str, ...]]:
    """The decision on the rest in which a name is certain only where the selection on the whole
    found it as well, hand or not; and the reasons in words. The rest was chosen by the misfit of a
    model, and still holds what a hand did before and after.
    """
    known = {one.name for one in whole.naming.accepted}
    accepted = tuple(one if one.name in known else one.doubted() for one in rest.accepted)
    reasons = tuple(
        f"not certain: {one.name}: only the part without the hand tells it"
        for one in accepted
        if one.name not in known
    )
    verdict = verdict_of(accepted, rest.unnamed) if accepted else rest.verdict
    return replace(rest, accepted=accepted, verdict=verdict), reasons


UNJUDGED = (
    "beside the pushes nothing else can be judged: write in a column push when the ball was "
    "touched, or leave them out with --from"
)


def note(term: UnnamedTerm) -> str:
    """What was left out, in words."""
    return f"the ball was pushed {when(term.windows_s)}, as by a hand: left out"
