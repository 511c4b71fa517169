"""Record a run whose loop has its own process: rows are drained as they come, jitter is noted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from experiments.records.recording import Recorder
from experiments.records.run_folder import lost_words
from rig.loop.commands import BY_HAND
from rig.loop.job import Job
from rig.loop.loop import Ending
from rig.loop.process import LoopProcess
from rig.loop.signals import stop_on_signals

if TYPE_CHECKING:
    import numpy as np


def record_live(
    job: Job,
    recorder: Recorder,
    *,
    started: Callable[[LoopProcess], None] = lambda loop: None,
    watch: Callable[[np.ndarray], None] = lambda row: None,
) -> Ending:
    """Run the job in a process of its own, record its rows, and return how it ended.

    run.json gets "loop" with the jitter histogram, the real-time rights granted, and the number of
    rows that the ring lost, which an event and the reason of the ending tell, too. started: called
    with the process, whose `put` takes commands; watch: called with every row (len(COLUMNS,)). An
    exception of the recorder (a full disk) or of these two stops the loop and is raised again.
    SIGTERM and Ctrl-C end first the run in order, then the program.
    """
    loop = LoopProcess(job)

    last_s = 0.0

    def keep(row: np.ndarray) -> None:
        nonlocal last_s
        recorder.append(row)
        last_s = float(row[0])
        watch(row)

    with stop_on_signals(loop, also=("SIGINT",)):
        try:
            started(loop)
            ending = loop.run(keep, recorder.event)
        except BaseException as error:
            recorder.give_up(error, loop=loop.notes)
            raise
        if lost := lost_words({"loop": loop.notes}):
            recorder.event(last_s, lost)
            ending = replace(ending, reason="; ".join(filter(None, (ending.reason, lost))))
        recorder.finish(ending.outcome, ending.reason, loop=loop.notes)
    return ending


class AnnouncingRecorder(Recorder):
    """Recorder that also passes every event on and calls a function at the end.

    say: called with the time [s] and text of an event, for a person at the table or a page; at_end:
    called before the recording is finished. run.json gets "by_hand", what somebody did to the run
    ("12.3 s: push to the left, 0.15 m/s"), where anybody did.
    """

    say: Callable[[float, str], None] = staticmethod(lambda t_s, text: None)
    at_end: Callable[[], None] = staticmethod(lambda: None)

    def __init__(self, folder: Path | str, start: dict) -> None:
        super().__init__(folder, start)
        self._by_hand: list[str] = []

    def event(self, t_s: float, text: str, **data) -> None:
        """Record an event at t_s [s] and pass its text to `say`."""
        super().event(t_s, text, **data)
        if text.startswith(BY_HAND):
            self._by_hand.append(f"{t_s:.1f} s: {text.removeprefix(BY_HAND)}")
        self.say(t_s, text)

    def finish(self, outcome: str, reason: str = "", **notes) -> None:
        """Call `at_end`, then finish the recording; arguments and errors as of
        `Recorder.finish`.
        """
        self.at_end()
        if self._by_hand:
            notes["by_hand"] = self._by_hand
        super().finish(outcome, reason, **notes)
