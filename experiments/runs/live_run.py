"""Record a run whose loop has its own process: rows are drained as they come, jitter is noted."""

from __future__ import annotations

from typing import TYPE_CHECKING

from experiments.recording import Recorder
from rig.loop import Ending
from rig.loop_process import Job, LoopProcess
from rig.stopping import stop_on_signals

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np


def record_live(
    job: Job,
    recorder: Recorder,
    *,
    started: Callable[[LoopProcess], None] = lambda loop: None,
    watch: Callable[[np.ndarray], None] = lambda row: None,
) -> Ending:
    """Run the job and finish the recording with its ending; run.json gets "loop" with the jitter
    histogram, what real time was granted, and how many rows the ring lost.

    started: gets the process, whose `put` takes commands; watch: sees every row. What the recorder
    or these raise (a full disk) stops the loop and is raised again. SIGTERM and Ctrl-C end the run
    in order and then the program.
    """
    loop = LoopProcess(job)

    def keep(row: np.ndarray) -> None:
        recorder.append(row)
        watch(row)

    with stop_on_signals(loop, also=("SIGINT",)):
        try:
            started(loop)
            ending = loop.run(keep, recorder.event)
        except BaseException as error:
            recorder.give_up(error, loop=loop.notes)
            raise
        recorder.finish(ending.outcome, ending.reason, loop=loop.notes)
    return ending
