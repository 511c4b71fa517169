"""Buttons and inputs of the pages: one page holds the controls, one thread serves their actions.

A callback of a page only enqueues an action, so nothing waits for a page. What a page sends for an
input is checked (who sent it, its type, its limits) before anything stores it; that value, and none
that is read later, goes into the queue, whose thread acts. What an action raises is shown to the
page that asked; where that page holds the controls, or the program itself asked, it is noted in the
run's events, too. STOP alone waits for nothing: it acts in the callback, and refuses every action
that was enqueued before it.
"""

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from queue import Full, Queue
from typing import Any, Generic, TypeVar

from experiments.dashboard.server.input_limits import choice, flag
from experiments.dashboard.server.lock import ControlLock
from experiments.dashboard.server.untrusted_text import words_of

T = TypeVar("T")
QUEUE_LENGTH = 256  # actions; chosen: a slider that is dragged sends tens of them a second
REPEAT_S = 4.0  # the same refusal is shown to a page once in this time; chosen


class WatchingError(PermissionError):
    """The page does not hold the controls."""


class StoppedError(PermissionError):
    """STOP was pressed after the action was asked for."""


@dataclass(frozen=True)
class QueuedAction:
    """An action with its name, for the page that asked (None: the program itself)."""

    what: str
    do: Callable[[], None]
    page: int | None = None


class ControlPanelQueue:
    """Serves actions in turn in its own thread; `failed(action, error)` gets what they raise."""

    def __init__(self, failed: Callable[[QueuedAction, Exception], None]) -> None:
        self._failed = failed
        self._waiting: Queue[QueuedAction | None] = Queue(QUEUE_LENGTH)
        self._thread = threading.Thread(target=self._serve, daemon=True, name="control panel queue")
        self._thread.start()

    def put(self, what: str, do: Callable[[], None], page: int | None = None) -> bool:
        """Enqueue the action `do`, called `what` in messages, for a page; from any thread, without
        waiting.

        Returns False where the queue is full and the action was dropped. page None: the program
        itself asks.
        """
        try:
            self._waiting.put_nowait(QueuedAction(what, do, page))
        except Full:
            return False
        return True

    def close(self) -> None:
        """Serve the actions that wait, then end the thread (at most 5 s)."""
        self._waiting.put(None)
        self._thread.join(5.0)

    def _serve(self) -> None:
        while (action := self._waiting.get()) is not None:
            try:
                action.do()
            except Exception as error:
                self._failed(action, error)


@dataclass(frozen=True)
class InputRules:
    """What a page may set on an input, named `what` in messages.

    clean: converts and clamps the raw value (ValueError: refused); use: called with the page and
    the cleaned value; everybody: pages that only watch may set it as well; own: every page has a
    value of its own, which no other page is shown.
    """

    what: str
    clean: Callable[[Any], Any]
    use: Callable[[int, Any], None]
    everybody: bool = False
    own: bool = False


class CheckedValue(Generic[T]):
    """The last value of an input that passed its checks, `now`."""

    def __init__(self, now: T) -> None:
        self.now = now


class Controls:
    """Connects buttons and inputs of the pages to the queue, the lock and the checks of values.

    `notify(page, what, why)` tells a page (None: all pages) why `what` was not done; `note(text)`
    adds a line to the run's events. checks: elements and what they need (`needs`), by id; withdraw:
    functions that take back what the page that holds the controls said of the table, called after
    STOP and when the controls change hands.
    """

    def __init__(
        self, notify: Callable[[int | None, str, str], None], note: Callable[[str], None]
    ) -> None:
        self.withdraw: list[Callable[[], None]] = []
        self._lock = ControlLock()
        self._stops = 0  # presses of STOP so far
        # By which page, after how many presses, what is served just now was asked for.
        self._asked: tuple[int | None, int] | None = None
        self._rules: dict[int, InputRules] = {}  # by id of the handle: handles have no hash
        self.checks: dict[int, tuple[Any, list[Callable[[int], Any]]]] = {}
        self._notify, self._note = notify, note
        self._last_notice: tuple[int | None, str, str] | None = None
        self._last_notice_s = -REPEAT_S
        self.queue = ControlPanelQueue(self._failed)

    @property
    def lock(self) -> ControlLock:
        """Who is connected, and who holds the controls."""
        return self._lock

    @lock.setter
    def lock(self, lock: ControlLock) -> None:
        before, self._lock = self._lock, lock
        if lock.holder != before.holder:
            self._withdraw()

    def _withdraw(self) -> None:
        for take_back in self.withdraw:
            take_back()

    def _failed(self, action: QueuedAction, error: Exception) -> None:
        """Show an error to its page; note it in the run's events, unless it is a refusal there or
        that page watches: whose run it is not."""
        refusals = WatchingError, StoppedError, ValueError
        if action.page is None or (self.lock.may(action.page) and not isinstance(error, refusals)):
            self._note_error(action.what, error)
        self._tell(action.page, action.what, error)

    def _note_error(self, what: str, error: Exception) -> None:
        self._note(f"{what} failed: {words_of(error)}")

    def _tell(self, page: int | None, what: str, error: Exception) -> None:
        notice = page, what, words_of(error)
        now_s = time.monotonic()
        if notice != self._last_notice or now_s - self._last_notice_s > REPEAT_S:
            self._notify(*notice)
            self._last_notice, self._last_notice_s = notice, now_s

    def needs(self, check: Callable[[int], Any], *handles: Any) -> None:
        """Grey buttons and inputs on a page while `check(page)` raises (ValueError,
        PermissionError), whose words are their hint. What refuses them asks `check`, too.
        """
        for handle in handles:
            self.checks.setdefault(id(handle), (handle, []))[1].append(check)

    def check(self, page: int | None) -> None:
        """Raise WatchingError where the page does not hold the controls."""
        if not self.lock.may(page):
            raise WatchingError("you are watching: press 'Take over the controls' first")

    def _may(self, page: int | None, what: str) -> bool:
        """Whether the page holds the controls; one that does not is told about `what`."""
        try:
            self.check(page)
        except WatchingError as error:
            self._tell(page, what, error)
            return False
        return True

    def click(self, what: str, act: Callable[[Any], None]) -> Callable[[Any], None]:
        """The callback of a click into the 3-D view: `act(event)` in the queue's thread, for the
        page that holds the controls.
        """

        def clicked(event: Any) -> None:
            if self._may(event.client_id, what):
                self._enqueue(what, partial(act, event), event.client_id)

        return clicked

    def still(self) -> None:
        """Raise where what a page asked for, which is served just now, no longer holds. It is asked
        again where something begins to move, since what leads there may take its time.

        WatchingError: another page has taken the controls; StoppedError: STOP was pressed since.
        """
        if self._asked is None:  # the program itself asks
            return
        page, stops = self._asked
        self.check(page)
        if stops != self._stops:
            raise StoppedError("STOP was pressed meanwhile: ask again")

    def _holds_still(self) -> bool:
        """Whether `still` holds."""
        try:
            self.still()
        except (WatchingError, StoppedError):
            return False
        return True

    def _enqueue(
        self, what: str, act: Callable[[], None], page: int | None, *, everybody: bool = False
    ) -> bool:
        asked = page, self._stops

        def do() -> None:
            self._asked = asked
            try:
                if not everybody:
                    self.still()
                act()
            finally:
                self._asked = None

        taken = self.queue.put(what, do, page)
        if not taken:
            self._notify(page, what, "too much at once: wait a moment")
        return taken

    def button(
        self, handle: Any, what: str, act: Callable[[int | None], None], *, everybody: bool = False
    ) -> None:
        """Call `act(page)` in the queue's thread when a page that holds the controls uses a button;
        with `everybody`, any page.

        handle: viser's button or command; what: its name in messages.
        """

        def pressed(event: Any) -> None:
            page = event.client_id
            if everybody or self._may(page, what):  # a page that watches fills no queue
                self._enqueue(what, partial(act, page), page, everybody=everybody)

        self._on_press(handle, what, pressed)
        if not everybody and not hasattr(handle, "on_trigger"):
            self.needs(self.check, handle)

    def stop(self, who: str, act: Callable[[str], None], page: int | None = None) -> None:
        """Call `act(who)` here and now, whatever waits in the queue, for anybody; from any thread.
        page: is told what fails; None: every page is.

        What the page that holds the controls asked for before it is refused, so that nothing begins
        after a stop. `act` has to be short and safe in any thread.
        """
        self._stops += 1
        for do in (partial(act, who), self._withdraw):
            try:
                do()
            except Exception as error:
                self._note_error("stop", error)  # whoever pressed it: the run goes on
                self._tell(page, "stop", error)

    def stop_button(self, handle: Any, what: str, act: Callable[[str], None]) -> None:
        """Have a button or command of viser stop for any page (`stop`); what: its name."""

        def pressed(event: Any) -> None:
            self.stop(f"STOP on a page (page {event.client_id})", act, event.client_id)

        self._on_press(handle, what, pressed)

    def _on_press(self, handle: Any, what: str, pressed: Callable[[Any], None]) -> None:
        """Register the callback of a button, or of a command of the palette."""
        if hasattr(handle, "on_trigger"):
            handle.on_trigger(pressed)
            return
        handle.on_click(pressed)
        self._rules[id(handle)] = InputRules(what, flag, lambda page, value: None, everybody=True)

    def pick(self, handle: Any, options: Sequence[str], act: Callable[[str], None]) -> None:
        """Call `act(label)` in the queue's thread when the page that holds the controls presses one
        of the `options` of `handle`, a button group of viser.
        """

        def use(page: int, label: str) -> None:
            self._enqueue(label, partial(act, label), page)

        self._rules[id(handle)] = InputRules("press", partial(choice, options=options), use)
        self.needs(self.check, handle)

    def value(
        self,
        handle: Any,
        what: str,
        clean: Callable[[Any], T],
        apply: Callable[[T], None] = lambda value: None,
        *,
        everybody: bool = False,
    ) -> CheckedValue[T]:
        """Check and apply what the page that holds the controls sets on an input; everybody: any
        page.

        handle: viser's input; what: its name in messages; clean: converts and clamps the raw value
        (ValueError: refused); apply: called with the result in the queue's thread. Where either
        fails, the input goes back to the last value accepted, which the program reads as
        `CheckedValue.now`.
        """
        checked = CheckedValue(clean(handle.value))

        def use(page: int, value: T) -> None:
            def do() -> None:
                try:
                    if not everybody:
                        self.still()
                    apply(value)
                except Exception:
                    handle.value = checked.now
                    raise
                checked.now = value
                if not everybody and not self._holds_still():
                    self._withdraw()  # a stop came too early to take back this value, too

            if not self._enqueue(what, do, page, everybody=True):
                handle.value = checked.now

        self._rules[id(handle)] = InputRules(what, clean, use, everybody)
        if not everybody:
            self.needs(self.check, handle)
        return checked

    def own_value(
        self, handle: Any, what: str, clean: Callable[[Any], T], apply: Callable[[int, T], None]
    ) -> None:
        """Call `apply(page, value)` when any page sets an input of which every page has a value of
        its own; arguments as of `value`. It is called in the server's thread, so that a page that
        watches fills no queue: it has to be short and to touch what is that page's alone.
        """

        def use(page: int, value: T) -> None:
            try:
                apply(page, value)
            except ValueError as error:
                self._tell(page, what, error)

        self._rules[id(handle)] = InputRules(what, clean, use, everybody=True, own=True)

    def is_own(self, handle: Any) -> bool:
        """Whether `handle` is an input of `own_value`."""
        rules = self._rules.get(id(handle))
        return rules is not None and rules.own

    def forget(self, handle: Any) -> None:
        """Take no more values for an input that leaves the page."""
        self._rules.pop(id(handle), None)
        self.checks.pop(id(handle), None)

    def cleaned(self, page: int, handle: Any, raw: Any) -> Any:
        """The value to store when a page sends `raw` for the input `handle`: converted and clamped.

        WatchingError: the page may not set it. ValueError: `handle` is no input of `value`, or
        takes no such value.
        """
        rules = self._rules.get(id(handle))
        if rules is None:
            raise ValueError("nobody may set this")
        if not rules.everybody:
            self.check(page)
        return rules.clean(raw)

    def use(self, page: int, handle: Any, value: Any) -> None:
        """Enqueue what the input `handle` does with a value of `cleaned` that a page has set."""
        self._rules[id(handle)].use(page, value)

    def refuse(self, page: int, handle: Any, error: Exception) -> None:
        """Show a page why its value for the input `handle` was not taken; nothing for an unknown
        input.
        """
        rules = self._rules.get(id(handle))
        if rules is not None:
            self._tell(page, rules.what, error)
