"""What a tab says while its work waits for other work of the same worker process."""

from experiments.dashboard.session.worker_process import WorkerProcess

WORK = {
    "calibration": "the step of the tab Calibrate that is on",
    "gap": "the analysis of the tab Gap, which takes minutes,",
    "sheets": "the sheets to print",
}


def waits_for(worker: WorkerProcess, name: str) -> str:
    """What goes before the work of a name, as a sentence's end; "" where nothing does."""
    other = worker.goes_before(name)
    return f"waits until {WORK.get(other, other)} has ended" if other else ""
