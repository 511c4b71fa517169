"""All calls into a foreign driver from one thread, each awaited for a limited time.

A vendor's call that never returns (a card unplugged under it) must not hold the loop for ever.
"""

from collections.abc import Callable
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any

Job = tuple[int, Callable[..., Any], tuple]


class OneThread:
    """A daemon thread, called `name`, in which functions are run in order."""

    def __init__(self, name: str) -> None:
        self._orders: SimpleQueue[Job | None] = SimpleQueue()
        self._answers: SimpleQueue[tuple[int, Any, BaseException | None]] = SimpleQueue()
        self._count = 0
        self._failed: BaseException | None = None
        # A daemon: what hangs in a driver must not keep the program from ending.
        Thread(target=self._work, name=name, daemon=True).start()

    def post(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Run the function in the thread without waiting for it.

        An error of it is raised by the next `call`, which does not run its own function then.
        """
        self._orders.put((0, function, arguments))

    def call(self, function: Callable[..., Any], *arguments: Any, patience_s: float) -> Any:
        """Run the function in the thread; return its result or raise its error.

        TimeoutError: no answer within `patience_s`.
        """
        self._count += 1
        self._orders.put((self._count, function, arguments))
        while True:
            try:
                number, value, error = self._answers.get(timeout=patience_s)
            except Empty:
                raise TimeoutError(f"no answer for {1000 * patience_s:.0f} ms") from None
            if number < self._count:  # of a call that was given up, as by Ctrl-C
                continue
            if error is not None:
                raise error
            return value

    def end(self) -> None:
        """Let the thread end when everything that it was given is done."""
        self._orders.put(None)

    def _work(self) -> None:
        while (order := self._orders.get()) is not None:
            number, function, arguments = order
            value = error = None
            if number and self._failed is not None:
                error, self._failed = self._failed, None
            else:
                try:
                    value = function(*arguments)
                except BaseException as raised:
                    error = raised
            if number:
                self._answers.put((number, value, error))
            elif error is not None:
                self._failed = error
