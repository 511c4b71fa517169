"""Units with a number by them: tenths of a millimetre, ticks of 10 us."""

import numpy as np
import pytest

from experiments.importing.conversion import convert
from experiments.importing.import_map import TimeMap
from experiments.importing.names import hint
from experiments.importing.proposal import propose
from experiments.importing.recording import Stream
from experiments.importing.units import canonical, factor
from tests.support.strangers.bench import run

TENTHS = ["0.1 mm", "0,1mm", "1/10 mm", "mm*10", "mm x10", "x10 mm", "mm/10", "1e-1 mm", "10^-1 mm"]


@pytest.mark.parametrize("text", TENTHS)
def test_a_number_by_a_unit_counts(text: str):
    assert canonical(text) == "0.1 mm"
    assert factor("0.1 mm", "ball_x_m") == pytest.approx(1e-4)
    assert hint(f"ball_x [{text}]").unit == "0.1 mm"


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("angle_x_0.1deg", "0.1 deg"),
        ("angle_x_deg*100", "0.01 deg"),
        ("servo_x_deg10", "0.1 deg"),
        ("pos_x [mm] x10", "0.1 mm"),
        ("time_100us", "100 us"),
        ("servo_2deg", "deg"),
        ("servo_10_deg", "deg"),
        ("x2_mm", "mm"),
        ("ball_x_mm_2", "mm"),
        ("ball_x_mm_10", "mm"),
        ("servo_deg_10", "deg"),
        ("ball x (mm) 10", "mm"),
        ("pos_x10 [mm]", "mm"),
        ("adc_in_10", None),
        ("x_m10", None),
        ("ball_x_mm (x10)", "0.1 mm"),
    ],
)
def test_an_index_is_no_such_number(name: str, unit: str | None):
    """`_10` behind the units of ball and angle alike made tenths of both, unasked."""
    assert hint(name).unit == unit
    assert hint("pos_x10 [mm]").axis == "x"


@pytest.mark.parametrize("text", ["1/0 mm", "0.0 mm", "1e999 mm", "10 px", "0.1 lab", "turn/0"])
def test_what_is_no_multiple(text: str):
    assert canonical(text) in (None, "turn/0")


def test_tenths_of_all_of_a_table_are_not_taken_for_whole_ones():
    """Ball and angle ten times too large have the gain of a table, so physics cannot tell."""
    one = run(seed=3)
    ticks = np.round(one.t_s * 1e4)
    columns = {"clock [100 us]": ticks}
    for axis, ball, angle in zip("xy", one.ball_m.T, one.command_rad.T, strict=True):
        columns[f"ball_{axis} [0.1 mm]"] = ball * 1e4
        columns[f"servo_{axis}_cmd_deg x10"] = np.degrees(angle) * 10
    made = propose(Stream(columns)).map()
    assert made.time.unit == "100 us"
    assert made.signals["ball_x_m"].unit == "0.1 mm"
    assert made.signals["command_y_rad"].unit == "0.1 deg"
    log = convert(Stream(columns), made)[0]
    np.testing.assert_allclose(log["ball_x_m"], one.ball_m[:, 0], atol=1e-9)


def test_a_clock_has_a_unit_of_time():
    with pytest.raises(ValueError, match="no unit of time"):
        TimeMap(column="t", unit="counts")
