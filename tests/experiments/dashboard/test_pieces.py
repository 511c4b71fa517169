"""The dashboard's small pieces: clamps, plan, teeth, film."""

from contextlib import suppress
from dataclasses import replace
from math import inf, isfinite, nan, radians

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.analysis.samples import held
from experiments.dashboard.server.input_limits import BACKLASH_DEG, KP, choice, on_plate
from experiments.dashboard.session.live import POINTS, LiveBuffer
from experiments.dashboard.session.plan import RunPlan, SessionStatus, planned_runs
from experiments.dashboard.session.playback import PlaybackClock
from experiments.dashboard.view.curves import (
    CHARTS,
    X,
    chart_data,
    has_data,
    values_at,
    with_lines,
)
from experiments.dashboard.view.pose import gauges, linkage, plate_point, plate_wxyz, quaternion
from experiments.runs.protocol import read_protocol
from rig.log import COLUMNS, INDEX
from rig.parameters import Rig
from rig.plant.ball import plate_rotation

# --- clamps ---
ANYTHING = st.one_of(
    st.floats(), st.integers(), st.text(), st.none(), st.booleans(), st.lists(st.floats())
)


@given(ANYTHING)
def test_whatever_a_page_sends_is_within_the_limits_or_refused(value):
    with suppress(ValueError):  # and nothing else
        assert KP.low <= KP.clamp(value) <= KP.high


@pytest.mark.parametrize("value", [nan, inf, -inf, True, None, "abc", "1", [1.0]])
def test_what_is_no_number_is_refused(value):
    with pytest.raises(ValueError, match="no number"):
        BACKLASH_DEG.clamp(value)


@given(ANYTHING)
def test_a_choice_is_one_of_the_options(value):
    with suppress(ValueError):  # and nothing else
        assert choice(value, ("a", "b")) in ("a", "b")


@given(st.floats(-10, 10), st.floats(-10, 10))
def test_a_target_stays_on_the_plate(x, y):
    assert max(map(abs, on_plate((x, y), 0.275, 0.02))) <= 0.1375 - 0.02 + 1e-12


# --- plan ---
def test_a_plan_pairs_the_arms_of_a_seed():
    plan = RunPlan(read_protocol("free-release"), ("without", "with"), 2, 5, speed=2.0)
    found = [
        (planned.seed, planned.method, planned.number, planned.of) for planned in planned_runs(plan)
    ]
    assert found == [
        (5, "without", 1, 4),
        (5, "with", 2, 4),
        (6, "without", 3, 4),
        (6, "with", 4, 4),
    ]
    status = SessionStatus("running", run=planned_runs(plan)[1], t_s=8.25)
    assert status.share == pytest.approx(0.375)
    assert status.remaining_s == pytest.approx(2.5 * 16.5 / 2)
    assert replace(status, t_s=99.0).share == 0.5


# --- geometry ---
@given(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6))
def test_rods_keep_their_length_and_the_plate_follows_the_arms(x, y):
    rig, theta = Rig(), np.array([x, y])
    still = [linkage(a, np.zeros(2), rig) for a in range(2)]
    for axis in range(2):
        shaft, tip, edge = linkage(axis, theta, rig)
        assert np.linalg.norm(tip - shaft) == pytest.approx(rig.linkage.arm_radius_m)
        rod = np.linalg.norm(still[axis][2] - still[axis][1])
        assert np.linalg.norm(edge - tip) == pytest.approx(rod, abs=0.004)  # a ball joint's play
        assert (edge[2] < still[axis][2][2] + 1e-9) == (theta[axis] > -1e-9) or abs(
            theta[axis]
        ) < 0.02


@given(st.floats(-0.08, 0.08), st.floats(-0.08, 0.08))
def test_quaternion_is_the_rotation(x, y):
    import viser.transforms as tf

    rotation = plate_rotation((x, y))
    assert np.allclose(tf.SO3(quaternion(rotation)).as_matrix(), rotation, atol=1e-12)
    assert np.isclose(np.linalg.norm(plate_wxyz(np.array([x, y]), Rig())), 1.0)


@given(st.floats(0, 0.05), st.floats(-0.1, 0.1))
def test_a_tooth_never_leaves_its_gap_and_touches_at_its_ends(play, twist):
    half, at, touches = gauges(play, twist, Rig())
    assert abs(at) <= half + 1e-12
    if abs(twist) < play / 2 - 1e-4:
        assert touches == 0
    if abs(twist) > play / 2 + 1e-4:
        assert touches == np.sign(twist)


def test_a_click_meets_the_plate():
    point = plate_point(np.array([0.1, 0.0, 1.0]), np.array([0.0, 0.05, -1.0]))
    assert point == pytest.approx([0.1, 0.05])
    assert plate_point(np.array([0, 0, 1.0]), np.array([0, 0, 1.0])) is None
    assert plate_point(np.array([0, 0, 1.0]), np.array([1.0, 0, 0.0])) is None


# --- curves and rows ---
def test_blanks_are_held_and_curves_are_thinned():
    assert list(held(np.array([nan, 1.0, nan, nan, 2.0]))) == [0.0, 1.0, 1.0, 1.0, 2.0]
    live = LiveBuffer(500.0)
    row = np.full(len(COLUMNS), nan)
    for tick in range(12000):
        row[0] = tick / 500
        row[INDEX["ball_x_m"]] = row[INDEX["ball_y_m"]] = 0.01 if tick % 8 == 0 else nan
        live.add(row)
    rows = live.curve()
    assert rows.shape == (POINTS, len(COLUMNS))
    assert rows[-1, 0] - rows[0, 0] == pytest.approx(20.0, abs=0.1)
    assert np.all(rows[:, INDEX["ball_x_m"]] == 0.01)
    for chart in CHARTS:
        data = chart_data(chart, rows)
        assert all(np.isfinite(part).all() and len(part) == POINTS for part in data)
    assert live.now().row is not None
    assert len(live.unread()) <= 2048
    assert live.unread() == []


def test_a_run_that_just_began_has_curves_without_rows():
    live = LiveBuffer(500.0)
    assert live.curve().shape == (0, len(COLUMNS))
    for chart in CHARTS:
        assert not has_data(chart, live.curve())
        assert all(len(part) == 2 for part in chart_data(chart, live.curve()))


# --- curves of a film ---
def test_a_films_curves_have_a_line_at_its_time_and_at_every_event():
    t_s = np.linspace(0.0, 20.0, 250)
    times, curve, at, events = with_lines((t_s, np.sin(t_s)), 3.21, [0.5, 9.0, 99.0])
    assert np.all(np.diff(times) > 0)
    assert times[at == 1.0] == pytest.approx([3.21])
    assert times[events == 1.0] == pytest.approx([0.5, 9.0])  # the last lies in another part
    for line in (at, events):
        assert line[0] == line[-1] == 0.0
        assert np.ptp(times[line > 0]) > 0 or line.sum() == 1
    assert np.interp(3.0, times, curve) == pytest.approx(np.sin(3.0), abs=0.1)
    assert len(with_lines((t_s, t_s), 0.0, [])[0]) >= len(t_s)  # the first moment, no event


def test_a_films_values_are_those_of_its_time_and_blank_where_nothing_is_known():
    rows = np.full((200, len(COLUMNS)), np.nan)
    rows[:, 0] = np.arange(200) / 10
    rows[::10, INDEX["ball_x_m"]] = rows[::10, 0] / 100
    rows[:, INDEX["theta_y_rad"]] = radians(2.0)
    said = values_at(CHARTS, {"with": rows}, 5.05)
    assert "At 5.05 s" in said
    assert "+5.00" in said  # cm, as it was seen last
    assert "+2.00" in said
    assert "dashed" not in said  # numbers have no lines
    assert said.count("></td>") == 1 + 8  # five charts of two values, two of which are known
    both = values_at(CHARTS, {"with": rows, "without": rows - 0.01}, 5.05)
    assert (
        both.index(">with<") < both.index(">without<") < both.index("+5.00") < both.index("+4.00")
    )
    lines = both.split("<tr>")[1:]
    assert [one.count("<td") for one in lines] == [3] * 11  # narrow: a line an axis
    assert "ball x [cm]" in lines[1]
    assert "ball y [cm]" in lines[2]
    for words in (said, both):
        assert "var(--rig-x, " in words  # read on light and on dark
        assert f"color: {X}" not in words
    assert [has_data(chart, rows) for chart in CHARTS] == [True, True, False, False, False]


# --- film ---
def test_a_film_plays_scrubs_and_stops_at_its_end():
    now = [0.0]
    player = PlaybackClock(10.0, clock=lambda: now[0])
    player.play(True)
    now[0] = 2.0
    assert player.t_s == 2.0
    player.set_speed(4.0)
    now[0] = 3.0
    assert player.t_s == 6.0
    player.seek(99.0)
    assert player.t_s == 10.0
    assert not player.playing
    player.play(True)  # from its end it starts anew
    assert player.t_s == 0.0
    now[0] = 100.0
    assert player.t_s == 10.0
    assert isfinite(radians(player.t_s))
