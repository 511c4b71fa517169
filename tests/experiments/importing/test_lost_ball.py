"""A ball that is lost in one coordinate, once, or while its last place is held."""

import numpy as np
import pytest

from experiments.importing.absent_ball import alone_codes, gone, held_rows
from experiments.importing.conversion import convert
from experiments.importing.import_map import stated
from experiments.importing.proposal import propose
from experiments.importing.recording import Stream
from tests.experiments.importing.test_absent_ball import path
from tests.support.other_labs.bench import run

ROWS = 1500
SECONDS = np.arange(ROWS) / 50.0


def place(seed: int, *, centre: float = 140.0, whole: bool = False) -> np.ndarray:
    """One coordinate [mm] of a ball that is steered about `centre`."""
    values = path(np.random.default_rng(seed))[:, 0] - 140.0 + centre
    return np.round(values) if whole else values


@pytest.mark.parametrize("code", [0.0, -1.0, 255.0, 999.0, 65535.0])
@pytest.mark.parametrize("lost", [slice(600, 700), slice(0, 80), slice(1400, None), [3, 400, 900]])
def test_a_code_of_one_coordinate(code: float, lost):
    values = place(0)
    values[lost] = code
    assert alone_codes(values, SECONDS) == ((code,), ())


@pytest.mark.parametrize("code", [-500.0, 999.0, 65535.0, 1e9])
def test_a_code_that_occurs_once_far_from_all_else(code: float):
    values = place(1)
    values[700] = code
    assert alone_codes(values, SECONDS) == ((code,), ())


@pytest.mark.parametrize("whole", [False, True])
def test_a_code_amid_the_places_is_asked_for(whole: bool):
    """Whole millimetres: the ball rolls over it, too, and 0 is right there."""
    values = place(2, centre=0.0, whole=whole)
    values[600:700] = 0.0
    assert alone_codes(values, SECONDS) == ((), (0.0,))


@pytest.mark.parametrize("seed", range(5))
def test_a_ball_that_is_seen_has_neither_code_nor_held_places(seed: int):
    both = path(np.random.default_rng(seed)) - 140.0
    coarse = [np.round(both), 5 * np.round(both / 5)]
    for points in (both, *coarse):
        assert [alone_codes(one, SECONDS) for one in points.T] == [((), ())] * 2
        assert held_rows(list(points.T), SECONDS) == (0, True)


def moved_and_rested(step: float) -> list[np.ndarray]:
    """A ball that rests for 50 rows at each of 15 places, read without noise to `step` mm."""
    k = np.arange(ROWS)
    level, share = k // 100, np.clip(k % 100 / 50, 0, 1)
    ends = np.random.default_rng(3).uniform(-50, 50, (2, 17))
    ease = (1 - np.cos(np.pi * share)) / 2
    return [
        step * np.round((one[level] * (1 - ease) + one[level + 1] * ease) / step) for one in ends
    ]


@pytest.mark.parametrize("step", [0.001, 1.0, 5.0])
def test_a_ball_at_rest_is_not_held(step: float):
    assert held_rows(moved_and_rested(step), SECONDS) == (0, True)


def lost(columns: list[np.ndarray], every: int = 300, rows: int = 120) -> np.ndarray:
    """Hold the place of every so many rows in place; rows (n,) of the ball that was lost."""
    out = np.zeros(len(columns[0]), bool)
    for start in range(100, len(out) - rows, every):
        for values in columns:
            values[start : start + rows] = values[start - 1]
        out[start : start + rows] = True
    return out


@pytest.mark.parametrize("rows_a_frame", [1, 4])
def test_places_that_are_held(rows_a_frame: int):
    columns = [np.repeat(one, rows_a_frame)[:ROWS] for one in path(np.random.default_rng(4)).T]
    out = lost(columns)
    held, sure = held_rows(columns, SECONDS)
    assert (held, sure) == (3 * rows_a_frame if rows_a_frame > 3 else 10, True)
    found = gone(columns, held=held)
    assert found[out].mean() > 0.99
    assert (found & ~out).sum() <= 2 * rows_a_frame * out.sum() / 120


def test_places_that_are_held_beside_more_at_which_it_rests_are_asked_for():
    columns = moved_and_rested(1.0)
    lost(columns, every=500, rows=60)
    assert held_rows(columns, SECONDS)[1] is False


def test_one_place_that_is_held_is_asked_about_as_such():
    """It was asked about as a code, which leaves in the places that are held for less."""
    columns = [place(seed) for seed in (5, 6)]
    for values in columns:
        values[600:740] = values[600]
    assert held_rows(columns, SECONDS) == (10, False)
    assert gone(columns, held=10).sum() == 139


@pytest.mark.parametrize("frame", [1, 3])
@pytest.mark.parametrize("speed", [5, 15])
def test_a_ball_that_is_pushed_again_and_again_is_a_ball(frame: int, speed: int):
    """It rests but for a whole millimetre, is pushed to the rim, bounces, and comes to rest
    elsewhere: fast rows are few, and each place is passed several times."""
    rng = np.random.default_rng(5)
    x = []
    for rest in (0, 20, -15, 5, 0, 10, -20, 15):
        out = np.arange(x[-1] if x else 0, 60, speed)
        back = np.arange(60, rest, -speed)
        x += [*out, *back, *(rest + rng.integers(0, 2, 5000)), *[rest] * 60]
    values = np.repeat(np.array(x, float), frame)
    seconds = np.arange(len(values)) / 50.0
    assert alone_codes(values, seconds) == ((), ())
    assert held_rows([values, 0 * values], seconds) == (0, True)


def test_a_ball_that_is_never_seen_has_no_code():
    nothing = np.full(ROWS, np.nan)
    assert alone_codes(nothing, SECONDS) == ((), ())
    assert held_rows([nothing, nothing], SECONDS) == (0, True)
    assert gone([nothing, nothing], held=12).all()


def test_sessions_that_end_at_rest_and_begin_elsewhere_hold_nothing():
    columns, apart = moved_and_rested(1.0), 10.0 * (np.arange(ROWS) // 300)
    for values in columns:
        values[:] = values.reshape(5, 300)[[0, 3, 1, 4, 2]].ravel()
    assert held_rows(columns, SECONDS + apart) == (0, True)
    assert all(alone_codes(values, SECONDS + apart) == ((), ()) for values in columns)


@pytest.fixture(scope="module")
def bench() -> dict[str, np.ndarray]:
    x, y = run(0, course_kind="squares"), run(1, course_kind="squares")
    names = ("ball x [mm]", "ball y [mm]", "servo x cmd [deg]", "servo y cmd [deg]", "t [s]")
    ball = []
    for one in (x, y):
        there = np.isfinite(one.seen)
        ball.append(1000 * np.interp(one.t, one.t[there], np.round(one.seen[there], 6)))
    return dict(zip(names, (*ball, *np.degrees([x.command, y.command]), x.t), strict=True))


def blank(columns: dict[str, np.ndarray]) -> np.ndarray:
    """Make two of three cells of the ball blank, as of a camera that is slower; rows (n,) kept."""
    kept = np.arange(len(columns["t [s]"])) % 3 == 0
    for name in ("ball x [mm]", "ball y [mm]"):
        columns[name][~kept] = np.nan
    return kept


def seen(columns: dict[str, np.ndarray], *said: str) -> np.ndarray:
    """Rows (n,) of the log in which there is a ball; nothing may be asked."""
    stream = Stream(columns)
    found = propose(stream, stated(said))
    assert found.doubts == ()
    (log,) = convert(stream, found.map())
    return np.isfinite(log["ball_x_m"]) & np.isfinite(log["ball_y_m"])


def test_the_log_has_no_ball_where_one_coordinate_has_a_code(bench):
    columns = {name: values.copy() for name, values in bench.items()}
    columns["ball x [mm]"][1000:1100] = 999.0
    columns["ball y [mm]"][2000] = 65535.0
    at = 2500 + int(np.argmin(np.abs(columns["ball y [mm]"][2500:3500])))
    columns["ball y [mm]"][at : at + 100] = 0.0
    asked = propose(Stream(columns)).doubts
    assert [doubt.option for doubt in asked] == [
        "--set ball_y_m.absent_alone=65535.0,0.0 or 65535.0"
    ]
    lost_rows = ~seen(columns, "ball_y_m.absent_alone=65535,0")
    assert np.flatnonzero(lost_rows).tolist() == [*range(1000, 1100), 2000, *range(at, at + 100)]
    assert not seen(columns, "ball_y_m.absent_alone=none")[1000:1100].any()
    kept = blank(columns)
    np.testing.assert_array_equal(seen(columns, "ball_y_m.absent_alone=65535,0"), kept & ~lost_rows)
    assert not seen(columns, "ball_y_m.absent_alone=none")[1000:1100].any()


def test_the_log_has_no_ball_where_its_last_place_was_held(bench):
    columns = {name: values.copy() for name, values in bench.items()}
    out = lost([columns["ball x [mm]"], columns["ball y [mm]"]], every=600, rows=200)
    np.testing.assert_array_equal(seen(columns), ~out)
    assert seen(columns, "ball.held_rows=0", "ball.absent=none").all()
    kept = blank(columns)
    again = seen(columns)
    assert again[kept & ~out].all()
    assert again[out].sum() <= 7  # the first of each


def test_a_code_far_out_makes_no_unit_doubtful(bench):
    columns = {name: values.copy() for name, values in bench.items()}
    for name in ("ball x [mm]", "ball y [mm]"):
        columns[name][1000:1200] = 65535.0
    assert np.flatnonzero(~seen(columns)).tolist() == list(range(1000, 1200))
