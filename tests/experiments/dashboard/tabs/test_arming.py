"""The tick before a real table: it ages, and is taken back."""

from types import SimpleNamespace
from typing import Any

import pytest

from experiments.dashboard.tabs import run
from experiments.dashboard.tabs.run import ARMED_S, RunTab


def tab(monkeypatch, now: list[float]) -> Any:
    """A tab Run of a real table of which only the arming is there."""
    monkeypatch.setattr(run.time, "monotonic", lambda: now[0])
    made: Any = RunTab.__new__(RunTab)
    made._session = SimpleNamespace(table=SimpleNamespace(real=True))
    made._armed = SimpleNamespace(now=True)
    made._arm_box = SimpleNamespace(value=True)
    made._armed_since_s = None
    return made


def test_an_arming_is_used_up_by_one_run(monkeypatch):
    made = tab(monkeypatch, [0.0])
    made._take_arming()
    assert not made._arm_box.value
    with pytest.raises(ValueError, match="tick Arm"):
        made._take_arming()


def test_an_arming_waits_for_a_minute(monkeypatch):
    now = [5.0]
    made = tab(monkeypatch, now)
    made._age_arming()
    now[0] += ARMED_S - 1.0
    made._age_arming()
    assert made._armed.now
    now[0] += 2.0
    made._age_arming()
    assert not made._armed.now
    assert not made._arm_box.value
    made._armed.now = True  # ticked anew: it waits a minute again
    made._age_arming()
    now[0] += ARMED_S - 1.0
    made._age_arming()
    assert made._armed.now


def test_the_next_run_begins_with_its_arming_alone(monkeypatch):
    """Pressed while a run was just ending, and not waiting yet, it began the next one unarmed."""
    made, went = tab(monkeypatch, [0.0]), []
    made._session.go_on = lambda: went.append(made._session.status.state)
    made._armed.now = False
    made._session.status = SimpleNamespace(state="running")
    made.go_on()
    made._session.status = SimpleNamespace(state="pause")
    with pytest.raises(ValueError, match="tick Arm"):
        made.go_on()
    assert went == []
    made._armed.now = True
    made.go_on()
    assert went == ["pause"]
    assert not made._armed.now
