"""What the big view is told of the live table."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from experiments.dashboard.session.live import LiveState
from experiments.dashboard.session.plan import RunPlan, SessionStatus, planned_runs
from experiments.dashboard.view import camera_view, elapsed
from experiments.dashboard.view.big_view import POINTS, big_view
from experiments.runs.protocol import parse
from rig.log import COLUMNS, INDEX
from rig.parameters import Rig

PROTOCOL = parse({"title": "let go", "duration_s": 10.0}, label="short", name="short")
TARGET = [INDEX["target_x_m"], INDEX["target_y_m"]]


def rows(n: int = 5000, step_s: float = 0.004) -> np.ndarray:
    """A ball that rests 3 cm right of and 4 cm behind its target, and before that is not seen."""
    found = np.zeros((n, len(COLUMNS)))
    found[:, 0] = step_s * np.arange(n)
    found[:, TARGET] = 0.01
    found[:, INDEX["ball_x_m"]], found[:, INDEX["ball_y_m"]] = 0.04, 0.05
    found[: n // 4, [INDEX["ball_x_m"], INDEX["ball_y_m"]]] = np.nan
    return found


def state(row: np.ndarray | None, seen_s: float = 0.0) -> LiveState:
    return LiveState(row, seen_s, (0.0, 0.0, 0.0), 500.0, 0.0, 1)


def test_a_run_is_told_with_its_ball_its_target_and_how_far_off_it_is():
    curve = rows()
    planned = planned_runs(RunPlan(PROTOCOL, ("without", "with"), 1, 1))[1]
    status = SessionStatus("running", "", planned, 7.0, "place the ball")
    found = big_view(Rig(), state(curve[-1], curve[-1, 0]), status, curve)
    assert found["ball_m"] == [0.04, 0.05]
    assert found["target_m"] == [0.01, 0.01]
    assert found["rms_m"] == pytest.approx(0.05)
    assert (found["title"], found["run"]) == ("let go", "run 2 of 2, with play compensation")
    assert (found["t_s"], found["duration_s"]) == (7.0, planned.plan.protocol.start.hold_s + 10.0)
    assert found["ask"] == "place the ball"
    assert len(found["curve"]["t_s"]) == len(found["curve"]["y_m"]) <= POINTS
    assert found["curve"]["x_m"][0] is None
    assert found["curve"]["x_m"][-1] == 0.04
    assert json.loads(json.dumps(found, allow_nan=False)) == found


@pytest.mark.parametrize("curve", [np.empty((0, len(COLUMNS))), np.full((3, len(COLUMNS)), np.nan)])
def test_what_is_not_known_is_told_as_nothing(curve: np.ndarray):
    for row in (None, np.full(len(COLUMNS), np.nan)):
        found = big_view(Rig(), state(row, np.nan), SessionStatus("stopped"), curve)
        assert found["ball_m"] is found["rms_m"] is found["t_s"] is None
        assert found["target_m"] == [0.0, 0.0]
        json.dumps(found, allow_nan=False)


def test_a_ball_that_was_seen_too_long_ago_is_not_shown():
    curve = rows()
    found = big_view(Rig(), state(curve[-1], curve[-1, 0] - 0.4), SessionStatus("balancing"), curve)
    assert found["ball_m"] is None
    assert (found["title"], found["run"]) == ("", "balancing, without play compensation")


def test_a_table_that_rests_says_so_and_shows_nothing_as_if_it_were_live():
    curve = rows()
    newest = state(curve[-1], curve[-1, 0])
    for name, words in (("stopped", "stopped"), ("at rest", "stopped"), ("starting", "starting")):
        found = big_view(Rig(), newest, SessionStatus(name), curve)
        assert found["run"] == words
        assert (found["ball_m"] is None) == (found["rms_m"] is None) == (words == "stopped")


def test_how_long_a_camera_has_been_starting_is_counted(monkeypatch):
    now_s = [100.0]
    monkeypatch.setattr(elapsed.time, "monotonic", lambda: now_s[0])
    picture = camera_view.CameraPicture.__new__(camera_view.CameraPicture)
    picture._frustum, picture._picture = SimpleNamespace(visible=False), SimpleNamespace(content="")
    picture.jpeg, picture._waits = b"", None
    for later_s, words in ((0.0, ", 0 s so far"), (7.2, ", 7 s so far")):
        now_s[0] = 100.0 + later_s
        picture.wait()
        assert words in picture._picture.content
    picture.show(np.zeros((4, 4, 3), np.uint8), "a ball")
    picture.wait()
    assert "a ball" in picture._picture.content
    picture.hide("The camera cannot be looked through: gone")
    picture.wait()
    assert "gone" in picture._picture.content
