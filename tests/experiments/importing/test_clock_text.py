"""Times of day in text: zones, halves of a day, dates of other kinds, midnight."""

import json
from pathlib import Path

import numpy as np
import pytest

from experiments.importing.clock import coarse, growing_on, read_clock
from experiments.importing.conversion import convert
from experiments.importing.formats.choose import read_recording
from experiments.importing.formats.text_tables.clock_text import clock_seconds
from experiments.importing.import_map import TimeMap
from experiments.importing.proposal import propose
from experiments.importing.recording import Stream
from tests.support.strangers.bench import run


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("2023-05-04T10:11:12.5+02:00", "2023-05-04T08:11:12.5Z"),
        ("2023-05-04 10:11:12-0330", "2023-05-04 13:41:12"),
        ("2023-05-04 00:30:00+01:00", "2023-05-03 23:30:00 UTC"),
        ("1:02:03 PM", "13:02:03"),
        ("12:02:03 am", "00:02:03"),
        ("04.05.2023 10:11:12,5", "10:11:12.5"),
        ("5/4/2023 10:11:12", "10:11:12"),
    ],
)
def test_one_moment_in_other_words(text: str, same: str):
    assert clock_seconds(text) == clock_seconds(same)


@pytest.mark.parametrize("end", [86400.0, 2.0**16, 2.0**32])
def test_a_clock_that_begins_anew_at_its_end_goes_on(end: float):
    stamps = np.array([end - 2, np.nan, end - 1, 0.0, 1.0])
    grown = growing_on(stamps, (2.0**16, 2.0**32, 86400.0))
    np.testing.assert_array_equal(grown - end, [-2, np.nan, -1, 0, 1])


def test_a_session_that_ended_before_the_counter_was_full_is_no_part_of_the_next():
    both = np.concatenate((np.arange(0, 64900, 20.0), np.arange(0, 30000, 20.0)))
    np.testing.assert_array_equal(growing_on(both, (2.0**16,)), both)


@pytest.mark.parametrize("stamps", [[50, 51, 10, 11], [1.7e9, 1.6e9, 1.6e9 + 1], [np.nan], []])
def test_one_that_is_set_back_stays(stamps: list[float]):
    before = np.array(stamps, float)
    np.testing.assert_array_equal(growing_on(before, (2.0**16, 86400.0)), before)


@pytest.mark.parametrize("name", ["a.csv", "a.jsonl", "a.json"])
def test_a_night_is_one_session(name: str, tmp_path: Path):
    stamps = [f"23:59:{k}" for k in range(30, 60)] + [f"00:00:{k:02d}" for k in range(30)]
    rows = [{"at": at, "x": k} for k, at in enumerate(stamps)]
    text = "at,x\n" + "".join(f"{row['at']},{row['x']}\n" for row in rows)
    if name != "a.csv":
        lines = [json.dumps(row) for row in rows]
        text = "\n".join(lines) if name == "a.jsonl" else f"[{','.join(lines)}]"
    path = tmp_path / name
    path.write_text(text)
    clock = read_clock(read_recording(path).stream, TimeMap(column="at"))
    np.testing.assert_array_equal(clock.t_s, np.arange(60))


K = np.arange(60)


def _recorded(path: Path, text: str) -> Stream:
    """The one stream of a file with this text."""
    path.write_text(text)
    return read_recording(path).stream


@pytest.mark.parametrize("clock", ["{:.6g} sec", "{:.6g} s", "0 days 00:00:{:09.6f}"])
def test_spans_as_matlab_and_pandas_write_them(clock: str, tmp_path: Path):
    rows = [f"{clock.format(k / 50)},{np.sin(k)},{np.cos(k)}" for k in K]
    stream = _recorded(tmp_path / "a.csv", "Time,x_mm,servo_x_deg\n" + "\n".join(rows))
    np.testing.assert_allclose(stream.columns["Time"], K / 50, atol=1e-9)
    assert stream.units["Time"] == "s"


def test_a_clock_of_whole_seconds_beside_a_date(tmp_path: Path):
    rows = [f"05/13/2024,11:59:{5 + k // 100:02d} AM,{k % 7},{k % 5}" for k in range(600)]
    stream = _recorded(tmp_path / "a.csv", "Date,Time,ball_x_mm,servo_x_deg\n" + "\n".join(rows))
    assert dict(propose(stream).draft["time"]) == {"column": "Time", "unit": "s", "clock": "even"}


def test_rows_that_were_written_twice_are_left_out():
    twice = np.repeat(K, np.where(K % 9 == 4, 2, 1))
    stream = Stream({"t": twice / 50, "x": np.sin(twice), "seen": np.where(twice % 3, 1, np.nan)})
    clock = read_clock(stream, TimeMap(column="t"))
    assert np.isfinite(clock.t_s).sum() == len(K)
    fresh = Stream({"t": twice / 50, "x": np.arange(len(twice))})
    with pytest.raises(ValueError, match="does not grow"):
        read_clock(fresh, TimeMap(column="t"))


def test_rows_that_were_all_written_twice_are_no_coarse_clock():
    """They were spread evenly, each place standing for two rows."""
    one = run(seed=5)
    rows = np.repeat(np.arange(len(one.t_s)), 2)
    columns = {"t_s": one.t_s[rows]}
    for at, axis in enumerate("xy"):
        columns[f"servo_{axis}_cmd_deg"] = np.degrees(one.command_rad)[rows, at]
        columns[f"ball_{axis}_mm"] = 1e3 * one.ball_m[rows, at]
    log = convert(Stream(columns), propose(Stream(columns)).map())[0]
    np.testing.assert_allclose(log["t_s"], one.t_s, atol=1e-9)


def test_a_clock_that_stands_still_is_no_coarse_one():
    """An error of NumPy's about arrays of no size was all that was told."""
    assert not coarse(np.zeros(50))
    assert coarse(np.repeat(np.arange(20.0), 5))


def test_a_signed_counter_goes_on_at_its_lowest():
    ticks = (np.arange(32000, 33600, 20.0) + 2**15) % 2**16 - 2**15
    np.testing.assert_allclose(np.diff(growing_on(ticks, (2.0**16,))), 20)


def test_milliseconds_behind_a_colon():
    assert clock_seconds("09:59:50:020") == pytest.approx(35990.02)
    frames = "09:59:50:02"  # of a film, of which nobody knows how many a second has
    assert np.isnan(clock_seconds(frames))
