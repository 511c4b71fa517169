"""Tables with a row for each number: InfluxDB's annotated CSV, pandas' melt, a log of MQTT."""

from pathlib import Path

import numpy as np
import pytest

from experiments.importing.formats.choose import read_recording
from experiments.importing.recording import BadFileError

T = np.arange(40) / 50
SERIES = {("ball", "x_mm"): 10 + T, ("ball", "y_mm"): 20 - T, ("servo", "x_deg"): np.sin(T)}
HEAD = (
    "#group,false,false,true,true,false,false,true,true\n"
    "#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,dateTime:RFC3339,double,string,string\n"
    "#default,_result,,,,,,,\n"
    ",result,table,_start,_stop,_time,_value,_field,_measurement\n"
)


def stamp(t: float) -> str:
    return f"2024-05-01T10:00:{t:09.6f}Z"


def influx(again: bool) -> str:
    text = HEAD
    for i, ((measurement, field), values) in enumerate(SERIES.items()):
        text += f"\n{HEAD.replace('double', 'long')}" if again and i else ""
        for t, value in zip(T, values, strict=True):
            text += f",,{i},{stamp(0)},{stamp(9)},{stamp(t)},{value:.6f},{field},{measurement}\n"
    return text


def read(tmp_path: Path, text: str):
    (tmp_path / "run.csv").write_text(text)
    return read_recording(tmp_path / "run.csv").stream


@pytest.mark.parametrize("again", [False, True])
def test_influxdbs_annotated_csv(tmp_path: Path, again: bool):
    stream = read(tmp_path, influx(again))
    assert list(stream.columns) == ["_time", "ball x_mm", "ball y_mm", "servo x_deg"]
    assert (stream.time, stream.units) == ("_time", {"_time": "s"})
    np.testing.assert_allclose(stream.columns["_time"] - stream.columns["_time"][0], T, atol=1e-6)
    for (measurement, field), values in SERIES.items():
        np.testing.assert_allclose(stream.columns[f"{measurement} {field}"], values, atol=1e-6)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_melted_table_with_decimal_commas_or_points(tmp_path: Path, separator: str):
    rows = [
        separator.join((f"{t:.2f}", " ".join(name), f"{values[i]:.4f}"))
        for i, t in enumerate(T)
        for name, values in SERIES.items()
    ]
    text = "\n".join([separator.join(("time", "variable", "value")), *rows, ""])
    stream = read(tmp_path, text if separator == "," else text.replace(".", ","))
    np.testing.assert_allclose(stream.columns["servo x_deg"], np.sin(T), atol=1e-4)
    assert len(stream) == len(T)


def test_rows_that_are_numbered_as_pandas_does(tmp_path: Path):
    each = [(t, " ".join(name), v[i]) for name, v in SERIES.items() for i, t in enumerate(T)]
    rows = "".join(f"{i},{t},{name},{value:.6f}\n" for i, (t, name, value) in enumerate(each))
    stream = read(tmp_path, f",time,variable,value\n{rows}")
    assert list(stream.columns) == ["time", "ball x_mm", "ball y_mm", "servo x_deg"]


def test_a_series_that_misses_moments(tmp_path: Path):
    rows = [f"{t},ball,{i}\n" for i, t in enumerate(T)]
    rows += [f"{t},servo,{i}\n" for i, t in enumerate(T) if i % 2]
    stream = read(tmp_path, "time,topic,value\n" + "".join(rows))
    assert np.isnan(stream.columns["servo"]).tolist() == [i % 2 == 0 for i in range(len(T))]


def test_a_value_beside_other_signals_is_a_signal(tmp_path: Path):
    rows = "".join(f"{t},{'on' if i % 2 else 'off'},{i},{-i}\n" for i, t in enumerate(T))
    assert list(read(tmp_path, f"time,mode,value,x\n{rows}").columns) == [
        "time",
        "mode",
        "value",
        "x",
    ]


def test_more_series_than_any_table_has(tmp_path: Path):
    rows = "".join(f"{i},s{i},1\n" for i in range(2100))
    with pytest.raises(BadFileError, match="2100 columns"):
        read(tmp_path, f"time,topic,value\n{rows}")
