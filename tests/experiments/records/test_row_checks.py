"""Rows that no table can have made are refused in one line; what may be blank or unknown is not."""

import numpy as np
import pytest

from experiments.records.row_checks import check_rows
from rig.log import Log

T_S = np.arange(200) / 50.0


def rows(**changed: np.ndarray) -> Log:
    """A log of 4 s at 50 Hz in which these columns are others."""
    return Log.from_columns({"t_s": T_S, "ball_x_m": 0.05 * np.sin(T_S), **changed})


@pytest.mark.parametrize(
    "changed",
    [
        {},
        {"ball_x_m": np.full(200, np.nan)},
        {"estimated_gear_play_std_x_rad": np.full(200, np.inf)},  # nothing is known yet
    ],
)
def test_rows_of_a_table_pass(changed):
    check_rows(rows(**changed))
    check_rows(Log.from_columns({"t_s": np.array([1.0])}))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"t_s": T_S[::-1]}, "time does not grow in row 2 and 198 more"),
        ({"t_s": np.where(T_S > 2.0, T_S + 1e6, T_S)}, "t_s jumps by 1e.06 s after row 101"),
        ({"t_s": 1e3 * T_S}, "is t_s in milliseconds"),
        ({"ball_x_m": np.where(T_S > 3.0, np.inf, 0.0)}, "ball_x_m is infinite in row 152"),
        ({"ball_x_m": 5.0 * np.sin(T_S)}, r"ball_x_m reaches 5 \(limit: 2 m\): give metres"),
    ],
)
def test_others_are_refused_in_one_line(changed, said):
    with pytest.raises(ValueError, match=said) as caught:
        check_rows(rows(**changed))
    assert "\n" not in str(caught.value)
