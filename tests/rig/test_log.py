"""The log in memory: names, shapes, blanks, and which ball values are new observations."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from rig.log import COLUMNS, CONTRACT, INDEX, NAMES, Log, Phase, blank_row, exposures

ANY = st.floats(allow_nan=True, allow_infinity=True, width=64)


def ball_log(x, y, **more):
    columns = {"t_s": np.arange(len(x)) * 0.002, "ball_x_m": x, "ball_y_m": y, **more}
    return Log.from_columns({name: np.asarray(v, float) for name, v in columns.items()})


def test_columns_start_with_the_contract_in_its_order():
    assert " ".join(CONTRACT) == (
        "t_s voltage_x_V voltage_y_V theta_x_rad theta_y_rad ball_x_m ball_y_m "
        "motor_speed_x_rad_s motor_speed_y_rad_s target_x_m target_y_m push ball_exposed_s "
        "command_x_rad command_y_rad"
    )
    assert len(set(NAMES)) == len(COLUMNS) == 33
    assert all(column.unit and column.meaning for column in COLUMNS)


def test_a_name_ends_in_its_unit():
    suffix = {"s": "s", "V": "V", "rad": "rad", "rad/s": "rad_s", "m": "m", "m2": "m2"}
    suffix["N m"] = "Nm"
    for column in COLUMNS:
        if column.unit != "1":
            assert column.name.endswith("_" + suffix[column.unit])


@settings(max_examples=30)
@given(arrays(np.float64, st.tuples(st.integers(0, 6), st.just(len(COLUMNS))), elements=ANY))
def test_rows_come_back_bit_for_bit(rows):
    log = Log.from_rows(rows)
    assert len(log) == len(rows)
    for name, column in log.columns.items():
        assert column.dtype == np.float64
        assert column.tobytes() == rows[:, INDEX[name]].tobytes()
        assert log[name].tobytes() == column.tobytes()


def test_a_log_is_a_copy_that_nobody_can_change():
    rows = np.zeros((3, len(COLUMNS)))
    log = Log.from_rows(rows)
    rows[:] = 7.0
    assert (log["t_s"] == 0.0).all()
    with pytest.raises(ValueError, match="read-only"):
        log["t_s"][0] = 1.0


def test_missing_columns_are_blank():
    log = Log.from_columns({"t_s": np.arange(3.0), "theta_x_rad": np.zeros(3)})
    assert log.has("t_s", "theta_x_rad")
    assert not log.has("t_s", "ball_x_m")
    assert np.isnan(log["ball_x_m"]).all()
    times, xy = log.ball()
    assert times.shape == (0,)
    assert xy.shape == (0, 2)


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"time": np.zeros(2)}, "unknown columns time"),
        ({}, "one length"),
        ({"t_s": np.zeros(2), "push": np.zeros(3)}, "one length"),
        ({"t_s": np.zeros((2, 1))}, "one length"),
    ],
)
def test_bad_columns_are_refused(columns, words):
    with pytest.raises(ValueError, match=words):
        Log.from_columns(columns)


@pytest.mark.parametrize("shape", [(3, 5), (31,), (2, 31, 1)])
def test_bad_rows_are_refused(shape):
    with pytest.raises(ValueError, match="COLUMNS"):
        Log.from_rows(np.zeros(shape))


def test_an_unknown_column_names_the_known_ones():
    with pytest.raises(KeyError, match="ball_x_m"):
        Log.from_rows(np.zeros((1, len(COLUMNS))))["ball_z_m"]


def test_ball_keeps_new_observations_and_their_exposure():
    nan = np.nan
    log = ball_log(
        [nan, 0.1, nan, 0.1, nan], [nan, 0.2, nan, 0.2, nan], ball_exposed_s=[nan, -0.01, nan, 0, 0]
    )
    times, xy = log.ball()
    np.testing.assert_array_equal(times, [-0.01, 0.0])
    np.testing.assert_array_equal(xy, [[0.1, 0.2], [0.1, 0.2]])


def test_ball_without_exposure_uses_the_tick_minus_the_delay():
    log = ball_log([np.nan, 0.1, np.nan], [np.nan, 0.2, np.nan])
    np.testing.assert_allclose(log.ball()[0], [0.002])
    np.testing.assert_allclose(log.ball(delay_s=0.012)[0], [-0.010])


def test_exposures_that_are_missing_or_of_another_clock_are_by_the_ticks():
    t, told = np.array([1.0, 2.0, 3.0]), np.array([0.9, np.nan, 1.7e9])
    np.testing.assert_allclose(exposures(t, told, 0.25), [0.9, 1.75, 2.75])


@settings(max_examples=50)
@given(
    st.lists(st.tuples(st.integers(-3, 3), st.integers(1, 9)), min_size=1, max_size=20),
    st.booleans(),
)
def test_held_values_are_thinned_to_what_a_blank_log_says(frames, with_exposure):
    """Frames held for some ticks give the observations of the same log with blanks."""
    frames = [(k + 10 * (i % 2), ticks) for i, (k, ticks) in enumerate(frames)]  # all differ
    held, blank, exposed = [], [], []
    for i, (value, ticks) in enumerate(frames):
        held += [value] * ticks
        blank += [value] + [np.nan] * (ticks - 1)
        exposed += [i / 60] * ticks
    more = {"ball_exposed_s": exposed} if with_exposure else {}
    a, b = ball_log(held, held, **more), ball_log(blank, blank, **more)
    for left, right in zip(a.ball(), b.ball(), strict=True):
        np.testing.assert_array_equal(left, right)
    assert len(a.ball()[0]) == len(frames)


def test_a_ball_at_rest_with_exposures_stays_seen():
    log = ball_log([0.1] * 4, [0.2] * 4, ball_exposed_s=[0.0, 0.0, 0.017, 0.017])
    np.testing.assert_array_equal(log.ball()[0], [0.0, 0.017])


def test_one_missing_axis_leaves_the_other():
    log = ball_log([0.1, 0.1, 0.3], [np.nan] * 3)
    times, xy = log.ball()
    np.testing.assert_allclose(times, [0.0, 0.004])
    np.testing.assert_array_equal(xy, [[0.1, np.nan], [0.3, np.nan]])


def test_where_takes_rows_and_keeps_notes():
    rows = np.stack([blank_row()] * 4)
    rows[:, INDEX["phase"]] = [Phase.PLACE, Phase.HOLD, Phase.RUN, Phase.RUN]
    log = Log.from_rows(rows, notes=("odd",))
    run = log.where(log["phase"] == Phase.RUN)
    assert len(run) == 2
    assert run.notes == ("odd",)
    assert len(log.where(slice(1, None))) == 3


def test_what_servos_were_told_is_held_and_0_where_nothing_was_told():
    told = Log.from_columns({"t_s": np.arange(4.0), "command_y_rad": [np.nan, 0.2, np.nan, -0.1]})
    assert told.told().tolist() == [[0, 0], [0, 0.2], [0, 0.2], [0, -0.1]]
    assert Log.from_columns({"t_s": np.arange(4.0)}).told() is None
