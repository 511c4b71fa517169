"""From the logs of one table to the answer: locate, name, add, prove.

Pure: logs and a rig in, `Findings` out. The next experiment and the closed loop are asked for by
the caller, who knows the protocols.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.gap import answer, unknown, words
from calibration.gap.believe import believe, creeping
from calibration.gap.decide import Decision, decide
from calibration.gap.evidence import gather, usable
from calibration.gap.findings import Findings, Gap, Leftover, Named, ProofRow, Step
from calibration.gap.fit import evaluate
from calibration.gap.intervals import deviations
from calibration.gap.locate import locate
from calibration.gap.name import MARGIN, Accepted, Rival, settled_baseline
from calibration.gap.prove import floors, model_of, prove, rms, steps
from calibration.gap.state import State
from calibration.gap.unknown_words import describe, formula
from rig.log import Log
from rig.parameters import Rig
from rig.predict import Signals, noise

Progress = Callable[[str, int, int], None]


def silent(stage: str, done: int, total: int) -> None:
    """Progress that nobody wants to see."""


STAGES = ("locate", "name", "add", "prove", "next")


@dataclass(frozen=True, eq=False)
class Investigation:
    """The answer with what stands behind it, for the stages that need a simulator."""

    findings: Findings
    decision: Decision | None = None

    @property
    def rivals(self) -> tuple[Accepted, Rival] | None:
        """The name and the rival that the logs cannot tell apart, if there are two."""
        accepted = self.decision.accepted if self.decision else ()
        close = [(one, r) for one in accepted for r in one.rivals if r.margin < MARGIN]
        return min(close, key=lambda pair: pair[1].margin) if close else None


def investigate_logs(logs: Sequence[Log], rig: Rig, *, notes: tuple[str, ...] = (),
                     until: str = "prove", tolerances: Mapping[str, float] | None = None,
                     quick: bool = False, threads: int = 1,
                     progress: Progress = silent) -> Investigation:  # fmt: skip
    """Run the stages up to `until` on logs of one table under the believed rig.

    tolerances: name -> half width of the first key, over the catalogue's. quick: no rivals in the
    proof, and not where it is. ValueError: bad stage.
    """
    if until not in STAGES:
        raise ValueError(f"stage '{until}'; known: {', '.join(STAGES)}")
    progress("baseline", 0, 4)
    evidence = gather(usable_runs(logs, rig), levels_of(rig), threads=threads)
    tolerances = {**rig.tolerances, **(tolerances or {})}
    believed = believe(evidence, rig, tolerances)
    slow = creeping(evidence, believed)
    evidence = replace(evidence, masks={p: m * (p not in slow) for p, m in evidence.masks.items()})
    notes += tuple(f"{p.replace('_', ' ')} only creeps: its volts are not judged" for p in slow)
    still = State(evidence, believed, evaluate(evidence, believed, {}, evidence.parts))
    lacking = answer.enough_motion(still)
    if lacking:
        return Investigation(_nothing_to_see(still, lacking, notes))
    before = settled_baseline(evidence, believed)
    progress("name", 1, 4)
    decision = decide(before)
    progress("add and prove", 3, 4)
    return Investigation(_findings(decision, until, notes, quick=quick), decision)


def usable_runs(logs: Sequence[Log], rig: Rig) -> list[Signals]:
    return [usable(log, camera_delay_s=rig.camera.delay_s) for log in logs]


def levels_of(rig: Rig) -> np.record:
    """Noise levels to start from: an encoder's count over sqrt(12), the believed camera."""
    return noise(
        servo_measured=rig.servo.encoder_step_rad / 12**0.5,
        ball_measured=max(rig.camera.noise_m, 1e-5),
    )


def _nothing_to_see(state: State, lacking: str, notes: tuple[str, ...]) -> Findings:
    found = answer.untestable(state, None)
    found = tuple(replace(one, why=lacking) for one in found)
    return Findings(
        "undecided", f"not enough excitation: {lacking}; nothing can be said about the model",
        untestable=found, notes=notes, rig_before=state.believed.rig,
    )  # fmt: skip


def _findings(decision: Decision, until: str, notes: tuple[str, ...], *, quick: bool) -> Findings:
    state = decision.state
    spread = deviations(state)
    names = tuple(answer.named(decision, one, spread) for one in decision.accepted)
    names = answer.one_dead_zone(names, state, spread)
    told = {name.name for name in names}
    if decision.verdict == "undecided" and not any(
        one.margin < MARGIN for one in decision.accepted if one.name in told
    ):
        decision = replace(decision, verdict="named")
    servo = answer.calibrated(state, spread)
    rig_after = answer.extended(decision, names, servo)
    effects = names if decision.verdict != "undecided" else _with_rivals(decision, names)
    levels = state.evidence.levels
    known = Findings(
        decision.verdict,
        words.sentence(decision, names),
        effects=effects,
        unknown=_leftover(decision),
        untestable=answer.untestable(state, decision.naming.screened),
        calibrated=servo,
        ranking=answer.ranking(decision),
        notes=notes + words.notes(decision, servo),
        noise={n: float(np.mean(levels[n])) for n in levels.dtype.names or ()},
        rig_before=state.believed.rig,
        rig_after=rig_after,
    )
    if not quick:
        place = locate(decision.naming.before, rms(state.evidence, model_of(state)),
                       evidence=state.evidence)  # fmt: skip
        known = replace(known, where=place.where, profiles=place.profiles, maps=place.maps)
    if until in ("locate", "name", "add"):
        return known
    gap, rows, path = _proof(decision, rivals=not quick)
    left = known.unknown
    if left is not None and decision.shape is not None and _holds(gap, left.channel):
        left = replace(left, formula=formula(decision.shape))
    return replace(known, gap=gap, proof=rows, steps=path, unknown=left)


def _holds(gap: Gap, channel: str) -> bool:
    """Does the model with the term do clearly better on data that its fit has not seen?"""
    before, after = gap.before.get(channel, 1.0), gap.after.get(channel, 1.0)
    return before - after > 0.3 * max(before - 1.0, 0.0) and before > after


def _proof(
    decision: Decision, *, rivals: bool
) -> tuple[Gap, tuple[ProofRow, ...], tuple[Step, ...]]:
    """Judge nothing, the best rival, an unnamed term and the names; the path between them."""
    state, levels = decision.state, decision.state.evidence.levels
    if decision.verdict == "nothing-missing":
        left = rms(state.evidence, model_of(state))
        floor, label = floors(state.believed.rig, left)
        gaps = {channel: left[channel] / floor[channel] for channel in left}
        return Gap(gaps, gaps, label, False, floor), (), ()
    before = replace(decision.naming.before, evidence=state.evidence)
    models = {"nothing added": before}
    last = "nothing added"
    if decision.accepted:
        others = decision.accepted[0].rivals if rivals else ()
        if others:
            models[f"best rival: {others[0].name}"] = others[0].state
        if rivals:
            models["unnamed term"] = unknown.shapes(decision.naming.before)[0].state
        last = "named: " + " + ".join(one.name for one in decision.accepted)
        models[last] = state
    elif decision.shape is not None:
        last = "unnamed term"
        models[last] = state
    proof = prove(models, last, levels)
    floor, _ = floors(state.believed.rig, rms(state.evidence, model_of(state)))
    accepted = {one.name for one in decision.accepted}
    path = tuple(s for s in decision.naming.path if not s[0] or s[0] in accepted)
    if decision.shape is not None:
        path = (*path, ("an unnamed term", state))
    return proof.gap, proof.rows, steps(path, levels, floor)


def _with_rivals(decision: Decision, names: tuple[Named, ...]) -> tuple[Named, ...]:
    """The accepted names, each followed by the rivals that the log cannot tell from it."""
    found: list[Named] = []
    by_name = {one.name: one for one in decision.accepted}
    for name in names:
        found.append(name)
        close = [r for r in by_name[name.name].rivals if r.margin < MARGIN]
        for rival in close:
            if rival.name not in {n.name for n in found}:
                spread = deviations(rival.state)
                axes = tuple(a for n, a in rival.state.named if n == rival.name)
                parameters = answer.parameters(rival.state, rival.name, axes, spread)
                twins = answer.TWINS.get(rival.name, ())
                share = (1.0 - name.probability) / len(close)
                found.append(Named(rival.name, share, twins, parameters))
    return tuple(found)


def _leftover(decision: Decision) -> Leftover | None:
    shape = decision.shape
    return Leftover(shape.channel, describe(shape)) if shape else None
