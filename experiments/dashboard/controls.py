"""Buttons and inputs behind the seat: a callback enqueues; the one worker checks, clamps, acts."""

import time
from collections.abc import Callable
from typing import Any, TypeVar

from experiments.dashboard.orders import Order, Orders
from experiments.dashboard.seat import Seat

T = TypeVar("T")
AGAIN_S = 4.0  # so soon the same refusal is not told again


class WatchingError(PermissionError):
    """The page does not hold the controls."""


class Controls:
    """What a page's wish has to pass: the queue, the seat, the clamp.

    `tell` shows a page (None: all pages) a title and a sentence; `note` keeps a line in the events.
    """

    def __init__(
        self, tell: Callable[[int | None, str, str], None], note: Callable[[str], None]
    ) -> None:
        self.seat = Seat()
        self._tell, self._note = tell, note
        self._told: tuple[int | None, str, str] | None = None
        self._told_s = -AGAIN_S
        self.orders = Orders(self._failed)

    def _failed(self, order: Order, error: Exception) -> None:
        """An order that raised: told to its page, and to the run's events but for refusals."""
        if not isinstance(error, WatchingError):
            self._note(f"{order.what}: {type(error).__name__}: {error}")
        told = order.page, order.what, str(error) or type(error).__name__
        now_s = time.monotonic()
        if (
            told != self._told or now_s - self._told_s > AGAIN_S
        ):  # a slider asks many times a second
            self._tell(*told)
            self._told, self._told_s = told, now_s

    def check(self, page: int | None) -> None:
        """WatchingError where the page does not hold the controls."""
        if not self.seat.may(page):
            raise WatchingError("you are watching: press 'Take over the controls' first")

    def button(
        self, handle: Any, what: str, act: Callable[[int | None], None], *, everybody: bool = False
    ) -> None:
        """`act(page)` when it is pressed by who holds the controls, or by `everybody`."""

        def pressed(event: Any) -> None:
            page = event.client_id

            def do() -> None:
                if not everybody:
                    self.check(page)
                act(page)

            if not self.orders.put(what, do, page):
                self._tell(page, what, "too much at once: wait a moment")

        register = getattr(handle, "on_click", None) or handle.on_trigger
        register(pressed)

    def pick(self, handle: Any, what: str, act: Callable[[Any], None]) -> None:
        """A row of buttons: `act(label)` for who holds the controls."""

        def pressed(event: Any) -> None:
            page, label = event.client_id, handle.value

            def do() -> None:
                self.check(page)
                act(label)

            self.orders.put(what, do, page)

        handle.on_click(pressed)

    def value(
        self,
        handle: Any,
        what: str,
        clean: Callable[[Any], T],
        apply: Callable[[T], None] = lambda value: None,
    ) -> "Kept[T]":
        """What a page sets: cleaned, put back where it may not or was beyond a limit, applied.

        The program reads the returned `Kept.now`, never the handle's own value.
        """
        kept = Kept(clean(handle.value))

        def updated(event: Any) -> None:
            page, given = event.client_id, handle.value
            if page is None:  # set by the program
                return

            def do() -> None:
                try:
                    self.check(page)
                    wanted = clean(given)
                    apply(wanted)
                    kept.now = wanted
                finally:
                    if handle.value != kept.now:
                        handle.value = kept.now

            self.orders.put(what, do, page)

        handle.on_update(updated)
        return kept


class Kept:
    """A value that was checked."""

    def __init__(self, now: Any) -> None:
        self.now = now

    def __class_getitem__(cls, item: Any) -> type:
        return cls
