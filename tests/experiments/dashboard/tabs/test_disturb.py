"""Pushes, targets and gains of the tab Run: greyed as long as they would be refused."""

from types import SimpleNamespace
from typing import Any

import pytest

from experiments.dashboard.server.controls import ControlLock, Controls
from experiments.dashboard.server.server import open_server
from experiments.dashboard.session.plan import SessionStatus
from experiments.dashboard.session.session import Session
from experiments.dashboard.tabs.run import DISTURB, RunTab
from rig.parameters import Rig
from tests.support.greyed import why


class StillSession:
    """A session of the virtual table or a real one, whose state is set by hand."""

    def __init__(self, *, real: bool) -> None:
        self.rig, self.table = Rig(), SimpleNamespace(real=real)
        self.status, self._loop = SessionStatus("stopped"), None

    check_moves = Session.check_moves


@pytest.fixture
def made(tmp_path):
    server, _ = open_server("127.0.0.1", 0, "a-token-of-some-length-for-tests")
    controls = Controls(lambda *what: None, print)
    controls.lock = ControlLock().joined(1)

    def tab(*, real: bool = False) -> tuple[Any, dict[str, Any]]:
        session: Any = StillSession(real=real)
        one = RunTab(server, controls, session, tmp_path, lambda page: None)
        return one, {handle.label: handle for handle, _ in controls.checks.values()}

    yield tab, controls
    controls.queue.close()
    server.stop()


def test_pushes_are_greyed_at_rest_and_with_the_gains_in_a_recorded_run_without_the_tick(made):
    tab, controls = made
    one, handles = tab()
    moves = [handles[label] for label in ("Push", "Send the ball back to the middle")]
    gain = handles["P [rad/m]"]
    assert {why(controls, each) for each in moves} == {
        "nothing moves: press Balance or start a run"
    }
    assert why(controls, gain) == ""
    one._session._loop, one._session.status = object(), SessionStatus("balancing")
    assert {why(controls, each) for each in moves} == {""}
    one._session.status = SessionStatus("running")
    assert {why(controls, each) for each in (*moves, gain)} == {
        f"a run is being recorded: {DISTURB}"
    }
    one._disturb.now = True
    assert {why(controls, each) for each in (*moves, gain)} == {""}


def test_a_real_table_starts_armed_alone(made):
    tab, controls = made
    one, handles = tab(real=True)
    for label in ("▶ Start", "Next run", "Repeat the last run"):
        assert why(controls, handles[label]).endswith("tick Arm")
    one._armed.now = True
    assert why(controls, handles["▶ Start"]) == ""
