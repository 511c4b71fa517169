"""Streams with clocks of their own: which column is the time, and when each begins."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
from mcap.writer import Writer

from experiments.importing.formats.bags import read_bag
from experiments.importing.formats.choose import read_recording
from experiments.importing.formats.tdms import read_tdms
from experiments.importing.recording import Stream, joined
from tests.support.parts import needs

T = np.arange(50) * 0.02


def test_the_time_of_a_bag_is_its_log_time_whatever_its_messages_call_time(tmp_path: Path):
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/b", "json", writer.register_schema("b", "", b""))
        for t in T:
            row = {"x": t, "time": t + 0.4, "own_time": 7}
            writer.add_message(channel, int(1e9 * t), json.dumps(row).encode(), 0)
        writer.finish()
    (stream,) = read_bag(path)
    assert (stream.time, len(stream.columns)) == ("b.time", 4)
    np.testing.assert_allclose(stream.columns["b.time"], T, atol=1e-6)
    np.testing.assert_allclose(stream.columns["b.own_own_time"], T + 0.4)
    assert set(stream.columns["b.own_time"]) == {7.0}


@needs("nptdms")
@pytest.mark.parametrize(
    ("start", "late"),
    [
        ({"wf_start_time": np.datetime64("2026-01-01T00:00:00.5")}, 0.5),
        ({"wf_start_time": np.datetime64("2026-01-01"), "wf_start_offset": 0.25}, 0.25),
        ({"wf_start_time": np.datetime64("1904-01-01")}, 0.0),  # what LabVIEW writes for none
        ({}, 0.0),
    ],
)
def test_waveforms_of_a_tdms_file_begin_when_they_were_started(tmp_path: Path, start, late):
    from nptdms import ChannelObject, TdmsWriter

    path = tmp_path / "a.tdms"
    first = {"wf_increment": 0.02, "wf_start_time": np.datetime64("2026-01-01")}
    with TdmsWriter(path) as writer:
        servo = [ChannelObject("servo", name, T, first) for name in ("x", "y")]
        ball = [ChannelObject("ball", "x", T, {"wf_increment": 0.02, **start})]
        writer.write_segment(servo + ball)
    ball, servo = sorted(read_tdms(path), key=lambda stream: str(stream.time))
    np.testing.assert_allclose(servo.columns["servo/time"], T)
    np.testing.assert_allclose(ball.columns["ball/time"], T + late)
    assert any("without a start" in note for note in ball.notes) is (late == 0)


@needs("nptdms")
def test_channels_of_one_group_that_begin_apart_are_streams_apart(tmp_path: Path):
    from nptdms import ChannelObject, TdmsWriter

    path = tmp_path / "a.tdms"
    with TdmsWriter(path) as writer:
        for name, late in (("x", 0.0), ("y", 0.5)):
            how = {"wf_increment": 0.02, "wf_start_offset": late}
            writer.write_segment([ChannelObject("g", name, T, how)])
    assert [one.columns[str(one.time)][0] for one in read_tdms(path)] == [0.0, 0.5]


def test_a_stream_that_begins_after_the_rows_is_left_out_and_told():
    base = Stream({"t": T, "a": T}, time="t")
    late = Stream({"u": T[:9] + 5.0, "b": T[:9]}, time="u")
    found = joined([base, late])
    assert [*found.stream.columns] == ["t", "a"]
    assert found.notes == ("left out, later than every row of the fastest: b",)


def test_groups_of_hdf5_with_stamps_in_units_of_their_own(tmp_path: Path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for group, name, every, unit in (("servo", "stamp", 1, "s"), ("ball", "t_ms", 2, "ms")):
            times = T[::every] * (1 if unit == "s" else 1000)
            file[f"{group}/{name}"] = times
            file[f"{group}/{name}"].attrs["units"] = unit
            file[f"{group}/x"] = np.sin(T[::every])
    stream = read_recording(tmp_path / "a.h5").stream
    assert (stream.time, np.isfinite(stream.columns["ball.x"]).sum()) == ("servo.stamp", 25)
    np.testing.assert_allclose(stream.columns["ball.x"][::2], np.sin(T[::2]))
