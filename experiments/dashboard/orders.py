"""One queue, one worker: callbacks of the page only put, so that nothing waits for a page.

What an order raises is told: to the page that gave it, and to whoever keeps the run's events.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from queue import Full, Queue

LONGEST = 256


@dataclass(frozen=True)
class Order:
    """Something to do, for the page that asked (None: the program itself)."""

    what: str
    do: Callable[[], None]
    page: int | None = None


class Orders:
    """Serves orders in turn in a thread of its own. `failed` hears what went wrong."""

    def __init__(self, failed: Callable[[Order, Exception], None]) -> None:
        self._failed = failed
        self._waiting: Queue[Order | None] = Queue(LONGEST)
        self._thread = threading.Thread(target=self._serve, daemon=True, name="orders")
        self._thread.start()

    def put(self, what: str, do: Callable[[], None], page: int | None = None) -> bool:
        """Enqueue, from any thread, at once; False where the queue is full and it is dropped."""
        try:
            self._waiting.put_nowait(Order(what, do, page))
        except Full:
            return False
        return True

    def close(self) -> None:
        """Serve what waits, then end."""
        self._waiting.put(None)
        self._thread.join(5.0)

    def _serve(self) -> None:
        while (order := self._waiting.get()) is not None:
            try:
                order.do()
            except Exception as error:
                self._failed(order, error)
