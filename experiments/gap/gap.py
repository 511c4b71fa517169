"""`rig gap`: read the logs, run the workflow, add what needs a simulator or a menu of protocols."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from calibration.gap.findings import ClosedLoopRow, Findings, NextExperiment
from calibration.gap.investigation import Investigation
from calibration.gap.investigation import investigate as investigate_logs
from calibration.gap.next_experiment import propose
from calibration.gap.report.findings_of_decision import effects_of
from calibration.linear_algebra import single_threaded
from experiments.gap.closed_loop_proof import closed_loop_rows
from experiments.gap.input import GapInput, read_evidence
from experiments.gap.protocol_choices import experiment_menu
from experiments.gap.words import farther_note
from experiments.progress import ProgressCall, silent


@single_threaded
def investigate(
    paths: Sequence[Path],
    rig_file: Path | None = None,
    *,
    quick: bool = False,
    from_s: float = 0.0,
    until: str = "next",
    tolerances: Mapping[str, float] | None = None,
    threads: int = 1,
    progress: ProgressCall = silent,
) -> Findings:
    """Findings for the log files of one table, as `rig gap` reports them.

    paths: run folders or log files; rig_file: the nominal model, None to take that of the run
    folders, else the default table. until, tolerances, threads and progress as of
    `calibration.gap.investigate`; quick: also leaves out the closed loop; from_s: of files, what is
    left out at their beginning [s]. FileNotFoundError, ValueError (one line): bad input, see
    `experiments.gap.input.read_evidence`.
    """
    inputs = read_evidence(list(paths), rig_file, from_s)
    stage = "prove" if quick and until == "next" else until
    found = investigate_logs(
        inputs.logs,
        inputs.rig,
        notes=inputs.notes,
        log_names=inputs.names,
        until=stage,
        tolerances=tolerances,
        quick=quick,
        threads=threads,
        progress=progress,
    )
    if quick and until == "next" and found.rivals is not None:
        return replace(found.findings, next_experiment=_next(found, inputs))
    if quick or stage not in ("prove", "next"):
        return found.findings
    progress("closed loop and next experiment", 0, 1)
    loop = _closed_loop(inputs, found.findings)
    told = farther_note(loop) + found.findings.notes  # the gravest first
    answer = replace(found.findings, closed_loop=loop, notes=told)
    if stage == "next" and found.rivals is not None:
        answer = replace(answer, next_experiment=_next(found, inputs))
    progress("closed loop and next experiment", 1, 1)
    return answer


def _closed_loop(inputs: GapInput, found: Findings) -> tuple[ClosedLoopRow, ...]:
    """The recorded protocol simulated under both models, where something was added."""
    if found.rig_before is None or found.rig_after is None or not found.effects:
        return ()
    return closed_loop_rows(inputs, found.rig_before, found.rig_after)


def _next(found: Investigation, inputs: GapInput) -> NextExperiment | None:
    """The protocol that would separate the two closest names."""
    pair = found.rivals
    if pair is None or found.decision is None:
        return None
    one, rival = pair
    states = ((one.name, found.decision.state), (rival.name, rival.state))
    effects = [effects_of(state, name) for name, state in states]
    ball = any(log.has("ball_x_m") or log.has("ball_y_m") for log in inputs.logs)
    rig = found.findings.rig_before or inputs.rig
    return propose(rig, (effects[0], effects[1]), experiment_menu(rig, ball=ball))
