"""A simulated run with a lab's own controller, which may hang, leave or crash the program."""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.records.recording import recover
from experiments.runs.runner import FinishedRun, RunRequest, run
from rig.control.user_controller import CONTROL_S, END_S, START_S
from rig.foreign_trial import LeftError, Tells, in_copy, standard_error
from rig.loop.loop import Ending, ending_of
from rig.loop.signals import end_by, stop_of

# Beyond the bounds that hold within Python, so that they name the failure where they can.
GRACE_S = 1.0  # chosen, as of the loop's process
PATIENCE_S = {"start": START_S, "control": CONTROL_S, "end": END_S}


def run_own(request: RunRequest, *, progress: Callable[[float], None]) -> FinishedRun:
    """`runner.run` in a copy of this process; the controller's prints go to standard error.

    A controller that leaves or crashes that copy, or hangs even in compiled code, ends the run as
    one that raises an error does, "aborted"; one that signals do not stop is "interrupted" by
    force. The rows are kept. Errors as of `runner.run`; ValueError: the controller left as it was
    loaded.
    """
    folder: list[Path] = []

    def heard(told: Any) -> None:
        folder.append(told) if isinstance(told, Path) else progress(told)

    def left(error: LeftError) -> FinishedRun:
        ending = Ending("aborted", str(error))
        if error.number:
            stop = stop_of(error.number)
            ending = Ending(stop.outcome, f"{stop.reason}; {error}")
        if folder:
            recover(folder[-1], ending.outcome, ending.reason)
        if error.number:
            end_by(error.number)
        if not folder:
            raise ValueError(f"{error}: correct its file") from None
        return FinishedRun(folder[-1], ending, np.empty((0, 5)))

    work = partial(_run, request)
    try:
        return in_copy(work, heard=heard, output=standard_error, passes_on=True, left=left)
    except Exception as error:  # of the copy alone, of which the controller took files or modules
        ending = ending_of(error)
        with suppress(OSError, ValueError):
            if folder:
                recover(folder[-1], ending.outcome, ending.reason)
        raise


def _run(request: RunRequest, tells: Tells) -> FinishedRun:
    name = f"controller {request.protocol.controller.rpartition(':')[2]}"

    def called(method: str) -> None:
        if method:
            tells.begins(f"{name}.{method}", PATIENCE_S[method] + GRACE_S)
        else:
            tells.begins("the run", None)

    tells.begins(name, None)
    return run(request, progress=tells.say, begun=tells.say, called=called)
