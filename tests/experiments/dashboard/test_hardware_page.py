"""The dashboard before a table that another process serves: nothing moves that was not armed."""

import json
import time
from collections.abc import Iterator

import pytest
from rig_lab import Lab

from experiments.assemble import load_rig
from experiments.dashboard.app import App
from experiments.dashboard.plan import Plan
from experiments.dashboard.server import open_server
from experiments.protocol import read_protocol
from experiments.recording import read_run


@pytest.fixture(scope="module")
def lab() -> Iterator[Lab]:
    one = Lab()
    try:
        yield one
    finally:
        one.end()


@pytest.fixture
def app(lab: Lab) -> Iterator[App]:
    server, _ = open_server("127.0.0.1", 0, "a-token-of-some-length-for-tests")
    one = App(server, load_rig(lab.rig), lab.out, rig_file=lab.rig)
    try:
        yield one
    finally:
        one.close()
        server.stop()


def wait_for(what: str, holds) -> None:
    end = time.monotonic() + 120
    while not holds():
        assert time.monotonic() < end, f"{what} did not come"
        time.sleep(0.02)


def test_a_real_table_is_homed_and_armed_for_every_run_and_stopped_by_everybody(lab, app):
    session, tab = app.session, app.run_tab
    wait_for("rest", lambda: session.status.state == "stopped")  # opening the page moves nothing
    with pytest.raises(ValueError, match="tick Arm"):
        tab.start()
    with pytest.raises(ValueError, match="in a run alone"):
        session.balance()
    with pytest.raises(ValueError, match="has not been homed"):
        session.start(Plan(read_protocol("servo-squares"), ("with",), 1, 1))
    assert not (lab.folder / "volts").read_text()
    assert lab.call("home", "--yes")[0] == 0
    tab._armed.now, tab._protocol.now = True, "servo-squares"
    tab.start()
    wait_for("motion", lambda: session.status.t_s > 1.0)
    assert not tab._armed.now  # used up
    session.stop("page 7")
    wait_for("rest", lambda: session.status.state == "stopped")
    (folder,) = (lab.out / "runs").iterdir()
    meta = json.loads((folder / "run.json").read_text())
    assert (meta["source"], meta["outcome"]) == ("measured", "aborted")
    assert meta["reason"].startswith("stopped by page 7")
    assert lab.volts()[-1, 1:].tolist() == [0.0, 0.0]
    with pytest.raises(ValueError, match="tick Arm"):
        tab.start()


def test_a_person_is_told_on_the_page_and_the_table_sees_what_they_did(lab, app):
    asked = set()
    plan = Plan(read_protocol(lab.protocol(3.0)), ("without", "with"), 1, 1, pause=True)
    before = set((lab.out / "runs").iterdir())
    app.session.start(plan)

    def paused() -> bool:
        asked.add(app.session.status.asked[:5])
        return app.session.status.state == "pause"

    wait_for("the pause", paused)
    assert {"place", "let i"} <= asked
    app.session.stop("page 7")  # the second run is never begun
    (folder,) = set((lab.out / "runs").iterdir()) - before
    run = read_run(folder)
    assert (run.meta["outcome"], run.meta["arm"]) == ("completed", "without")
    assert "link" in run.meta
    assert lab.volts()[-1, 1:].tolist() == [0.0, 0.0]
