"""The command line `rig`. Imports nothing of it until `main` is asked for."""

import atexit
import os
import signal
import sys
import time
from contextlib import suppress
from typing import TextIO

ENDING_S = 5.0  # chosen: as `rig.loop.signals.LEAVING_S`; later ones end the program at once
_ended_s: list[float] = []  # when the command was done


def main() -> None:
    """Run `rig` with the arguments of this process, which ends with the command's exit code.

    A signal that comes where no command hears it, in the midst of the imports, ends the program
    without a traceback, 128 + its number; one that comes as it ends already changes nothing.
    """
    names = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    for number in numbers:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _end)
        # Python's own end gives every signal with a handler its default back.
        atexit.register(signal.signal, number, signal.SIG_IGN)
    # Arrow's own pool reserves 1 GB of addresses, which a limit (ulimit -v) may not leave.
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
    # A process that is started would execute what lies in the working folder, which may be somebody
    # else's, under a name of Python's own, such as pickle.py.
    os.environ.setdefault("PYTHONSAFEPATH", "1")
    try:
        from experiments.cli.application import main as run

        run()
    finally:
        _ended_s.append(time.monotonic())
        _let_go(sys.stderr)


def _let_go(errors: TextIO | None) -> None:
    """Drop what standard error does not take, as nobody reads it: Python would try once more as it
    ends, and end with a code of its own (120)."""
    if errors is None:
        return
    try:
        errors.flush()
    except (OSError, ValueError):
        with suppress(OSError, ValueError):
            nothing = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nothing, errors.fileno())
            os.close(nothing)


def _end(number: int, _: object) -> None:
    if not _ended_s:
        with suppress(OSError):
            os.write(2, f"rig: ended by {signal.Signals(number).name}\n".encode())
        sys.exit(128 + number)
    if time.monotonic() - _ended_s[0] > ENDING_S:
        os._exit(128 + number)
