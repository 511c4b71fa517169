"""The investigation of the logs of one table: locate, name, add, prove.

A function of logs and rig alone. The next experiment and the closed loop need protocols: the caller
asks for them with what `Investigation` holds.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from calibration.gap import hands
from calibration.gap.agreement import sentences, sizes_by_log
from calibration.gap.decision_rule import RIVAL_MARGIN
from calibration.gap.findings import Findings, Gap, Leftover, Named, ProofRow, Step
from calibration.gap.locate.locate import locate
from calibration.gap.model.clock import dated_to_s, even_ticks
from calibration.gap.model.data import Evidence, gather, usable
from calibration.gap.model.fit import evaluate
from calibration.gap.model.intervals import deviations
from calibration.gap.model.state import State, at_noise, plain
from calibration.gap.name.decide import Decision, verdict_of
from calibration.gap.name.load_friction import choose_friction_model, creeping_servos
from calibration.gap.name.naming_steps import NamingStep
from calibration.gap.name.stepwise import Accepted, Rival, settled_baseline
from calibration.gap.prove import floors, gap_of_one, model_of, prove, rms, steps
from calibration.gap.report import findings_of_decision, wording
from calibration.gap.unnamed import basis
from calibration.gap.unnamed.wording import describe, formula
from calibration.gap.veto import decide_by_proof
from calibration.linear_algebra import single_threaded
from rig.log import Log
from rig.parameters import Rig
from rig.plant.plant_record import pack
from rig.prediction.commanded import answers
from rig.prediction.innovations import Signals, noise

Progress = Callable[[str, int, int], None]  # stage, done, total
STAGES = ("locate", "name", "add", "prove", "next")


@dataclass(frozen=True, eq=False)
class Investigation:
    """The findings and the decision behind them; `decision` is None where the logs have too little
    motion."""

    findings: Findings
    decision: Decision | None = None

    @property
    def rivals(self) -> tuple[Accepted, Rival] | None:
        """The accepted effect and the rival that the logs separate from it least; None if every
        rival is behind by at least RIVAL_MARGIN."""
        accepted = self.decision.accepted if self.decision else ()
        close = [(one, r) for one in accepted for r in one.rivals if r.margin < RIVAL_MARGIN]
        return min(close, key=lambda pair: pair[1].margin) if close else None


@single_threaded
def investigate(
    logs: Sequence[Log],
    rig: Rig,
    *,
    notes: tuple[str, ...] = (),
    log_names: Sequence[str] = (),
    until: str = "prove",
    tolerances: Mapping[str, float] | None = None,
    quick: bool = False,
    threads: int = 1,
    progress: Progress | None = None,
) -> Investigation:
    """Locate, name, add and prove what the model of `rig` lacks, from `logs` of one table.

    `notes`: of the program that read the logs, put before those of the findings. `log_names`: of
    the logs in words, one each. `until`: the last stage to run, of STAGES. `tolerances`: effect ->
    half width of its first parameter [its unit], in place of those of rig and catalogue. `quick`:
    leaves out the regions, the sizes by log, and the rivals in the proof. `threads`: fits or
    predictions at a time. `progress`: called with (stage, done, total); the stage "name" tells what
    it does as "name: words".
    The answer depends on the logs, the rig and the options alone (`single_threaded`).

    `ValueError`: unknown stage.
    """
    if until not in STAGES:
        raise ValueError(f"stage '{until}'; known: {', '.join(STAGES)}")
    report = progress or (lambda stage, done, total: None)
    tolerances = {**rig.tolerances, **(tolerances or {})}
    row_s = max(map(dated_to_s, logs), default=0.0)
    runs = usable_runs(logs, rig)

    def begun(runs: Sequence[Signals]) -> tuple[State, tuple[str, ...]]:
        return _begun(gather(runs, levels_of(rig), threads=threads), rig, tolerances, row_s)

    report("baseline", 0, 1)
    still, slow = begun(runs)
    if again := sum(run.repeats for run in runs):
        lost = "as of a tracker that lost the ball"
        notes += (f"left out: {again} frames that repeat a place to the last digit, {lost}",)
    if wild := sum(run.outliers for run in runs):
        notes += (f"left out: {wild} frames in which the ball cannot have been where it was told",)
    notes += tuple(f"{p.replace('_', ' ')} only creeps: its volts are not judged" for p in slow)
    lacking = findings_of_decision.enough_motion(still)
    if lacking:
        return Investigation(_too_little_motion(still, lacking, notes))
    decision, refuted = _without_hands(
        *_decided(still, report), runs, lambda rest: _decided(begun(rest)[0], report)
    )
    notes += refuted
    report("name", len(NamingStep), len(NamingStep))
    report("add and prove", 0, 1)
    found = _findings(decision, until, notes, quick=quick)
    if not quick and until != "locate":
        by_log = sizes_by_log(decision.state, found.effects)
        told = found.notes + sentences(by_log, log_names)
        found = replace(found, by_log=by_log, notes=told)
    report("add and prove", 1, 1)
    return Investigation(found, decision)


def _begun(
    evidence: Evidence, rig: Rig, tolerances: Mapping[str, float], row_s: float
) -> tuple[State, tuple[str, ...]]:
    """The nominal model on the evidence, nothing fitted, and the servos that only creep, which
    weigh nothing in it."""
    nominal = choose_friction_model(evidence, rig, tolerances, row_s)
    slow = creeping_servos(evidence, nominal)
    evidence = replace(evidence, masks={p: m * (p not in slow) for p, m in evidence.masks.items()})
    fit = evaluate(evidence, nominal, {}, evidence.outputs)
    return State(evidence, nominal, fit), tuple(slow)


def _decided(still: State, report: Progress) -> tuple[Decision, tuple[str, ...]]:
    """`decide_by_proof` from the nominal model, before anything is fitted."""
    before = settled_baseline(still.evidence, still.nominal)
    report("baseline", 1, 1)
    steps = len(NamingStep)
    return decide_by_proof(before, lambda k, what: report(f"name: {what}", k, steps))


def _without_hands(
    decision: Decision,
    refuted: tuple[str, ...],
    runs: Sequence[Signals],
    decided: Callable[[Sequence[Signals]], tuple[Decision, tuple[str, ...]]],
) -> tuple[Decision, tuple[str, ...]]:
    """The decision on what no hand disturbed, where it counts (`hands`), and the reasons in words.
    `decision`, `refuted`: of all; `decided`: gives both for runs."""
    touches = hands.touches(decision)
    rest = hands.let_go(runs, touches) if touches is not None else []
    if touches is None or not rest:
        return decision, refuted
    of_rest, more = decided(rest)
    if not decision.accepted and of_rest.verdict == "nothing-missing":
        return decision, (*refuted, hands.CLEAN)
    if hands.counts(of_rest, decision):
        agreed, doubts = hands.agreed(of_rest, decision, touches)
        return agreed, (hands.note(touches), *more, *doubts)
    return decision, refuted if decision.accepted else (*refuted, hands.UNJUDGED)


def usable_runs(logs: Sequence[Log], rig: Rig) -> list[Signals]:
    """The signals of each log as the workflow uses them (`usable`), with the camera's delay and the
    walls of `rig`."""
    half = rig.linkage.side_m / 2
    reach = half - rig.ball.radius_m if rig.walls.present else inf
    camera = {"camera_delay_s": rig.camera.delay_s, "noise_m": rig.camera.noise_m}
    told = rig.servo.takes_angle
    runs = [usable(x, **camera, reach_m=reach, commanded=told) for x in logs]
    if told and (period_s := max(rig.servo.pair("period_s"))):
        runs = [replace(run, t_s=even_ticks(run.t_s, period_s)) for run in runs]
    return [_guessed(run, rig) for run in runs]


def _guessed(run: Signals, rig: Rig) -> Signals:
    """The run with the rig's servos' answer at the ticks for the angles that nobody measured."""
    if run.told_rad is None:
        return run
    t_s, angles = answers(pack(rig), run.t_s, run.told_rad)
    return replace(run, theta_rad=angles[np.searchsorted(t_s, run.t_s - 1e-9)])


def levels_of(rig: Rig) -> np.record:
    """Start levels of the noise (dtype NOISE): encoder count/sqrt(12) [rad], camera noise of the
    rig file, at least 1e-5 m."""
    return noise(
        servo_measured=rig.servo.encoder_step_rad / 12**0.5,
        ball_measured=max(rig.camera.noise_m, 1e-5),
    )


def _too_little_motion(state: State, lacking: str, notes: tuple[str, ...]) -> Findings:
    found = findings_of_decision.untestable(state, None)
    found = tuple(replace(one, why=lacking) for one in found)
    return Findings(
        "undecided",
        f"not enough excitation: {lacking}; nothing can be said about the model",
        untestable=found,
        notes=notes,
        rig_before=state.nominal.rig,
    )


def _findings(decision: Decision, until: str, notes: tuple[str, ...], *, quick: bool) -> Findings:
    state = decision.state
    spread = deviations(plain(state))
    names = tuple(findings_of_decision.named(decision, one, spread) for one in decision.accepted)
    names = findings_of_decision.one_dead_zone(names, state, spread)
    told = {name.name for name in names}
    if names:
        kept = [one for one in decision.accepted if one.name in told]
        decision = replace(decision, verdict=verdict_of(kept, decision.unnamed))
    servo = findings_of_decision.calibrated(state, spread)
    rig_after = findings_of_decision.extended(decision, names, servo)
    effects = names if decision.verdict != "undecided" else _with_rivals(decision, names)
    levels = state.evidence.levels
    known = Findings(
        decision.verdict,
        wording.sentence(decision, names, servo),
        effects=effects,
        unknown=_leftover(decision),
        untestable=findings_of_decision.untestable(state, decision.naming.screened),
        calibrated=servo,
        ranking=findings_of_decision.ranking(decision),
        notes=notes + wording.notes(decision, servo),
        noise={n: float(np.mean(levels[n])) for n in levels.dtype.names or ()},
        rig_before=state.nominal.rig,
        rig_after=rig_after,
    )
    if not quick:
        begun = at_noise(decision.naming.before, state.evidence.levels)
        place = locate(begun, rms(state.evidence, model_of(state)))
        known = replace(known, where=place.where, profiles=place.profiles, maps=place.maps)
    if until in ("locate", "name", "add"):
        return known
    gap, rows, path = _proof(decision, rivals=not quick)
    left = known.unknown
    if left is not None and decision.unnamed is not None and _holds(gap, left.channel):
        left = replace(left, formula=formula(decision.unnamed))
    farther = _farther(gap) if decision.unnamed is not None else ()
    return replace(
        known, gap=gap, proof=rows, steps=path, unknown=left, notes=farther + known.notes
    )


def _farther(gap: Gap) -> tuple[str, ...]:
    """The note on what errs more 1 s ahead with the unnamed term in the model; empty where nothing
    does."""
    errors = {"the ball": gap.ahead_1s_mm} | {
        output.replace("_", " "): sizes for output, sizes in gap.ahead_1s_deg.items()
    }
    worse = [who for who, sizes in errors.items() if sizes and sizes["after"] > sizes["before"]]
    if not worse:
        return ()
    return (
        f"what has no name is told by a shape that fits, not by a law: 1 s ahead on data not used, "
        f"{' and '.join(worse)} errs more with it",
    )


def _holds(gap: Gap, channel: str) -> bool:
    """True if the unnamed term closes 30 % of the channel's gap on held-out data."""
    before, after = gap.before.get(channel, 1.0), gap.after.get(channel, 1.0)
    return before - after > 0.3 * max(before - 1.0, 0.0) and before > after


def _proof(
    decision: Decision, *, rivals: bool
) -> tuple[Gap, tuple[ProofRow, ...], tuple[Step, ...]]:
    """The proof of the model as it came, the best rival, an unnamed term and the accepted effects,
    and the gaps along the path of additions."""
    state, levels = decision.state, decision.state.evidence.levels
    if decision.verdict == "nothing-missing":
        return gap_of_one(state), (), ()
    before = replace(decision.naming.before, evidence=state.evidence)
    models = {"nothing added": before}
    last = "nothing added"
    if decision.accepted:
        others = [r for r in decision.accepted[0].rivals if r.nameable] if rivals else []
        if others:
            models[f"best rival: {others[0].name}"] = others[0].state
        if rivals:
            models["unnamed term"] = basis.unnamed_terms(decision.naming.before)[0].state
        said = "supposed" if decision.verdict == "undecided" else "named"
        last = f"{said}: " + " + ".join(one.name for one in decision.accepted)
        models[last] = state
    elif decision.unnamed is not None:
        last = "unnamed term"
        models[last] = state
    proof = prove(models, last, levels)
    floor, _ = floors(state.nominal.rig, rms(state.evidence, model_of(state)))
    accepted = {one.name for one in decision.accepted}
    path = tuple(s for s in decision.naming.path if not s[0] or s[0] in accepted)
    if decision.unnamed is not None:
        path = (*path, ("an unnamed term", state))
    return proof.gap, proof.rows, steps(path, levels, floor)


def _with_rivals(decision: Decision, names: tuple[Named, ...]) -> tuple[Named, ...]:
    """The accepted effects, each followed by the rivals that the logs do not separate from it."""
    found: list[Named] = []
    by_name = {one.name: one for one in decision.accepted}
    for name in names:
        found.append(name)
        close = [r for r in by_name[name.name].rivals if r.margin < RIVAL_MARGIN]
        for rival in close:
            if rival.name not in {n.name for n in found}:
                spread = deviations(rival.state)
                axes = tuple(a for n, a in rival.state.named if n == rival.name)
                parameters = findings_of_decision.parameters(rival.state, rival.name, axes, spread)
                twins = findings_of_decision.twins_of(rival.name, rival.state.nominal.rig)
                share = (1.0 - name.probability) / len(close)
                found.append(Named(rival.name, share, twins, parameters))
    return tuple(found)


def _leftover(decision: Decision) -> Leftover | None:
    term, change = decision.unnamed, decision.change
    if term is None and change is not None:
        return Leftover(change.channel, wording.change_words(change))
    return Leftover(term.channel, describe(term)) if term else None
