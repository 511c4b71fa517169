"""`rig gap`: read the logs, run the workflow, add what needs a simulator or a menu of protocols."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from threadpoolctl import threadpool_limits

from calibration.gap.answer import effects_of
from calibration.gap.findings import ClosedLoopRow, Findings, NextExperiment
from calibration.gap.next_experiment import propose
from calibration.gap.workflow import Investigation, investigate_logs
from experiments.closed_loop_proof import closed_loop_rows
from experiments.console import ProgressCall, silent
from experiments.gap_input import GapInput, read_evidence
from experiments.gap_menu import experiment_menu


def investigate(
    paths: Sequence[Path],
    rig_file: Path | None = None,
    *,
    quick: bool = False,
    until: str = "next",
    tolerances: Mapping[str, float] | None = None,
    threads: int = 1,
    progress: ProgressCall = silent,
) -> Findings:
    """The answer for logs of one table. quick: without the closed loop and where the gap is.

    ValueError, FileNotFoundError (one line): bad input, see `gap_input.read_evidence`.
    """
    inputs = read_evidence(list(paths), rig_file)
    stage = "prove" if quick and until == "next" else until
    with threadpool_limits(1):  # small matrices: threads of the linear algebra only get in the way
        found = investigate_logs(
            inputs.logs, inputs.rig, notes=inputs.notes, until=stage, tolerances=tolerances,
            quick=quick, threads=threads, progress=progress,
        )  # fmt: skip
        if quick and until == "next" and found.rivals is not None:
            return replace(found.findings, next_experiment=_next(found, inputs))
        if quick or stage not in ("prove", "next"):
            return found.findings
        progress("closed loop and next experiment", 3, 4)
        answer = replace(found.findings, closed_loop=_closed_loop(inputs, found.findings))
        if stage == "next" and found.rivals is not None:
            answer = replace(answer, next_experiment=_next(found, inputs))
        progress("closed loop and next experiment", 4, 4)
        return answer


def _closed_loop(inputs: GapInput, found: Findings) -> tuple[ClosedLoopRow, ...]:
    """The recorded protocol under both models, where something was added."""
    if found.rig_before is None or found.rig_after is None or not found.effects:
        return ()
    return closed_loop_rows(inputs, found.rig_before, found.rig_after)


def _next(found: Investigation, inputs: GapInput) -> NextExperiment | None:
    """The protocol that would tell the two closest names apart."""
    pair = found.rivals
    if pair is None or found.decision is None:
        return None
    one, rival = pair
    states = ((one.name, found.decision.state), (rival.name, rival.state))
    effects = [effects_of(state, name) for name, state in states]
    ball = any(log.has("ball_x_m") or log.has("ball_y_m") for log in inputs.logs)
    rig = found.findings.rig_before or inputs.rig
    return propose(rig, (effects[0], effects[1]), experiment_menu(rig, ball=ball))
