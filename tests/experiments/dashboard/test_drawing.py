"""The thread that draws."""

import threading
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("viser")

from experiments.dashboard.app import App


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
