"""The session without a page: operator's steps, stop, balancing, what is kept."""

import json
from pathlib import Path

import pytest

from experiments.dashboard.session.live import LiveBuffer
from experiments.dashboard.session.plan import RunPlan, SessionStatus
from experiments.dashboard.session.run_setup import VirtualRunSetup
from experiments.dashboard.session.session import Session
from experiments.records.recording import read_run
from experiments.runs.assemble import load_rig
from experiments.runs.protocol import parse
from rig.loop.commands import Push, Target
from tests.support.waiting import wait_for

pytestmark = pytest.mark.realtime

PATIENCE_S = 300.0  # a slow machine compiles first
SHORT = {
    "title": "short",
    "duration_s": 1.0,
    "operator": ["place", "hold", "release"],
    "start": {"x_m": 0.03, "y_m": 0.0, "hold_s": 0.2},
}


@pytest.fixture
def table(tmp_path: Path):
    """A session that rests, what it recorded and what it said."""
    recorded, events = [], []
    rig = load_rig(None)
    session = Session(
        rig,
        VirtualRunSetup(tmp_path),
        LiveBuffer(rig.control_rate_hz),
        on_recorded=lambda planned, folder, ending: recorded.append((planned, folder, ending)),
        on_event=lambda t_s, text: events.append(text),
        balance=False,
    )
    yield session, recorded, events
    session.close()


@pytest.mark.slow
def test_the_operator_at_the_page_places_and_lets_go(table):
    session, recorded, _ = table
    protocol = parse(SHORT, label="short", name="short")
    session.start(RunPlan(protocol, ("with",), 1, 1, by_hand=True))
    wait_for("the wait", lambda: (session.status.waited_s or 0.0) > 0.2, PATIENCE_S)
    assert session.status.t_s == 0.0  # the run's clock stands still
    with pytest.raises(ValueError, match="a run is on"):
        session.start(RunPlan(protocol, ("with",), 1, 1))
    wait_for("the step place", lambda: session.status.operator_step.startswith("place"), PATIENCE_S)
    session.confirm()
    wait_for("the step release", lambda: session.status.operator_step.startswith("let"), PATIENCE_S)
    session.note("a line of the page")
    session.confirm()
    wait_for("the recording", lambda: recorded, PATIENCE_S)
    (_, folder, ending), *_ = recorded
    assert ending.outcome == "completed"
    run = read_run(folder)
    words = " | ".join(event["text"] for event in run.events)
    for part in (
        "asked: place the ball",
        "confirmed: place",
        "placed",
        "a line of the page",
        "confirmed: let it go",
        "released",
    ):
        assert part in words
    assert run.meta["loop"]["lost_rows"] == 0
    assert (folder / "truth.json").is_file()


def test_stop_ends_the_run_drops_the_plan_and_leaves_the_table_at_rest(table):
    session, recorded, events = table
    protocol = parse({**SHORT, "duration_s": 60.0}, label="short", name="short")
    session.start(RunPlan(protocol, ("without", "with"), 2, 1))
    wait_for("rows", lambda: session.status.t_s > 0.3, PATIENCE_S)
    session.put(Target((0.02, 0.0)))
    session.put(Push((1.0, 0.0)))
    wait_for("the commands", lambda: "by hand: push to the right, 0.08 m/s" in events, PATIENCE_S)
    session.stop("page 7")
    wait_for("rest", lambda: session.status.state == "stopped", PATIENCE_S)
    assert len(recorded) == 1
    meta = json.loads((recorded[0][1] / "run.json").read_text())
    assert meta["outcome"] == "aborted"
    assert meta["reason"] == "stopped by page 7"
    assert [event.partition(" s: ")[2] for event in meta["by_hand"]] == [
        "target x +2.0, y +0.0 cm",
        "push to the right, 0.08 m/s",
    ]
    with pytest.raises(ValueError, match="nothing moves"):
        session.put(Target(None))
    with pytest.raises(ValueError, match="nothing is asked"):
        session.confirm()


def test_stop_while_the_loop_starts_ends_it(table):
    session, recorded, _ = table
    protocol = parse({**SHORT, "duration_s": 60.0}, label="short", name="short")
    session.start(RunPlan(protocol, ("with",), 1, 1))
    wait_for("the start", lambda: session.status.state == "running", PATIENCE_S)
    session.stop("page 7")  # before its process has a row
    assert session.status.state in ("at rest", "stopped")  # no table was opened
    assert session.status.t_s == 0.0
    wait_for("rest", lambda: session.status.state == "stopped", PATIENCE_S)
    assert recorded[0][2].reason == "stopped by page 7"


class MovingLoop:
    """Stands for a loop process whose table moves until it says otherwise."""

    at_rest = False

    def __init__(self):
        self.put = [].append


def test_after_stop_a_page_hears_of_levelling_then_of_0_V(table):
    session, *_ = table
    wait_for("rest", lambda: session.status.state == "stopped", PATIENCE_S)
    loop = MovingLoop()
    session._status, session._busy, session._loop = SessionStatus("running"), True, loop
    session.stop("page 7")
    assert session.status.state == "stopping"
    loop.at_rest = True
    assert session.status.state == "at rest"
    session._loop = None
    assert session.status.state == "at rest"
    session._busy = False
