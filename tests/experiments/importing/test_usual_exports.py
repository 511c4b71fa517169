"""Tables as programs write them: LabVIEW's channels and units, numpy's `#`, spreadsheets."""

from pathlib import Path

import numpy as np
import pytest

from experiments.importing.formats.choose import read_recording
from experiments.importing.recording import Stream

K = np.arange(60)
WAVES = (30 * np.sin(K / 9), 5 * np.cos(K / 7))
LABVIEW = """LabVIEW Measurement\t
Separator\tTab
***End_of_Header***\t
\t
Channels\t2\t\t
Samples\t60\t60\t
Date\t2023/11/02\t2023/11/02\t
Time\t10:14:33.51\t10:14:33.51\t
Y_Unit_Label\tdeg\tmm\t
X_Dimension\tTime\tTime\t
X0\t0.0E+0\t0.0E+0\t
Delta_X\t0.020000\t0.020000\t
***End_of_Header***\t\t\t
X_Value\tTilt\tBall\tComment
"""


def recorded(path: Path, text: str) -> Stream:
    """The one stream of a file with this text."""
    path.write_text(text)
    return read_recording(path).stream


@pytest.mark.parametrize("remark", ["", "\t"])
def test_labviews_header_of_channels_is_none_of_the_table_and_says_the_units(
    tmp_path: Path, remark: str
):
    rows = [f"{k / 50:.6f}\t{np.sin(k):.6f}\t{np.cos(k):.6f}{remark}" for k in K]
    stream = recorded(tmp_path / "a.lvm", LABVIEW + "\n".join(rows))
    assert [*stream.columns] == ["X_Value", "Tilt", "Ball", *(["Comment"] if remark else [])]
    assert stream.units == {"Tilt": "deg", "Ball": "mm"}
    np.testing.assert_allclose(stream.columns["X_Value"], K / 50)


@pytest.mark.parametrize("separator", [" ", "\t", ","])
def test_numpys_own_line_of_names(separator: str, tmp_path: Path):
    table = np.stack([K / 50, *WAVES], axis=1)
    names = ["t[s]", "ball_x[mm]", "servo_x[deg]"]
    np.savetxt(tmp_path / "a.txt", table, header=separator.join(names), delimiter=separator)
    assert [*read_recording(tmp_path / "a.txt").stream.columns] == names


def test_names_that_stand_twice_are_told_apart_by_the_line_above(tmp_path: Path):
    rows = "\n".join(f"{k / 50},{np.sin(k):.4f},{np.cos(k):.4f}" for k in K)
    wide = "\n".join(f"{k / 50},{k % 7},{k % 5},{k % 3},{k % 4}" for k in K)
    head = "time_s,ball_mm,ball_mm,servo_deg,servo_deg\n,x,y,x,y"
    two = recorded(tmp_path / "a.csv", f"{head}\n{wide}")
    assert [*two.columns][1:] == ["ball_mm x", "ball_mm y", "servo_deg x", "servo_deg y"]
    three = recorded(tmp_path / "b.csv", f",ball,servo\n,position,position\ntime,x,x\n{rows}")
    assert [*three.columns] == ["time", "ball position x", "servo position x"]
    with pytest.raises(ValueError, match="stands twice"):
        recorded(tmp_path / "c.csv", f"time,x,x\n{rows}")


def test_rows_of_more_words_than_numbers_are_rows(tmp_path: Path):
    """Of a narrow table without a ball; they were taken for lines above it."""
    rows = [f"{k / 50},{k},{-k},on,auto,2" for k in range(3)]
    rows += [f"{k / 50},lost,lost,off,auto,2" for k in range(3, 60)]
    stream = recorded(tmp_path / "a.csv", "t,x,y,state,mode,servo\n" + "\n".join(rows))
    assert len(stream) == 60
    assert np.isnan(stream.columns["x"]).sum() == 57
