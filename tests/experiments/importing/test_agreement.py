"""A further file, or one for which a map is used again, that states other units than the map."""

from pathlib import Path

import numpy as np
import pytest

from experiments.importing.agreement import contradiction
from experiments.importing.columns.turns import unwound
from experiments.importing.proposal import propose
from experiments.importing.recording import Stream
from experiments.records.importing import read_log
from tests.support.command import told
from tests.support.other_labs.bench import run
from tests.support.strangers import bench as strangers

NAMES = "t,servo x cmd,servo y cmd,ball x,ball y"
UNITS = "s,deg,deg,mm,mm"


@pytest.fixture(scope="module")
def columns() -> list[np.ndarray]:
    x, y = run(0, course_kind="squares"), run(1, course_kind="squares")
    return [x.t, *np.degrees([x.command, y.command]), *1000 * np.array([x.seen, y.seen])]


def written(path: Path, columns: list[np.ndarray], units: str) -> Path:
    np.savetxt(path, np.column_stack(columns), "%.5f", ",", header=f"{NAMES}\n{units}", comments="")
    return path


def still(columns: list[np.ndarray]) -> list[np.ndarray]:
    """The same run with servos that stand: nothing in it can be compared with anything."""
    return [columns[0], *np.ones_like(columns[1:3]), *columns[3:]]


@pytest.mark.parametrize(
    ("units", "says"),
    [
        ("s,deg,deg,cm,cm", "its own ball_x_m.unit is cm, not mm"),
        ("ms,deg,deg,mm,mm", "its own time.unit is ms, not s"),
        ("s,deg,rad,mm,mm", "its own command_y_rad.unit is rad, not deg"),
    ],
)
def test_other_units_are_refused_where_nothing_moves_too(units, says, columns, tmp_path: Path):
    first = written(tmp_path / "a.csv", columns, UNITS)
    other = written(tmp_path / "b.csv", still(columns), units)
    code, _, line = told("import", first, other, "--out", tmp_path / "ab/a.csv", "--yes")
    assert code == 2
    assert f"b.csv: the map of the first file does not fit it ({says}): " in line
    out = tmp_path / "out/a.csv"
    assert told("import", first, "--out", out, "--yes")[0] == 0
    again = ("import", other, "--out", tmp_path / "b/b.csv", "--map", out.with_name("import.toml"))
    code, _, line = told(*again)
    assert code == 2
    assert f"b.csv: the given map does not fit it ({says}): " in line
    assert not (tmp_path / "b").exists()
    place, right = says.split()[2].partition(".")[0], says.split()[4].rstrip(",")
    option = place if place == "time" else place.split("_")[0]
    assert told(*again, "--set", f"{option}.unit={right}")[0] == 0


def test_units_that_both_files_state_are_right(columns, tmp_path: Path):
    first = written(tmp_path / "a.csv", columns, UNITS)
    other = written(tmp_path / "b.csv", still(columns), "sec,degrees,degrees,mm,mm")
    code, _, line = told("import", first, other, "--out", tmp_path / "ab/a.csv", "--yes")
    assert (code, line) == (0, "")
    np.testing.assert_allclose(read_log(tmp_path / "ab/a-2.csv")["command_x_rad"], np.radians(1.0))


@pytest.mark.parametrize(
    ("both", "code", "says"), [(True, -1.0, "absent is (-1.0,)"), (False, 999.0, "absent_alone is")]
)
def test_a_ball_that_only_a_further_file_loses(both, code, says, columns, tmp_path: Path):
    first = written(tmp_path / "a.csv", columns, UNITS)
    lost = [values.copy() for values in columns]
    for values in lost[3:] if both else lost[3:4]:
        values[1000:1200] = code
    other = written(tmp_path / "b.csv", lost, UNITS)
    out = tmp_path / "ab/a.csv"
    done, _, line = told("import", first, other, "--out", out, "--yes")
    assert done == 2
    assert f"b.csv: the map of the first file does not fit it (its own ball_x_m.{says}" in line
    assert told("import", other, first, "--out", out, "--yes")[0] == 0
    assert np.isnan(read_log(tmp_path / "ab/a-1.csv")["ball_x_m"][1000:1200]).all()


def test_a_further_file_that_stays_below_the_end_of_a_turn_is_refused():
    """Beside one that passes it, it told a plate that was a turn away."""
    first, other = (angles_of(level) for level in (0.0, 330.0))
    made = propose(unwound(first)).map()
    assert contradiction(made, propose(unwound(first))) == ""
    words = contradiction(made, propose(unwound(other)))
    assert words.startswith("its own theta_x_rad.offset is about 3")


def angles_of(level: float) -> Stream:
    """A run whose plate is level where its encoders, from 0 to 360 degrees, say `level`."""
    one = strangers.run(seed=6)
    columns = {"t_s": one.t_s}
    for at, axis in enumerate("xy"):
        columns[f"plate_{axis}_meas_deg"] = (np.degrees(one.theta_rad[:, at]) + level) % 360
        columns[f"ball_{axis}_mm"] = 1e3 * one.ball_m[:, at]
    return Stream(columns)
