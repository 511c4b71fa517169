"""The dashboard's small pieces: seat, clamps, queue, plan, teeth, film."""

import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from math import inf, isfinite, nan, radians
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from experiments.analysis.samples import held
from experiments.dashboard.server.controls import (
    QUEUE_LENGTH,
    ControlLock,
    ControlPanelQueue,
    Controls,
)
from experiments.dashboard.server.input_limits import BACKLASH_DEG, KP, choice, on_plate
from experiments.dashboard.session.live import POINTS, LiveBuffer
from experiments.dashboard.session.plan import RunPlan, SessionStatus, planned_runs
from experiments.dashboard.session.playback import PlaybackClock
from experiments.dashboard.view.curves import CHARTS, chart_data
from experiments.dashboard.view.pose import gauges, linkage, plate_point, plate_wxyz, quaternion
from experiments.runs.protocol import read_protocol
from rig.log import COLUMNS, INDEX
from rig.parameters import Rig
from rig.plant.ball import plate_rotation


# --- the seat ---
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
    assert "Nobody holds" in lock.words(1)
    assert lock.joined(3).may(3)  # a page that comes (or is reloaded) while they are free
    with pytest.raises(ValueError, match="not connected"):
        lock.taken(9)


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


# --- clamps ---
ANYTHING = st.one_of(
    st.floats(), st.integers(), st.text(), st.none(), st.booleans(), st.lists(st.floats())
)


@given(ANYTHING)
def test_whatever_a_page_sends_is_within_the_limits_or_refused(value):
    with suppress(ValueError):  # and nothing else
        assert KP.low <= KP.clamp(value) <= KP.high


@pytest.mark.parametrize("value", [nan, inf, -inf, True, None, "abc", [1.0], 10**400])
def test_what_is_no_number_is_refused(value):
    with pytest.raises(ValueError, match="no number"):
        BACKLASH_DEG.clamp(value)


@given(ANYTHING)
def test_a_choice_is_one_of_the_options(value):
    with suppress(ValueError):  # and nothing else
        assert choice(value, ("a", "b")) in ("a", "b")


@given(st.floats(-10, 10), st.floats(-10, 10))
def test_a_target_stays_on_the_plate(x, y):
    assert max(map(abs, on_plate((x, y), 0.275, 0.02))) <= 0.1375 - 0.02 + 1e-12


# --- the queue ---
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

    def on_update(self, callback):
        self.callback = callback

    on_click = on_update


class FakeEvent:
    def __init__(self, page):
        self.client_id = page


def controls():
    told, noted = [], []
    return Controls(lambda *what: told.append(what), noted.append), told, noted


def test_a_watching_page_moves_nothing_and_its_slider_goes_back():
    c, told, noted = controls()
    c.lock = ControlLock().joined(1).joined(2)
    handle, applied = FakeHandle(3.0), []
    kept = c.value(handle, "gain", KP.clamp, applied.append)
    handle.value = 5.0
    handle.callback(FakeEvent(2))
    handle2 = FakeHandle(0)
    c.button(handle2, "start", lambda page: applied.append("start"))
    handle2.callback(FakeEvent(2))
    c.queue.close()
    assert applied == []
    assert handle.value == kept.now == 3.0
    assert [what[0] for what in told] == [2, 2]
    assert noted == []  # a refusal is no event of the run


def test_a_value_beyond_its_limit_is_clamped_and_everybody_may_stop():
    c, told, _ = controls()
    c.lock = ControlLock().joined(1).joined(2)
    handle, applied = FakeHandle(3.0), []
    kept = c.value(handle, "gain", KP.clamp, applied.append)
    handle.value = 1e9
    handle.callback(FakeEvent(1))
    stop = FakeHandle(False)
    c.button(stop, "stop", lambda page: applied.append(f"stop {page}"), everybody=True)
    stop.callback(FakeEvent(2))
    handle.callback(FakeEvent(None))  # set by the program: not an order
    c.queue.close()
    assert applied == [KP.high, "stop 2"]
    assert handle.value == kept.now == KP.high
    assert told == []


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
    assert noted == ["push: RuntimeError: no motor"]


# --- plan ---
def test_a_plan_pairs_the_arms_of_a_seed():
    plan = RunPlan(read_protocol("free-release"), ("without", "with"), 2, 5, speed=2.0)
    found = [
        (planned.seed, planned.method, planned.number, planned.of) for planned in planned_runs(plan)
    ]
    assert found == [
        (5, "without", 1, 4),
        (5, "with", 2, 4),
        (6, "without", 3, 4),
        (6, "with", 4, 4),
    ]
    status = SessionStatus("running", run=planned_runs(plan)[1], t_s=8.25)
    assert status.share == pytest.approx(0.375)
    assert status.remaining_s == pytest.approx(2.5 * 16.5 / 2)
    assert replace(status, t_s=99.0).share == 0.5


# --- geometry ---
@given(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6))
def test_rods_keep_their_length_and_the_plate_follows_the_arms(x, y):
    rig, theta = Rig(), np.array([x, y])
    still = [linkage(a, np.zeros(2), rig) for a in range(2)]
    for axis in range(2):
        shaft, tip, edge = linkage(axis, theta, rig)
        assert np.linalg.norm(tip - shaft) == pytest.approx(rig.linkage.arm_radius_m)
        rod = np.linalg.norm(still[axis][2] - still[axis][1])
        assert np.linalg.norm(edge - tip) == pytest.approx(rod, abs=0.004)  # a ball joint's play
        assert (edge[2] < still[axis][2][2] + 1e-9) == (theta[axis] > -1e-9) or abs(
            theta[axis]
        ) < 0.02


@settings(deadline=None)  # the first turn of a plate is compiled
@given(st.floats(-0.08, 0.08), st.floats(-0.08, 0.08))
def test_quaternion_is_the_rotation(x, y):
    import viser.transforms as tf

    rotation = plate_rotation((x, y))
    assert np.allclose(tf.SO3(quaternion(rotation)).as_matrix(), rotation, atol=1e-12)
    assert np.isclose(np.linalg.norm(plate_wxyz(np.array([x, y]), Rig())), 1.0)


@given(st.floats(0, 0.05), st.floats(-0.1, 0.1))
def test_a_tooth_never_leaves_its_gap_and_touches_at_its_ends(play, twist):
    half, at, touches = gauges(play, twist, Rig())
    assert abs(at) <= half + 1e-12
    if abs(twist) < play / 2 - 1e-4:
        assert touches == 0
    if abs(twist) > play / 2 + 1e-4:
        assert touches == np.sign(twist)


def test_a_click_meets_the_plate():
    point = plate_point(np.array([0.1, 0.0, 1.0]), np.array([0.0, 0.05, -1.0]))
    assert point == pytest.approx([0.1, 0.05])
    assert plate_point(np.array([0, 0, 1.0]), np.array([0, 0, 1.0])) is None
    assert plate_point(np.array([0, 0, 1.0]), np.array([1.0, 0, 0.0])) is None


# --- curves and rows ---
def test_blanks_are_held_and_curves_are_thinned():
    assert list(held(np.array([nan, 1.0, nan, nan, 2.0]))) == [0.0, 1.0, 1.0, 1.0, 2.0]
    live = LiveBuffer(500.0)
    row = np.full(len(COLUMNS), nan)
    for tick in range(12000):
        row[0] = tick / 500
        row[INDEX["ball_x_m"]] = row[INDEX["ball_y_m"]] = 0.01 if tick % 8 == 0 else nan
        live.add(row)
    rows = live.curve()
    assert rows.shape == (POINTS, len(COLUMNS))
    assert rows[-1, 0] - rows[0, 0] == pytest.approx(20.0, abs=0.1)
    assert np.all(rows[:, INDEX["ball_x_m"]] == 0.01)
    for chart in CHARTS:
        data = chart_data(chart, rows)
        assert all(np.isfinite(part).all() and len(part) == POINTS for part in data)
    assert live.now().row is not None
    assert len(live.unread()) <= 2048
    assert live.unread() == []


# --- film ---
def test_a_film_plays_scrubs_and_stops_at_its_end():
    now = [0.0]
    player = PlaybackClock(10.0, clock=lambda: now[0])
    player.play(True)
    now[0] = 2.0
    assert player.t_s == 2.0
    player.set_speed(4.0)
    now[0] = 3.0
    assert player.t_s == 6.0
    player.seek(99.0)
    assert player.t_s == 10.0
    assert not player.playing
    player.play(True)  # from its end it starts anew
    assert player.t_s == 0.0
    now[0] = 100.0
    assert player.t_s == 10.0
    assert isfinite(radians(player.t_s))
