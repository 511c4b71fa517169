"""Lock, queue and inputs of the control panel: who may do what, in which order."""

import threading
from collections.abc import Callable
from dataclasses import FrozenInstanceError
from typing import Any
from unittest.mock import patch

import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.dashboard.server.controls import (
    QUEUE_LENGTH,
    REPEAT_S,
    ControlLock,
    ControlPanelQueue,
    Controls,
    InputRules,
    QueuedAction,
)
from experiments.dashboard.server.input_limits import KP, flag


def test_one_page_holds_the_controls_and_others_take_over_knowingly():
    lock = ControlLock().joined(1).joined(2)
    assert lock.may(1)
    assert not lock.may(2)
    assert "watching" in lock.words(2)
    lock = lock.taken(2)
    assert lock.may(2)
    assert not lock.may(1)
    lock = lock.left(2)
    assert not lock.may(1)  # nobody gets them without asking
    assert "Nobody is in control" in lock.words(1)
    assert lock.joined(3).may(3)  # a page that comes (or is reloaded) while they are free
    with pytest.raises(ValueError, match="not connected"):
        lock.taken(9)


def test_a_page_is_told_whether_it_holds_the_controls():
    lock = ControlLock().joined(1)
    assert lock.words(1) == "**You are in control.**"
    lock = lock.joined(2)
    assert lock.words(1) == "**You are in control.** 1 other page watching."
    assert lock.words(2).startswith("**You are watching.** Another page is in control")
    lock = lock.joined(3)
    assert lock.words(1) == "**You are in control.** 2 other pages watching."
    with pytest.raises(FrozenInstanceError):
        lock.holder = 3  # type: ignore


@given(st.lists(st.tuples(st.sampled_from(["join", "leave", "take"]), st.integers(0, 4))))
def test_never_two_hold_the_controls(steps):
    lock = ControlLock()
    for what, page in steps:
        if what == "join":
            lock = lock.joined(page)
        elif what == "leave":
            lock = lock.left(page)
        elif page in lock.pages:
            lock = lock.taken(page)
        assert sum(lock.may(page) for page in range(5)) <= 1
        assert lock.holder is None or lock.holder in lock.pages
    assert not lock.may(None)


def test_orders_are_served_in_turn_and_failures_are_told():
    failures, served = [], []
    queue = ControlPanelQueue(
        lambda order, error: failures.append((order.what, order.page, str(error)))
    )
    queue.put("one", lambda: served.append(1))
    queue.put("two", lambda: (_ for _ in ()).throw(ValueError("broken")), 7)
    queue.put("three", lambda: served.append(3))
    queue.close()
    assert served == [1, 3]
    assert failures == [("two", 7, "broken")]


def test_a_full_queue_drops_and_never_waits():
    gate = threading.Event()
    queue = ControlPanelQueue(lambda order, error: None)

    def slow() -> None:
        gate.wait()

    queue.put("slow", slow)
    results = [queue.put("more", lambda: None) for _ in range(QUEUE_LENGTH + 10)]
    gate.set()
    queue.close()
    assert not all(results)
    assert sum(results) >= QUEUE_LENGTH - 1


class FakeHandle:
    """What is used of a viser input."""

    def __init__(self, value):
        self.value = value
        self.callback: Callable[[Any], None] = print

    def on_click(self, callback):
        self.callback = callback


class FakeEvent:
    def __init__(self, page):
        self.client_id = page


def controls():
    told, noted = [], []
    return Controls(lambda *what: told.append(what), noted.append), told, noted


def test_a_watching_page_presses_nothing_and_everybody_may_stop():
    c, told, noted = controls()
    c.lock = ControlLock().joined(1).joined(2)
    start, stop, acted = FakeHandle(False), FakeHandle(False), []
    c.button(start, "start", lambda page: acted.append("start"))
    start.callback(FakeEvent(2))
    c.stop_button(stop, "stop", lambda who: acted.append(f"stop {who}"))
    stop.callback(FakeEvent(2))
    c.queue.close()
    assert acted == ["stop STOP on a page (page 2)"]
    assert [what[0] for what in told] == [2]
    assert noted == []  # a refusal is no event of the run


class FakeCommand:
    """What is used of an entry of viser's command palette."""

    def on_trigger(self, callback) -> None: ...


def test_what_a_page_cannot_use_is_known_so_that_it_sees_it_greyed_and_stop_never_is():
    c, *_ = controls()
    start, stop, shown, arrows, gain, box = (FakeHandle(False) for _ in range(6))
    c.button(start, "start", print)
    c.button(FakeCommand(), "start by a key", print)
    c.button(shown, "report", print, everybody=True)
    c.stop_button(stop, "stop", print)
    c.pick(arrows, ("left",), print)
    c.value(gain, "arm", flag)
    c.value(box, "camera", flag, everybody=True)
    c.needs(lambda page: film[page], shown, start)
    film = {1: "a film"}
    assert [handle for handle, _ in c.checks.values()] == [start, arrows, gain, shown]
    c.lock = ControlLock().joined(1).joined(2)
    refused = {"watches": (PermissionError, 2), "has no film": (KeyError, 2)}
    for handle, whys in ((start, refused), (arrows, ["watches"]), (shown, ["has no film"])):
        checks = c.checks[id(handle)][1]
        for check, why in zip(checks, whys, strict=True):
            check(1)
            error, page = refused[why]
            with pytest.raises(error):
                check(page)
    c.forget(arrows)
    assert [handle for handle, _ in c.checks.values()] == [start, gain, shown]
    c.queue.close()


def test_a_value_that_cannot_be_used_goes_back():
    c, told, _ = controls()
    c.lock = ControlLock().joined(1)
    handle = FakeHandle(3.0)

    def apply(value: float) -> None:
        raise ValueError("no film is shown")

    kept = c.value(handle, "time", KP.clamp, apply)
    handle.value = c.cleaned(1, handle, 5.0)
    c.use(1, handle, 5.0)
    c.queue.close()
    assert handle.value == kept.now == 3.0
    assert told == [(1, "time", "no film is shown")]


def test_an_exception_becomes_a_notification_and_a_line_in_the_events():
    c, told, noted = controls()
    c.lock = ControlLock().joined(1)
    button = FakeHandle(False)

    def act(page):
        raise RuntimeError("no motor")

    c.button(button, "push", act)
    button.callback(FakeEvent(1))
    c.queue.close()
    assert told == [(1, "push", "no motor")]
    assert noted == ["push failed: no motor"]


def test_what_a_watching_page_asks_for_in_vain_is_no_event_of_somebody_elses_run():
    c, told, noted = controls()
    c.lock = ControlLock().joined(1).joined(2)
    button = FakeHandle(False)

    def act(page):
        raise OSError("no film")

    c.button(button, "play", act, everybody=True)
    button.callback(FakeEvent(2))
    c.queue.put("drawing", lambda: act(None))
    button.callback(FakeEvent(1))
    c.queue.close()
    assert told == [(2, "play", "no film"), (None, "drawing", "no film"), (1, "play", "no film")]
    assert noted == ["drawing failed: no film", "play failed: no film"]


def test_a_refusal_is_no_event_of_the_run_unless_nobody_else_hears_of_it():
    c, told, noted = controls()
    c.lock = ControlLock().joined(1)
    button = FakeHandle(False)

    def act(page):
        raise ValueError("" if page else "choose a run first")

    c.button(button, "play", act)
    button.callback(FakeEvent(1))
    c.queue.put("drawing", lambda: act(None))
    c.queue.close()
    assert told == [(1, "play", "ValueError"), (None, "drawing", "choose a run first")]
    assert noted == ["drawing failed: choose a run first"]


def test_stop_waits_for_nothing_and_nothing_begins_after_it():
    c, told, noted = controls()
    c.lock = ControlLock().joined(1).joined(2)
    busy, acted = threading.Event(), []
    stop, start, slider = FakeHandle(False), FakeHandle(False), FakeHandle(3.0)
    c.stop_button(stop, "stop", lambda who: acted.append(f"stop {who}"))
    c.button(start, "start", lambda page: acted.append("start"))
    kept = c.value(slider, "gain", KP.clamp, lambda value: acted.append(f"gain {value}"))
    c.queue.put("a whole recording is read", lambda: busy.wait(30.0) and None)
    start.callback(FakeEvent(1))
    slider.value = 5.0
    c.use(1, slider, 5.0)
    assert not all(c.queue.put("more", lambda: None) for _ in range(1000))  # the queue is full
    stop.callback(FakeEvent(2))
    assert acted == ["stop STOP on a page (page 2)"]  # at once
    busy.set()
    c.queue.close()
    assert acted == ["stop STOP on a page (page 2)"]
    assert [what[0:2] for what in told] == [(1, "start"), (1, "gain")]
    assert slider.value == kept.now == 3.0
    assert noted == []


def test_what_was_said_of_the_table_is_taken_back_by_stop_and_by_another_holder():
    """A tick that the plate is clear counts for who gave it, and not beyond a STOP."""
    controls, taken_back = Controls(lambda *what: None, print), []
    controls.withdraw.append(lambda: taken_back.append(controls.lock.holder))
    controls.lock = controls.lock.joined(1)
    controls.lock = controls.lock.joined(2)
    assert taken_back == [1]
    controls.stop("page 2", lambda who: None)
    assert taken_back == [1, 1]
    controls.lock = controls.lock.taken(2)
    controls.lock = controls.lock.left(1)
    assert taken_back == [1, 1, 2]
    controls.lock = controls.lock.left(2)
    assert taken_back == [1, 1, 2, None]
    with patch.object(controls, "_tell") as failed:
        controls.stop("page 2", lambda who: 1 / 0)
    assert failed.call_count == 1
    assert len(taken_back) == 5  # a stop that fails takes it back, too
    controls.queue.close()


@pytest.mark.parametrize(
    "comes",
    [lambda c: c.stop("page 2", lambda who: None), lambda c: setattr(c, "lock", c.lock.taken(2))],
)
def test_what_is_said_while_a_stop_or_another_holder_comes_is_taken_back_too(comes):
    """What there was to take back had not been stored yet: the tick outlived the stop."""
    c, _, _ = controls()
    c.lock = ControlLock().joined(1).joined(2)
    arm = FakeHandle(False)
    kept = c.value(arm, "arm the table", flag, lambda value: comes(c))
    c.withdraw.append(lambda: setattr(kept, "now", False))
    c.use(1, arm, True)
    c.queue.close()
    assert kept.now is False


def test_what_is_said_while_nothing_comes_stays_said():
    c, _, _ = controls()
    c.lock = ControlLock().joined(1).joined(2)
    arm, look, withdrawn = FakeHandle(False), FakeHandle(False), []
    armed = c.value(arm, "arm the table", flag)
    c.value(look, "show the grid", flag, everybody=True)
    c.withdraw.append(lambda: withdrawn.append(1))
    c.use(1, arm, True)
    c.use(2, look, True)  # of a page that only watches
    c.queue.close()
    assert armed.now is True
    assert not withdrawn


def test_a_stop_that_fails_is_told():
    c, told, noted = controls()
    stop = FakeHandle(False)

    def act(page):
        raise RuntimeError("no loop")

    c.stop_button(stop, "stop", act)
    stop.callback(FakeEvent(4))
    c.queue.close()
    assert told == [(4, "stop", "no loop")]
    assert noted == ["stop failed: no loop"]


class PaletteHandle:
    """A command of the palette, as viser has it."""

    def on_trigger(self, callback):
        self.callback = callback


def pressed(c: Controls, page: int, *handles) -> None:
    """Presses in turn, each served before the next."""
    for handle in handles:
        handle.callback(FakeEvent(page))
        served = threading.Event()
        c.queue.put("served", served.set)
        assert served.wait(5.0)


def test_who_watches_presses_and_picks_nothing_but_what_is_for_everybody():
    c, told, _ = controls()
    assert not c.lock.may(1)  # nobody holds what nobody took
    c.lock = ControlLock().joined(1).joined(2)
    start, looks, palette, acted = FakeHandle(False), FakeHandle(False), PaletteHandle(), []
    c.button(start, "start", lambda page: acted.append(("start", page)))
    c.button(looks, "looks", lambda page: acted.append(("looks", page)), everybody=True)
    c.button(palette, "palette", lambda page: acted.append(("palette", page)))
    pressed(c, 2, start, looks, palette)
    assert acted == [("looks", 2)]
    assert [what[:2] for what in told] == [(2, "start"), (2, "palette")]
    pressed(c, 1, start, looks, palette)
    assert acted[1:] == [("start", 1), ("looks", 1), ("palette", 1)]
    for handle in (start, looks):  # a press passes the filter from any page, and sets nothing
        assert c.cleaned(2, handle, True) is True
    c.use(2, start, True)
    arrows, ways = FakeHandle(None), []
    c.pick(arrows, ("left", "right"), ways.append)
    assert c.cleaned(1, arrows, "left") == "left"
    for page, way, error in ((2, "left", PermissionError), (1, "up", ValueError)):
        with pytest.raises(error):
            c.cleaned(page, arrows, way)
    c.use(1, arrows, "left")
    c.use(2, arrows, "right")
    c.queue.close()
    assert ways == ["left"]


def test_a_page_that_watches_fills_no_queue():
    c, told, noted = controls()
    c.lock = ControlLock().joined(1).joined(2)
    start, palette, acted, busy = FakeHandle(False), PaletteHandle(), [], threading.Event()
    c.button(start, "start", lambda page: acted.append(("start", page)))
    c.button(palette, "next", lambda page: acted.append(("next", page)))
    click = c.click("target", lambda event: acted.append(("target", event.client_id)))
    c.queue.put("slow", busy.wait)
    for _ in range(QUEUE_LENGTH):
        for press in (start.callback, palette.callback, click):
            press(FakeEvent(2))
    for press in (start.callback, palette.callback, click):
        press(FakeEvent(1))
    busy.set()
    c.queue.close()
    assert acted == [("start", 1), ("next", 1), ("target", 1)]
    assert {what[:2] for what in told} == {(2, "start"), (2, "next"), (2, "target")}
    assert noted == []


@pytest.mark.parametrize("comes", ["stop", "another page"])
def test_what_takes_its_time_asks_again_before_something_moves(comes):
    c, told, noted = controls()
    c.lock = ControlLock().joined(1).joined(2)
    start, arrows, moved = FakeHandle(False), FakeHandle("left"), []

    def prepare(page) -> None:
        c.still()
        if comes == "stop":
            c.stop("page 2", lambda who: None)
        else:
            c.lock = c.lock.taken(2)
        c.still()
        moved.append(page)

    c.button(start, "start", prepare)
    c.pick(arrows, ("left",), moved.append)
    start.callback(FakeEvent(1))
    served = threading.Event()
    c.queue.put("served", served.set)
    assert served.wait(5.0)
    why = "STOP was pressed meanwhile: ask again"
    watching = "you are watching: press 'Take over the controls' first"
    assert told == [(1, "start", why if comes == "stop" else watching)]
    c.still()  # nobody asks for anything just now
    c.use(c.lock.holder or 0, arrows, "left")  # that was for what came before
    c.queue.close()
    assert moved == ["left"]
    assert noted == []


def test_a_click_before_a_stop_is_refused_after_it():
    c, told, _ = controls()
    c.lock = ControlLock().joined(1)
    busy, acted = threading.Event(), []
    c.queue.put("slow", busy.wait)
    c.click("target", acted.append)(FakeEvent(1))
    c.stop("page 1", lambda who: None)
    busy.set()
    c.queue.close()
    assert acted == []
    assert told == [(1, "target", "STOP was pressed meanwhile: ask again")]


def test_what_everybody_asked_for_is_done_after_a_stop_and_what_follows_a_stop_too():
    c, _, _ = controls()
    c.lock = ControlLock().joined(1)
    busy, looks, start, acted = threading.Event(), FakeHandle(False), FakeHandle(False), []
    c.button(looks, "looks", lambda page: acted.append("looks"), everybody=True)
    c.button(start, "start", lambda page: acted.append("start"))
    c.queue.put("busy", lambda: busy.wait(30.0) and None)
    looks.callback(FakeEvent(1))
    start.callback(FakeEvent(1))
    c.stop("page 1", lambda who: None)
    start.callback(FakeEvent(1))
    busy.set()
    c.queue.close()
    assert acted == ["looks", "start"]


def test_a_value_is_checked_by_who_sent_it_kept_and_forgotten_with_its_input():
    c, told, _ = controls()
    c.lock = ControlLock().joined(1).joined(2)
    gain, camera, applied = FakeHandle(3.0), FakeHandle(False), []
    kept = c.value(gain, "gain", KP.clamp, applied.append)
    seen = c.value(camera, "camera", flag, everybody=True)
    assert c.cleaned(1, gain, 99.0) == KP.high
    with pytest.raises(PermissionError):
        c.cleaned(2, gain, 1.0)
    with pytest.raises(ValueError, match="no number"):
        c.cleaned(1, gain, "x")
    assert c.cleaned(2, camera, True) is True
    camera.value = True  # as the filter of messages stores it
    c.use(2, camera, True)
    c.use(1, gain, 5.0)
    c.use(2, gain, 6.0)  # who watches is refused where it is applied, too
    c.refuse(2, gain, ValueError("too late"))
    c.refuse(2, FakeHandle(None), ValueError("nobody is told"))
    c.queue.close()
    assert (kept.now, seen.now, applied, camera.value) == (5.0, True, [5.0], True)
    assert (2, "gain", "too late") in told
    assert gain.value == 5.0
    c.forget(gain)
    with pytest.raises(ValueError, match="nobody may set this"):
        c.cleaned(1, gain, 1.0)


def test_a_value_of_every_pages_own_is_taken_at_once_from_who_watches_too():
    c, told, _ = controls()
    c.lock = ControlLock().joined(1).joined(2)
    scrub, gain, taken, busy = FakeHandle(0.0), FakeHandle(3.0), [], threading.Event()

    def take(page: int, value: float) -> None:
        if value > 2.0:
            raise ValueError("there is no film")
        taken.append((page, value))

    c.value(gain, "gain", KP.clamp)
    c.own_value(scrub, "time", KP.clamp, take)
    assert [c.is_own(one) for one in (scrub, gain, FakeHandle(None))] == [True, False, False]
    c.queue.put("busy", lambda: busy.wait(30.0) and None)  # the queue has no part in it
    for page, value in ((2, -1.0), (1, 1.0), (2, 99.0)):
        c.use(page, scrub, c.cleaned(page, scrub, value))
    assert taken == [(2, KP.low), (1, 1.0)]
    assert told == [(2, "time", "there is no film")]
    busy.set()
    c.queue.close()


def test_a_value_that_finds_the_queue_full_goes_back_and_is_told():
    c, told, _ = controls()
    c.lock = ControlLock().joined(1)
    busy, gain = threading.Event(), FakeHandle(3.0)
    kept = c.value(gain, "gain", KP.clamp)
    c.queue.put("busy", lambda: busy.wait(30.0) and None)
    assert not all(c.queue.put("more", lambda: None) for _ in range(1000))
    gain.value = 5.0
    c.use(1, gain, 5.0)
    assert gain.value == kept.now == 3.0
    assert told == [(1, "gain", "too much at once: wait a moment")]
    busy.set()
    c.queue.close()


def test_the_same_refusal_is_shown_once_in_a_while():
    c, told, _ = controls()
    gain, now_s = FakeHandle(3.0), [100.0]
    c.value(gain, "gain", KP.clamp)
    with patch("time.monotonic", lambda: now_s[0]):
        for seconds, many in ((0.0, 1), (0.1, 1), (REPEAT_S, 1), (0.1, 2), (0.1, 2), (1e-3, 2)):
            now_s[0] = now_s[0] + seconds if seconds != REPEAT_S else 100.0 + REPEAT_S
            c.refuse(1, gain, ValueError("no"))
            assert len(told) == many, seconds
        c.refuse(1, gain, ValueError("another"))
        assert len(told) == 3
    c.queue.close()


def test_what_is_asked_for_cannot_be_changed_afterwards():
    for one, name in (
        (QueuedAction("start", lambda: None), "page"),
        (InputRules("gain", float, lambda page, value: None), "everybody"),
    ):
        assert getattr(one, name) in (None, False)
        with pytest.raises(FrozenInstanceError):
            setattr(one, name, 1)
