"""The session without a page: operator's steps, stop, balancing, what is kept."""

import json
import time
from pathlib import Path

import pytest

from experiments.assemble import load_rig
from experiments.dashboard.live import Live
from experiments.dashboard.plan import Plan
from experiments.dashboard.readying import VirtualTable
from experiments.dashboard.session import Session
from experiments.protocol import parse
from experiments.recording import read_run
from rig.commands import Push, Target

PATIENCE_S = 300.0  # a slow machine compiles first
SHORT = {
    "title": "short",
    "duration_s": 1.0,
    "operator": ["place", "hold", "release"],
    "start": {"x_m": 0.03, "y_m": 0.0, "hold_s": 0.2},
}


def wait_for(what: str, holds) -> None:
    end = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < end, f"{what} did not come"
        time.sleep(0.02)


@pytest.fixture
def table(tmp_path: Path):
    """A session that rests, what it recorded and what it said."""
    recorded, said = [], []
    rig = load_rig(None)
    session = Session(
        rig,
        VirtualTable(tmp_path),
        Live(rig.control_rate_hz),
        recorded=lambda leg, folder, ending: recorded.append((leg, folder, ending)),
        said=lambda t_s, text: said.append(text),
        balance=False,
    )
    yield session, recorded, said
    session.close()


def test_the_operator_at_the_page_places_and_lets_go(table):
    session, recorded, _ = table
    protocol = parse(SHORT, label="short", name="short")
    session.start(Plan(protocol, ("with",), 1, 1, by_hand=True))
    with pytest.raises(ValueError, match="a run is on"):
        session.start(Plan(protocol, ("with",), 1, 1))
    wait_for("the step place", lambda: session.status.asked.startswith("place"))
    session.confirm()
    wait_for("the step release", lambda: session.status.asked.startswith("let"))
    session.note("a line of the page")
    session.confirm()
    wait_for("the recording", lambda: recorded)
    (_, folder, ending), *_ = recorded
    assert ending.outcome == "completed"
    run = read_run(folder)
    words = " | ".join(event["text"] for event in run.events)
    for part in ("asked: place the ball", "confirmed: place", "placed", "a line of the page",
                 "confirmed: let it go", "released"):  # fmt: skip
        assert part in words
    assert run.meta["loop"]["lost_rows"] == 0
    assert (folder / "truth.json").is_file()


def test_stop_ends_the_run_drops_the_plan_and_leaves_the_table_at_rest(table):
    session, recorded, said = table
    protocol = parse({**SHORT, "duration_s": 60.0}, label="short", name="short")
    session.start(Plan(protocol, ("without", "with"), 2, 1))
    wait_for("rows", lambda: session.status.t_s > 0.3)
    session.put(Target((0.02, 0.0)))
    session.put(Push((1.0, 0.0)))
    wait_for("the commands", lambda: "pushed by command" in said)
    session.stop("page 7")
    wait_for("rest", lambda: session.status.state == "stopped")
    assert len(recorded) == 1
    meta = json.loads((recorded[0][1] / "run.json").read_text())
    assert meta["outcome"] == "aborted"
    assert meta["reason"] == "stopped by page 7"
    with pytest.raises(ValueError, match="nothing moves"):
        session.put(Target(None))
    with pytest.raises(ValueError, match="nothing is asked"):
        session.confirm()
