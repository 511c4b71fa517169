"""How long the other side is silent: to its looks, a stalled machine, and one that hangs."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.loop import silence
from rig.loop.silence import LOOK_S, Silence

STEPS = st.lists(st.floats(1e-4, LOOK_S), min_size=1, max_size=50)


class Clock:
    def __init__(self) -> None:
        self.now_s = 1000.0

    def monotonic(self) -> float:
        return self.now_s


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(silence, "time", made)
    return made


def heard(steps: list[float], clock: Clock, listener: Silence, beat_s: float) -> float:
    """The silence after looks at these steps [s], no sign of life among them."""
    for step in steps:
        clock.now_s += step
        found = listener.seconds(beat_s)
    return found


@given(steps=STEPS)
def test_to_one_that_looks_often_it_is_the_time_since_the_last_sign(steps: list[float]):
    with pytest.MonkeyPatch.context() as patch:
        clock = Clock()
        patch.setattr(silence, "time", clock)
        listener, beat_s = Silence(), clock.now_s
        assert heard(steps, clock, listener, beat_s) == pytest.approx(clock.now_s - beat_s)


@given(before=STEPS, stall=st.floats(1.0, 1e5), after=STEPS)
def test_a_machine_that_stands_still_is_not_the_silence_of_the_other(before, stall, after):
    with pytest.MonkeyPatch.context() as patch:
        clock = Clock()
        patch.setattr(silence, "time", clock)
        listener, beat_s = Silence(), clock.now_s
        heard([*before, stall], clock, listener, beat_s)
        told = heard(after, clock, listener, beat_s)
        assert told == pytest.approx(sum(before) + LOOK_S + sum(after))


@pytest.mark.parametrize("since_look_s", [0.0, 0.01])
def test_a_sign_between_the_last_look_and_a_stall_counts(clock: Clock, since_look_s: float):
    listener = Silence()
    listener.seconds(clock.now_s)
    clock.now_s += since_look_s
    beat_s = clock.now_s
    clock.now_s += 30.0
    assert listener.seconds(beat_s) == pytest.approx(LOOK_S)


def test_one_that_hangs_is_heard_to_hang_after_a_stall_too(clock: Clock):
    listener, beat_s = Silence(), clock.now_s
    told = heard([5.0, *[0.002] * 1500], clock, listener, beat_s)
    assert told == pytest.approx(LOOK_S + 3.0)


def test_a_new_sign_of_life_ends_the_silence(clock: Clock):
    listener = Silence()
    heard([0.05] * 40, clock, listener, 1000.0)
    assert listener.seconds(clock.now_s) == 0.0
    assert heard([0.05], clock, listener, clock.now_s) == pytest.approx(0.05)
