"""A signal that the program cannot hear: compiled code that does not return keeps Python from
calling the handler, so that neither Ctrl-C nor SIGTERM would end it, or the compiler from leaving
by what it raises (`rig.loop.compiling`).

The system's part of a handler still runs: it writes the signal's number to a socket, which a thread
reads (`signal.set_wakeup_fd`).
"""

import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress

# Chosen: a call of a library that works on so long is given up as well; ten times what is usual.
UNHEARD_S = 10.0
LOOK_S = 0.05


def _deaf() -> None:
    """A copy of this process, as a lab's class makes and ends one, keeps its signals to itself."""
    with suppress(ValueError):  # no main thread
        signal.set_wakeup_fd(-1)


if hasattr(os, "register_at_fork"):  # Windows copies no process
    os.register_at_fork(after_in_child=_deaf)


@contextmanager
def ended_unheard(
    heard_s: Callable[[], float],
    handlers: Collection[object],
    say: Callable[[str], None],
    came: Callable[[int], None],
) -> Iterator[None]:
    """While inside, a signal of one of `handlers` that is not heard for UNHEARD_S ends the program
    at once, with the code 128 + its number, after a line to `say`. To be entered in the main
    thread.

    came: called at once with every such signal, in a thread: the main one may stand still, in a
    write to a disk that hangs. heard_s: when one of `handlers` heard one last, on the monotonic
    clock; signals of others are left alone. One in the UNHEARD_S before counts: two signals may
    come as one. Processes that look after a table level it as they see this one end.
    """
    reads, writes = socket.socketpair()
    writes.setblocking(False)
    thread = threading.Thread(
        target=_watch,
        args=(reads, heard_s, handlers, say, came),
        daemon=True,
        name="unheard signals",
    )
    before = signal.set_wakeup_fd(writes.fileno(), warn_on_full_buffer=False)
    thread.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        if thread.is_alive():  # not in a copy of this process that leaves by itself
            writes.shutdown(socket.SHUT_WR)  # a copy that lives on has this end, too
        writes.close()
        thread.join()
        reads.close()


def _watch(
    reads: socket.socket,
    heard_s: Callable[[], float],
    handlers: Collection[object],
    say: Callable[[str], None],
    came: Callable[[int], None],
) -> None:
    """Wait for signals until the other end is shut."""
    while numbers := reads.recv(64):
        known = [number for number in numbers if signal.getsignal(number) in handlers]
        for number in known:
            came(number)
        came_s = time.monotonic()
        enough_s = came_s - UNHEARD_S
        while known and heard_s() < enough_s and time.monotonic() < came_s + UNHEARD_S:
            time.sleep(LOOK_S)
        if known and heard_s() < enough_s:
            name = signal.Signals(known[0]).name
            with suppress(Exception):
                say(
                    f"ended by {name}, which compiled code did not hear for {UNHEARD_S:.0f} s (one "
                    "is being compiled, or an equation of an own effect does not return?); `rig "
                    "recover` mends a recording that was cut off"
                )
            os._exit(128 + known[0])
