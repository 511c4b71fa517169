"""The contract of a table, one test for every table that exists."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rig.loop.paced import Paced
from rig.parameters import Rig
from rig.simulation.simulator import SimulatedTable
from rig.table import Table

CLEAN = Rig()


def simulated(rig: Rig = CLEAN, **settings) -> SimulatedTable:
    return SimulatedTable(rig, np.random.default_rng(1), **settings)


def paced(rig: Rig = CLEAN, **settings) -> Paced:
    return Paced(simulated(rig, **settings), clock=lambda: 0.0, sleep=lambda s: None)


MAKERS = pytest.mark.parametrize("make", [simulated, paced], ids=["simulated", "paced"])


@MAKERS
def test_time_strictly_increases(make: Callable[..., Table]):
    table = make()
    times = [table.read().t_s for _ in range(500)]
    assert np.all(np.diff(times) > 0)
    assert np.allclose(np.diff(times), table.period_s)


@MAKERS
def test_an_observation_is_usable_only_after_its_exposure_and_delay(make: Callable[..., Table]):
    table, seen = make(), []
    for _ in range(1000):
        reading = table.read()
        if reading.ball is not None:
            seen.append(reading.ball.exposed_s)
            assert reading.t_s >= reading.ball.exposed_s + CLEAN.camera.delay_s - 1e-9
            assert reading.t_s <= reading.ball.exposed_s + CLEAN.camera.delay_s + table.period_s
    assert np.all(np.diff(seen) > 0)
    assert len(seen) == pytest.approx(2.0 * CLEAN.camera.rate_hz, abs=2)


@MAKERS
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [-1, 1])
def test_positive_volts_raise_the_angle_and_the_angle_accelerates_the_ball(
    make: Callable[..., Table], axis: int, sign: int
):
    table = make()
    volts = [0.0, 0.0]
    volts[axis] = 2.0 * sign
    reading = table.read()
    ball = (0.0, 0.0)
    for _ in range(250):
        table.drive((volts[0], volts[1]) if sign * reading.theta_rad[axis] < 0.2 else (0.0, 0.0))
        reading = table.read()
        ball = reading.ball.xy_m if reading.ball else ball
    assert sign * reading.theta_rad[axis] > 0.1
    assert abs(reading.theta_rad[1 - axis]) < 0.01
    assert sign * ball[axis] > 0.005
    assert abs(ball[1 - axis]) < 0.002


def test_volts_that_are_no_numbers_are_refused():
    with pytest.raises(ValueError, match="finite"):
        simulated().drive((float("nan"), 0.0))


def test_a_table_without_tachometers_says_none():
    rig = replace(CLEAN, servo=replace(CLEAN.servo, tachometer=False))
    assert simulated(rig).read().motor_speed_rad_s is None
    assert simulated().read().motor_speed_rad_s is not None


def test_paced_counts_late_ticks_and_never_catches_up_in_a_burst():
    now, slept = [0.0], []

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        now[0] += seconds

    table = Paced(simulated(), clock=lambda: now[0], sleep=sleep)
    for i in range(100):
        table.read()
        now[0] += 0.05 if i == 50 else 0.0005  # one tick takes 25 periods
    assert table.late_ticks == 1
    assert len(slept) >= 98
    assert max(slept) <= table.period_s + 1e-12
    assert now[0] == pytest.approx(0.05 + 100 * table.period_s, abs=3 * table.period_s)


def test_a_simulated_table_is_level_once_it_is_left_but_not_by_a_signal():
    """Nobody's arms: to level them, the plant was compiled for half a minute after the signal."""
    with simulated() as table:
        table.read()
        table.drive((3.0, 3.0))
        for _ in range(50):
            before = table.read()
    assert np.abs(table.read().theta_rad).max() < 0.2 * np.abs(before.theta_rad).max()
    with pytest.raises(KeyboardInterrupt), simulated() as table:  # noqa: PT012
        table.drive((3.0, 3.0))
        raise KeyboardInterrupt
    assert table.read().t_s == 0.0
    assert table.volts_V == (0.0, 0.0)
