"""`rig gap`: read the logs, run the workflow, add what needs a simulator or a menu of protocols."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from threadpoolctl import threadpool_limits

from calibration.gap.findings import Findings
from calibration.gap.workflow import investigate_logs
from experiments.console import ProgressCall, silent
from experiments.gap_input import read_evidence


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
    """The answer for logs of one table. quick: without closed loop and next experiment.

    ValueError, FileNotFoundError (one line): bad input, see `gap_input.read_evidence`.
    """
    inputs = read_evidence(list(paths), rig_file)
    stage = "prove" if quick and until == "next" else until
    with threadpool_limits(1):  # small matrices: threads of the linear algebra only get in the way
        found = investigate_logs(
            inputs.logs, inputs.rig, notes=inputs.notes, until=stage, tolerances=tolerances,
            quick=quick, threads=threads, progress=progress,
        )  # fmt: skip
    return replace(found.findings)
