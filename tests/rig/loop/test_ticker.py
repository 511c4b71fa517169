"""The ticker: an absolute grid, late points counted, never two ticks for one."""

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.loop.jitter import EDGES_US, Jitter
from rig.loop.ticker import Ticker, sleep_until

pytestmark = pytest.mark.realtime

PERIOD = 0.002


class FakeClock:
    def __init__(self) -> None:
        self.now_s, self.oversleep_s = 100.0, 0.0

    def __call__(self) -> float:
        return self.now_s

    def sleep_until(self, due_s: float) -> None:
        assert due_s >= self.now_s - 1e-9  # never asked to go back: no burst
        self.now_s = max(self.now_s, due_s) + self.oversleep_s


def fake() -> tuple[Ticker, FakeClock]:
    clock = FakeClock()
    return Ticker(PERIOD, clock=clock, sleep_until=clock.sleep_until), clock


@given(st.lists(st.tuples(st.floats(0, 0.02), st.floats(0, 0.01)), max_size=80))
def test_ticks_lie_on_the_grid_and_every_point_is_a_tick_or_missed(work):
    ticker, clock = fake()
    assert ticker.wait() == 0.0
    for busy_s, oversleep_s in work:
        clock.now_s += busy_s
        clock.oversleep_s = oversleep_s
        before = clock.now_s
        late_s = ticker.wait()
        point = (clock.now_s - oversleep_s - 100.0) / PERIOD
        assert point == pytest.approx(round(point), abs=1e-4)
        assert clock.now_s - oversleep_s - before <= PERIOD + 1e-9
        assert late_s >= oversleep_s - 1e-9
        assert late_s == ticker.late_s
    points = 1 + ticker._point
    assert points == 1 + len(work) + ticker.missed
    assert ticker.late_ticks <= ticker.missed


def test_a_long_pause_is_one_late_tick_and_many_missed():
    ticker, clock = fake()
    for k in range(100):
        ticker.wait()
        clock.now_s += 0.0505 if k == 50 else 0.0005
    assert ticker.late_ticks == 1
    assert ticker.missed == 25
    assert clock.now_s == pytest.approx(100.0 + (99 + 25) * PERIOD + 0.0005)


def test_the_real_clock_is_slept_on_to_the_point():
    due_s = time.monotonic() + 0.02
    sleep_until(due_s)
    assert 0.0 <= time.monotonic() - due_s < 0.5
    sleep_until(time.monotonic() - 1.0)  # the past: at once
    ticker = Ticker(PERIOD)
    start_s = time.monotonic()
    for _ in range(26):
        ticker.wait()
    assert time.monotonic() - start_s >= 25 * PERIOD


@given(st.lists(st.floats(0.0, 0.5), min_size=1, max_size=200))
def test_the_histogram_holds_every_tick_and_bounds_its_quantiles(late: list[float]):
    jitter = Jitter(keep=100)
    for value in late:
        jitter.add(value, missed=2)
    record = jitter.record()
    assert sum(record["counts"]) == record["ticks"] == len(late)
    assert record["missed"] == 2 * len(late)
    assert record["worst_us"] == pytest.approx(1e6 * max(late), abs=0.06)
    expected, _ = np.histogram(1e6 * np.array(late), [0, *EDGES_US, np.inf])
    assert record["counts"] == expected.tolist()
    for share in (0.5, 0.99):
        wanted = np.quantile(1e6 * np.array(late), share, method="inverted_cdf")
        assert jitter.quantile_us(share) >= wanted
    assert jitter.values_us[: len(late)] == [1e6 * v for v in late[:100]]


def test_beyond_all_bins_is_counted_and_unbounded():
    jitter = Jitter()
    jitter.add(2.0)
    assert jitter.counts[-1] == 1
    assert jitter.quantile_us(0.5) == float("inf")
    assert jitter.values_us == []
