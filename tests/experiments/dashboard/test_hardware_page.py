"""The dashboard before a table that another process serves: nothing moves that was not armed."""

import json
from collections.abc import Iterator
from types import SimpleNamespace

import pytest

from experiments.dashboard.app import App
from experiments.dashboard.server.server import open_server
from experiments.dashboard.session.plan import RunPlan
from experiments.dashboard.tabs import run
from experiments.records.recording import read_run
from experiments.runs.assemble import load_rig
from experiments.runs.protocol import read_protocol
from tests.support.patient_rig import patiently
from tests.support.rig_lab import Lab
from tests.support.waiting import wait_for

pytestmark = pytest.mark.realtime


@pytest.fixture
def lab() -> Iterator[Lab]:
    """For each try a table of its own, not homed yet."""
    with Lab() as one:
        yield one


@pytest.fixture
def app(lab: Lab) -> Iterator[App]:
    server, _ = open_server("127.0.0.1", 0, "a-token-of-some-length-for-tests")
    one = App(server, load_rig(lab.rig), lab.out, rig_file=lab.rig)
    try:
        with patiently():
            yield one
    finally:
        one.close()
        server.stop()


@pytest.mark.slow
def test_a_real_table_is_homed_and_armed_for_every_run_and_stopped_by_everybody(lab, app):
    session, tab = app.session, app.run_tab
    # Opening the page moves nothing.
    wait_for("rest", lambda: session.status.state == "stopped", 120.0)
    with pytest.raises(ValueError, match="tick Arm"):
        tab.start(None)
    with pytest.raises(ValueError, match="in a run alone"):
        session.balance()
    with pytest.raises(ValueError, match="has not been homed"):
        session.start(RunPlan(read_protocol("servo-squares"), ("with",), 1, 1))
    assert not (lab.folder / "volts").read_text()
    lab.home()
    tab._protocol.now = "servo-squares"
    tab._armed.now = True
    app.controls.stop("page 7", session.stop)  # takes the arming back
    with pytest.raises(ValueError, match="tick Arm"):
        tab.start(None)
    tab._armed.now = True
    tab.start(None)
    wait_for("motion", lambda: session.status.t_s > 1.0, 120.0)
    assert not tab._armed.now  # used up
    session.stop("page 7")
    wait_for("rest", lambda: session.status.state == "stopped", 120.0)
    (folder,) = (lab.out / "runs").iterdir()
    meta = json.loads((folder / "run.json").read_text())
    assert (meta["source"], meta["outcome"]) == ("measured", "aborted")
    assert meta["reason"].startswith("stopped by page 7")
    assert lab.volts()[-1, 1:].tolist() == [0.0, 0.0]
    with pytest.raises(ValueError, match="tick Arm"):
        tab.start(None)


@pytest.mark.slow
def test_a_person_is_told_on_the_page_and_the_table_sees_what_they_did(lab, app):
    lab.home()
    asked = set()
    plan = RunPlan(read_protocol(lab.protocol(3.0)), ("without", "with"), 1, 1, pause=True)
    app.session.start(plan)

    def paused() -> bool:
        asked.add(app.session.status.operator_step[:5])
        return app.session.status.state == "pause"

    wait_for("the pause", paused, 120.0)
    assert {"place", "let i"} <= asked
    app.session.stop("page 7")  # the second run is never begun
    (folder,) = lab.out.glob("runs/*")
    meta = read_run(folder).meta
    assert (meta["outcome"], meta["arm"]) == ("completed", "without")
    assert "link" in meta
    assert lab.volts()[-1, 1:].tolist() == [0.0, 0.0]


def test_stop_while_a_start_is_prepared_holds(lab, app, monkeypatch):
    wait_for("rest", lambda: app.session.status.state == "stopped", 120.0)
    told, tab, controls = [], app.run_tab, app.controls
    monkeypatch.setattr(controls, "_notify", lambda *what: told.append(what))
    monkeypatch.setattr(app.session.table, "check", lambda plan, rig: None)
    controls.lock = controls.lock.joined(1)

    def read_the_runs(plan, *given):  # of a whole term
        controls.stop("page 2", app.session.stop, 2)
        return plan

    monkeypatch.setattr(run, "with_new_seeds", read_the_runs)
    tab._protocol.now, tab._armed.now = "servo-squares", True
    (press,) = tab._start._impl.update_cb
    press(SimpleNamespace(client_id=1))
    wait_for("an answer", lambda: told, 20.0)
    assert told == [(1, "start", "STOP was pressed meanwhile: ask again")]
    assert not app.session._planned
    assert not (lab.out / "runs").exists()
