"""What a tab says while its work waits for other work of the same worker process."""

from experiments.dashboard.session.worker_process import WorkerProcess

WORK = {
    "calibration": "the step in the tab Calibrate",
    "gap": "the analysis in the tab Gap",
    "sheets": "the sheets to print",
}


def waits_for(worker: WorkerProcess, name: str) -> str:
    """What goes before the work of a name, as a sentence's end; "" where nothing does."""
    other = worker.goes_before(name)
    return f"waits for {WORK.get(other, other)} to end" if other else ""
