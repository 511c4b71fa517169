"""Signals that end a program (SIGTERM, SIGHUP, console closed) as a stop of the running loop.

Their default is to end the process at once, with the last volts on. SIGINT stays Python's own
KeyboardInterrupt, which leaves every context on its way out, unless asked for.
"""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

from rig.loop.commands import Command, Stop

NAMES = ("SIGTERM", "SIGHUP", "SIGBREAK")


class StopSlot(Protocol):
    """What takes the stop: a `CommandSlot` or its like."""

    def put(self, command: Command) -> None:
        """Take a command."""
        ...


def _numbers(*names: str) -> list[int]:
    """The signals of these names that this system has and nobody ignores (nohup does)."""
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    return [number for number in numbers if signal.getsignal(number) != signal.SIG_IGN]


@contextmanager
def leave_on_signals(say: Callable[[str], None]) -> Iterator[None]:
    """While inside, the first signal of NAMES leaves every context and then the program.

    It raises SystemExit, 128 + its number, in the main thread, so that a table is left level at
    0 V; further ones are ignored meanwhile. say: gets a line for a person.
    """
    numbers = _numbers(*NAMES)

    def handle(number: int, _: object) -> None:
        for other in numbers:
            signal.signal(other, signal.SIG_IGN)
        say(f"ended by {signal.Signals(number).name}; what was recorded so far is kept")
        raise SystemExit(128 + number)

    before = {number: signal.signal(number, handle) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)


@contextmanager
def stop_on_signals(
    slot: StopSlot, *, also: tuple[str, ...] = (), leave: bool = True
) -> Iterator[None]:
    """Put a `Stop` into the slot for every signal of NAMES and `also` that comes while inside.

    On the way out the former handlers are back; with `leave` a signal that came then ends the
    program as it was meant to (KeyboardInterrupt; SystemExit, 128 + its number). In a thread other
    than the main one no signal can be handled, and nothing is done.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []

    def handle(number: int, _: object) -> None:
        came.append(number)
        name = signal.Signals(number).name
        reason = "by the operator" if name == "SIGINT" else f"{name} from the system"
        slot.put(Stop(reason, outcome="interrupted"))

    numbers = _numbers(*NAMES, *also)
    before = {number: signal.signal(number, handle) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
    if came and leave and came[0] == signal.SIGINT:
        raise KeyboardInterrupt
    if came and leave:
        raise SystemExit(128 + came[0])
