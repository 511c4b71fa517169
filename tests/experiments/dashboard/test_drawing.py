"""The thread that draws."""

import threading
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("viser")

from experiments.dashboard.app import App
from rig.log import COLUMNS


def test_a_clock_that_is_set_back_halts_no_drawing(monkeypatch):
    """Waits of `threading` go by the wall clock where Python was made for an old C library: of one
    that is set back by an hour the picture would stand still for an hour."""
    over, drawn = threading.Event(), []
    monkeypatch.setattr(over, "wait", lambda seconds: pytest.fail("waits by the wall clock"))

    def draw_once(count: int) -> None:
        drawn.append(count)
        if count == 2:
            over.set()

    app: Any = SimpleNamespace(_over=over, _draw_once=draw_once)
    App._draw(app)
    assert drawn == [0, 1, 2]


@pytest.mark.parametrize("state", ["running", "stopped", "at rest"])
def test_a_model_that_nothing_drives_any_more_is_not_drawn(state: str):
    shown: list[Any] = []
    scene = SimpleNamespace(
        pose=lambda *what: None, compare=lambda ball, ghost: shown.append(ghost)
    )
    ghost = SimpleNamespace(
        ball_m=np.zeros(2), on_plate=True, gear_twist_rad=None, joint_twist_rad=None
    )
    app: Any = SimpleNamespace(
        session=SimpleNamespace(status=SimpleNamespace(state=state, run=None)),
        scene=scene,
        gauges=SimpleNamespace(draw=lambda *what: None),
        _ghost=ghost,
        _ghost_of=None,
    )
    App._draw_table(app, np.zeros(len(COLUMNS)), seen_s=0.0)
    assert (shown[0] is None) == (state != "running")
