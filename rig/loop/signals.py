"""Signals that end a program (SIGTERM, SIGHUP, console closed) as a stop of the running loop.

Their default is to end the process at once, with the last volts on. SIGINT stays a
KeyboardInterrupt, which leaves every context on its way out, unless asked for. Either may be
swallowed on its way, by a callback of compiled code above all: it is remembered.
"""

import math
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import NoReturn, Protocol

from rig.loop.commands import Command, Stop
from rig.loop.compiling import compiles, when_compiled
from rig.loop.unheard import ended_unheard

NAMES = ("SIGTERM", "SIGHUP", "SIGBREAK")
AGAIN_S = 0.05  # after which what a callback swallowed is raised again; chosen: soon, and beyond it
LEAVING_S = 5.0  # chosen: ten times what levelling takes, in which no further signal disturbs it
_leaving: list[int] = []  # signals by which the program is to be left
_heard_s = [-math.inf]  # when a handler of ours ran last
_raised_s = [-math.inf]  # when one raised what leaves the program last
_handlers: list[object] = []  # ours
_slots: list[tuple[list[int], "StopSlot"]] = []  # of `stop_on_signals`, and their signals


class StopSlot(Protocol):
    """What takes the stop: a `CommandSlot` or its like."""

    def put(self, command: Command) -> None:
        """Take a command."""
        ...


def heeded(*names: str) -> list[int]:
    """The signals of these names that this system has and nobody ignores (nohup does)."""
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    return [number for number in numbers if signal.getsignal(number) != signal.SIG_IGN]


def stop_of(number: int) -> Stop:
    """The stop that a signal asks for."""
    name = signal.Signals(number).name
    reason = "by the operator" if name == "SIGINT" else f"{name} from the system"
    return Stop(reason, outcome="interrupted")


def end_by(number: int) -> NoReturn:
    """End the program as a signal was meant to: KeyboardInterrupt, or SystemExit, 128 + number."""
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    raise SystemExit(128 + number)


def stop_by(error: BaseException) -> Stop | None:
    """The stop of the signal by which `end_by` raised `error`; None: something else raised it."""
    if isinstance(error, KeyboardInterrupt):
        return stop_of(signal.SIGINT)
    code = error.code if isinstance(error, SystemExit) else None
    known = {128 + number: number for name in NAMES if (number := getattr(signal, name, 0))}
    return stop_of(known[code]) if isinstance(code, int) and code in known else None


@contextmanager
def leave_on_signals(say: Callable[[str], None]) -> Iterator[None]:
    """While inside, a signal of NAMES, or SIGINT, leaves every context and then the program.

    It raises SystemExit, 128 + its number (SIGINT: KeyboardInterrupt), in the main thread, so that
    a table is left level at 0 V and a recording has its ending; further ones within LEAVING_S
    change nothing, later ones do the same. What lies between may have swallowed that (an import, a
    destructor, a callback of compiled code do): it is raised again after AGAIN_S where Python tells
    of that (`sys.unraisablehook`), else where long work reports its progress (`leave_if_told`) and
    at the end, in place of a RuntimeError, too, of what was left in its midst; and no later run is
    begun (`stop_on_signals`). In numba's compiler it waits for the function that is compiled now
    (`rig.loop.compiling`). say: gets a line for a person; what it cannot say (to a terminal that
    is gone) is left out. It is called in the midst of anything, of an import too, so it must import
    nothing. A signal that nothing hears, since compiled code or the compiler does not return, ends
    the program (`rig.loop.unheard`).
    """
    _raised_s[0], is_told, timers = -math.inf, False, []
    tell = _Teller(say)

    def handle(number: int, _: object) -> None:
        nonlocal is_told
        if not compiles():  # else it is heard once the compiler is left
            _heard_s[0] = time.monotonic()
        _leaving.append(number)
        if time.monotonic() - _raised_s[0] < LEAVING_S:
            return
        _raised_s[0] = time.monotonic()
        if not is_told and number != signal.SIGINT:
            tell(number)
        is_told = False
        when_compiled(leave_if_told)

    def again() -> None:
        nonlocal is_told
        _raised_s[0], is_told = -math.inf, True
        if _leaving:
            timers.append(threading.Timer(AGAIN_S, signal.raise_signal, _leaving[-1:]))
            timers[-1].start()

    before = {number: signal.signal(number, handle) for number in heeded(*NAMES, "SIGINT")}
    _handlers.append(handle)
    try:
        watched = ended_unheard(lambda: _heard_s[0], _handlers, say, _stop_slots)
        with watched, _swallowed_in_silence(again), tell:
            yield
        leave_if_told()
    except Exception:  # code that wraps what it is left by: a pool, a lab's camera
        leave_if_told()
        raise
    finally:
        _raised_s[0] = time.monotonic()  # nothing is raised from here on
        for timer in timers:  # before the handlers are others'
            timer.cancel()
            timer.join()
        _handlers.remove(handle)
        _leaving.clear()
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)


class _Teller:
    """Says by which signal the program ends; a context that says it, where nobody did, of what
    leaves it by `end_by`: the handler of `stop_on_signals` tells nobody."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say, self._told = say, False

    def __call__(self, number: int) -> None:
        self._told = True
        with suppress(Exception):
            self._say(f"ended by {signal.Signals(number).name}; what was recorded so far is kept")

    def __enter__(self) -> None: ...

    def __exit__(self, kind: object, error: BaseException | None, _: object) -> None:
        code = error.code if isinstance(error, SystemExit) and stop_by(error) else None
        if isinstance(code, int) and not self._told:
            self(code - 128)


@contextmanager
def _swallowed_in_silence(again: Callable[[], None]) -> Iterator[None]:
    """While inside, what a handler raised and a callback swallowed gets no traceback; `again` is
    called in its place."""
    hook = sys.unraisablehook

    def show(unraisable: "sys.UnraisableHookArgs") -> None:
        if not issubclass(unraisable.exc_type, (KeyboardInterrupt, SystemExit)):
            hook(unraisable)
        elif threading.current_thread() is threading.main_thread():
            again()

    sys.unraisablehook = show
    try:
        yield
    finally:
        sys.unraisablehook = hook


def leave_if_told() -> None:
    """Leave the program by a signal of `leave_on_signals` that something swallowed."""
    if _leaving and threading.current_thread() is threading.main_thread():
        _heard_s[0] = _raised_s[0] = time.monotonic()
        end_by(_leaving[-1])


def _stop_slots(number: int) -> None:
    """Put the stop of a signal where it belongs; that of the handler itself comes later then."""
    for numbers, slot in tuple(_slots):
        if number in numbers:
            slot.put(stop_of(number))


@contextmanager
def stop_on_signals(
    slot: StopSlot, *, also: tuple[str, ...] = (), leave: bool = True
) -> Iterator[None]:
    """Put a `Stop` into the slot for every signal of NAMES and `also` that comes while inside, at
    once for one that came before, by which the program is to be left; in `leave_on_signals` also
    while the main thread stands still.

    On the way out the former handlers are back; with `leave` a signal that came then ends the
    program as it was meant to (KeyboardInterrupt; SystemExit, 128 + its number). In a thread other
    than the main one no signal can be handled, and nothing is done.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []

    def handle(number: int, _: object) -> None:
        _heard_s[0] = time.monotonic()
        came.append(number)
        slot.put(stop_of(number))

    numbers = heeded(*NAMES, *also)
    before = {number: signal.signal(number, handle) for number in numbers}
    _handlers.append(handle)
    for number in tuple(_leaving):
        handle(number, None)
    told = (numbers, slot)
    _slots.append(told)
    try:
        yield
    finally:
        _slots.remove(told)
        _handlers.remove(handle)
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
    if came and leave:
        _heard_s[0] = _raised_s[0] = time.monotonic()
        end_by(came[0])
