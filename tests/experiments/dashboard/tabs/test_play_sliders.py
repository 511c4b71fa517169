"""The play of the virtual table is set between runs alone: all runs of a plan are of one table."""

from math import degrees
from types import SimpleNamespace
from typing import Any

import pytest

from experiments.dashboard.tabs import play_sliders
from rig.parameters import Rig


def test_while_runs_are_made_the_play_stays(monkeypatch: pytest.MonkeyPatch):
    made: dict[str, Any] = {}

    def group(server, controls, rows, apply, **keys):
        made.update(rows=rows, apply=apply, **keys)

    monkeypatch.setattr(play_sliders, "SliderGroup", group)
    told: list[Any] = []
    session: Any = SimpleNamespace(
        rig=Rig(), status=SimpleNamespace(run=None), note=told.append, set_plant=told.append
    )
    play_sliders.play_sliders(SimpleNamespace(), SimpleNamespace(), session)  # pyright: ignore
    made["check"](1)
    made["apply"]([1.0, 2.0])
    words, rig = told
    assert words == "a new virtual table: play of gear 1.0, of joint 2.0 degrees"
    assert degrees(rig.effects["joint_backlash"]["x"]["play_rad"]) == pytest.approx(2.0)
    session.status.run = object()
    for act in (lambda: made["check"](1), lambda: made["apply"]([0.0, 0.0])):
        with pytest.raises(ValueError, match="all on one table"):
            act()
    assert len(told) == 2
