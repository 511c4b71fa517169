"""Numba's compiler at work, which no exception of a signal's handler may leave: LLVM has taken over
a module that Python still holds for its own for a moment, and both would free it (a segmentation
fault; `llvmlite.binding.linker.link_modules`).

It tells when it is done by events (`numba.core.event`), and holds a lock meanwhile. Numba is not
imported for this: where it is not there yet, it does not compile.
"""

import sys
import threading
from collections.abc import Callable
from typing import Any

COMPILED, UNLOCKED = "numba:compile", "numba:compiler_lock"


def compiles() -> bool:
    """Whether the calling thread is inside the compiler, or loads what it has compiled before."""
    lock: Any = getattr(sys.modules.get("numba.core.compiler_lock"), "global_compiler_lock", None)
    return lock is not None and lock.is_locked()


def when_compiled(call: Callable[[], None]) -> None:
    """Call at once, or, where the thread `compiles()`, once as soon as the function that is
    compiled now is done; those in which it stands are not waited for.

    call: what it raises leaves the compiler. Asked in a signal's handler, this imports nothing.
    """
    if not compiles():
        call()
        return
    event: Any = sys.modules["numba.core.event"]
    thread, kinds = threading.get_ident(), (COMPILED, UNLOCKED)

    class Done(event.Listener):
        def on_start(self, _: object) -> None:
            pass

        def on_end(self, ended: Any) -> None:
            is_done = ended.kind == COMPILED or not compiles()
            if is_done and threading.get_ident() == thread:
                for kind in kinds:
                    event.unregister(kind, self)
                call()

    listener = Done()
    for kind in kinds:
        event.register(kind, listener)
