"""Levelling: back to zero by the encoders, and no volts where an arm does not follow them."""

import numpy as np
import pytest

from rig.safety.levelling import Levelling, LevelOnExit, bring_level
from rig.table import Reading


def ticks(levelling: Levelling, thetas: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Volts of readings 2 ms apart."""
    return [levelling.volts(theta, 0.002 * k) for k, theta in enumerate(thetas)]


def test_volts_lead_back_in_proportion_and_up_to_a_limit():
    for most, theta, expected in (
        (6.0, (0.1, -0.2), (-1.4, 2.8)),
        (6.0, (0.5, -0.5), (-3.0, 3.0)),
        (2.0, (0.5, -0.1), (-2.0, 1.4)),
        (6.0, (np.nan, 0.1), (0.0, -1.4)),
    ):
        assert Levelling(most).volts(theta, 0.0) == pytest.approx(expected)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [-1, 1])
def test_an_arm_that_stands_still_gets_no_volts_after_80_ms_and_the_other_levels_on(axis, sign):
    theta = [0.05, 0.05]
    theta[axis] = 0.2 * sign
    given = np.array(ticks(Levelling(6.0), [(theta[0], theta[1])] * 100))
    assert np.all(given[:41, axis] == pytest.approx(-2.8 * sign))
    assert not np.any(given[43:, axis])
    assert np.all(given[:, 1 - axis] == pytest.approx(-0.7))


def test_levelling_ends_though_the_tables_time_stands_still():
    class Stopped:
        period_s, voltage_limit_V = 0.002, 6.0

        def __init__(self) -> None:
            self.reads, self.volts = 0, (9.0, 9.0)

        def read(self) -> Reading:
            self.reads += 1
            assert self.reads < 1000, "it levels for ever"
            return Reading(0.1, (0.1, 0.0), None, None)

        def drive(self, volts: tuple[float, float]) -> None:
            self.volts = volts

    table = Stopped()
    bring_level(table, 0.6)  # pyright: ignore[reportArgumentType]
    assert 300 < table.reads < 340
    assert table.volts == (0.0, 0.0)


def test_an_arm_that_goes_the_wrong_way_gets_no_volts_after_80_ms():
    given = np.array(ticks(Levelling(6.0), [(0.2 + 0.003 * k, 0.0) for k in range(100)]))
    assert np.all(given[:41, 0] < -2.0)
    assert not np.any(given[43:, 0])


def test_the_time_that_makes_a_stall_is_exact():
    one = Levelling(6.0)
    given = [one.volts((0.2, 0.0), t_s)[0] for t_s in (-1.0, 0.0, 0.08, 0.0801)]
    assert given == [*[pytest.approx(-2.8)] * 3, 0.0]


def test_it_does_not_try_again():
    still, near = [(0.2, 0.0)] * 60, [(0.1, 0.0)] * 10
    assert ticks(Levelling(6.0), [*still, *near])[-1] == (0.0, 0.0)


def test_an_arm_on_its_way_back_and_weak_volts_go_on():
    slow = [(0.5 - 0.0002 * k, 0.1) for k in range(400)]
    given = np.array(ticks(Levelling(6.0), slow))
    assert np.all(given[:, 0] < -2.0)
    assert np.all(given[:, 1] == pytest.approx(-1.4))


def arms(way: int = 1, gone_s: float = np.inf):
    """Two arms that turn as fast as their volts say; `way` -1: a plug was turned after homing."""

    class Arms(LevelOnExit):
        period_s, voltage_limit_V = 0.002, 6.0

        def __init__(self) -> None:
            self.way, self.closed, self.t_s, self.theta = way, False, 7.0, [0.3, -0.3]
            self.volts, self.driven = (0.0, 0.0), []

        def read(self) -> Reading:
            self.t_s += self.period_s
            assert self.t_s < 9.0, "it never ends"
            if self.t_s > gone_s:
                raise OSError("gone")
            for a, way in enumerate((self.way, 1)):
                moved = self.theta[a] + way * 1.6 * self.volts[a] * self.period_s
                self.theta[a] = min(max(moved, -0.6), 0.6)
            return Reading(self.t_s, (self.theta[0], self.theta[1]))

        def drive(self, volts: tuple[float, float]) -> None:
            self.volts = volts
            self.driven.append((self.t_s, *volts))
            assert len(self.driven) < 2000, "it never ends"

        def close(self) -> None:
            self.closed = True

    return Arms()


@pytest.mark.parametrize("way", [1, -1])
def test_leaving_a_context_levels_but_drives_no_arm_into_its_stop(way: int):
    with arms(way) as table:
        assert not table.driven
    after = np.array(table.driven)
    assert after[-1] == pytest.approx((7.602, 0.0, 0.0), abs=0.003)
    assert table.closed
    assert abs(table.theta[1]) < 1e-3
    if way == 1:
        assert abs(table.theta[0]) < 1e-3
    else:
        assert not np.any(after[after[:, 0] > 7.09, 1])


def test_whatever_happens_ends_at_0_volts_and_closed():
    table = arms(gone_s=7.1)
    with pytest.raises(OSError, match="gone"), table:
        pass
    assert table.driven[-1][1:] == (0.0, 0.0)
    assert table.closed


def test_a_table_that_has_ended_is_closed_only_and_keeps_why():
    table, why = arms(), OSError("the board has stopped")
    with table:
        assert table._end(why) is why
        assert table._ended is why
    assert not table.driven
    assert table.closed


def test_no_time_no_levelling():
    table = arms()
    bring_level(table, 0.0)
    assert [row[1:] for row in table.driven] == [(0.0, 0.0)]


def test_servos_that_take_an_angle_are_told_0_and_stay_told_so():
    table = arms()
    table.takes_angle = True
    bring_level(table, 0.1)
    assert len(table.driven) > 40
    assert {row[1:] for row in table.driven} == {(0.0, 0.0)}
