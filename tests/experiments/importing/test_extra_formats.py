"""Formats whose libraries the extra `import` brings."""

from pathlib import Path

import numpy as np
import pytest

from experiments.importing.formats.choose import read_recording
from experiments.importing.recording import BadFileError
from tests.support.parts import needs

T = np.arange(50) * 0.02
X = np.sin(T)


@needs("nptdms")
def test_tdms_groups_with_clocks_and_units(tmp_path: Path):
    from nptdms import ChannelObject, TdmsWriter

    path = tmp_path / "a.tdms"
    with TdmsWriter(path) as writer:
        how = {"wf_increment": 0.02, "unit_string": "V"}
        writer.write_segment([ChannelObject("g", "u", X, how), ChannelObject("g", "i", X, how)])
    stream = read_recording(path).stream
    np.testing.assert_allclose(stream.columns["g/time"], T)
    assert stream.units["g/u"] == "V"


@needs("nptdms")
def test_a_tdms_file_that_was_cut_off_says_so(tmp_path: Path):
    from nptdms import ChannelObject, TdmsWriter

    path = tmp_path / "a.tdms"
    with TdmsWriter(path) as writer:
        for part in (X, X):
            writer.write_segment([ChannelObject("g", "u", part, {"wf_increment": 0.02})])
    path.write_bytes(path.read_bytes()[:-80])
    recording = read_recording(path)
    assert len(recording.stream) == 90
    assert "cut off" in recording.notes[0]


@needs("nptdms")
@pytest.mark.parametrize("left", [1, 27, 28, 60, 250])
def test_a_tdms_file_that_was_cut_off_in_a_segments_names_says_so(tmp_path: Path, left: int):
    """npTDMS leaves such a segment out, and a file that ends with the one before is whole."""
    from nptdms import ChannelObject, TdmsWriter

    path = tmp_path / "a.tdms"
    with TdmsWriter(path) as writer:
        for part in (X, X):
            writer.write_segment([ChannelObject("g", "u", part, {"wf_increment": 0.02})])
    whole = path.read_bytes()
    begin = whole.index(b"TDSm", 4)
    path.write_bytes(whole[: begin + left])
    assert "cut off" in read_recording(path).notes[0]
    path.write_bytes(whole[:begin])
    assert read_recording(path).notes == ()


@needs("nptdms")
@pytest.mark.parametrize("data", [b"", b"TDSm" + b"\xff" * 60])
def test_bad_tdms_gets_one_line(data: bytes, tmp_path: Path):
    path = tmp_path / "a.tdms"
    path.write_bytes(data)
    with pytest.raises(BadFileError):
        read_recording(path)


@needs("mcap_ros2")
def test_ros_messages_with_stamps_arrays_and_names(tmp_path: Path):
    from mcap_ros2.writer import Writer

    path = tmp_path / "bag_0.mcap"
    text = "builtin_interfaces/Time stamp\nstring[] name\nfloat64[] position\nfloat32[2] place\n"
    with path.open("wb") as file:
        writer = Writer(file)
        schema = writer.register_msgdef("lab_msgs/msg/State", text)
        for i, t in enumerate(T):
            at = 10**18 + int(1e9 * t)
            message = {
                "stamp": {"sec": at // 10**9 - 1, "nanosec": at % 10**9},
                "name": ["a", "b"],
                "position": [X[i], -X[i]],
                "place": [X[i], t],
            }
            writer.write_message("/state", schema, message, log_time=at, publish_time=at)
        writer.finish()
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: {}", encoding="utf-8")
    stream = read_recording(tmp_path).stream  # the folder of a bag
    assert stream.time == "state.time"
    assert [*stream.columns][1:] == [
        "state.stamp",
        "state.position.a",
        "state.position.b",
        "state.place[0]",
        "state.place[1]",
    ]
    np.testing.assert_allclose(stream.columns["state.position.b"], -X)
    late = stream.columns["state.time"] - stream.columns["state.stamp"]
    np.testing.assert_allclose(late, 1.0, atol=1e-6)


@needs("nptdms")
def test_scales_without_end_are_refused_before_there_is_room_for_them(tmp_path: Path):
    from nptdms import ChannelObject, RootObject, TdmsWriter

    path = tmp_path / "a.tdms"
    with TdmsWriter(path) as writer:
        root = RootObject({"NI_Number_Of_Scales": 2**31})
        writer.write_segment([root, ChannelObject("g", "u", X)])
    with pytest.raises(BadFileError, match=r"u has 2147483648 scales \(limit: 100\)"):
        read_recording(path)
