"""Invented laboratories: what is proposed is right, and what a file does not tell is asked."""

from pathlib import Path

import pytest

from experiments.importing.conversion import convert
from experiments.importing.formats.choose import read_recording
from experiments.importing.import_map import stated
from experiments.importing.proposal import propose
from tests.support.other_labs.labs import LABS
from tests.support.parts import needs

ASKS = {"pixels", "arduino"}
NEEDS = {"labview": "nptdms", "ros": "mcap_ros2"}
LABORATORIES = [
    pytest.param(name, marks=needs(NEEDS[name])) if name in NEEDS else name for name in LABS
]


@pytest.mark.parametrize("name", LABORATORIES)
def test_right_without_a_question_or_asked(name: str, tmp_path: Path):
    path, truth = LABS[name](tmp_path, seed=1)
    recording = read_recording(path)
    found = propose(recording.stream)
    assert bool(found.doubts) == (name in ASKS), [doubt.why for doubt in found.doubts]
    if name not in ASKS:
        logs = convert(recording.stream, found.map())
        assert truth.faults(logs[0]) == []


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2, 8))
@pytest.mark.parametrize("name", LABORATORIES)
def test_other_runs_of_the_same_labs(name: str, seed: int, tmp_path: Path):
    path, truth = LABS[name](tmp_path, seed=seed)
    recording = read_recording(path)
    found = propose(recording.stream)
    if not found.doubts:
        assert truth.faults(convert(recording.stream, found.map())[0]) == []
    assert bool(found.doubts) == (name in ASKS), [doubt.why for doubt in found.doubts]


def test_pixels_are_right_once_the_camera_is_described(tmp_path: Path):
    path, truth = LABS["pixels"](tmp_path, seed=1)
    recording = read_recording(path)
    said = stated([f"ball.scale={1 / 1500}", "ball_x_m.offset=320", "ball_y_m.offset=240"])
    found = propose(recording.stream, said)
    assert not found.doubts
    assert truth.faults(convert(recording.stream, found.map())[0]) == []


def test_a_table_without_names_is_right_once_its_columns_are_named(tmp_path: Path):
    path, truth = LABS["arduino"](tmp_path, seed=1)
    recording = read_recording(path)
    said = stated(
        [
            *(f"ball_{axis}_m.column=column {2 + i}" for i, axis in enumerate("xy")),
            *(f"command_{axis}_rad.column=column {4 + i}" for i, axis in enumerate("xy")),
            "ball.unit=counts",
            "ball.scale=0.0005",
            "ball.offset=500",
            "command.unit=us",
            "command.scale=0.0015707963",
        ]
    )
    found = propose(recording.stream, said)
    assert not found.doubts, [doubt.why for doubt in found.doubts]
    assert found.draft["signals"]["command_x_rad"]["offset"] == 1500  # found by how the ball rolls
    assert truth.faults(convert(recording.stream, found.map())[0]) == []


def test_names_that_swap_the_axes_are_seen_through(tmp_path: Path):
    path, _ = LABS["lerobot"](tmp_path, seed=1)
    found = propose(read_recording(path).stream)
    signals = found.draft["signals"]
    assert signals["ball_x_m"]["column"].endswith("ball_x_cm")
    assert signals["command_x_rad"]["column"].endswith("servo_b_deg")
    assert "whatever its name" in " ".join(found.reasons["angle"])


def test_sessions_become_logs_of_their_own(tmp_path: Path):
    path, _ = LABS["appended"](tmp_path, seed=1)
    recording = read_recording(path)
    logs = convert(recording.stream, propose(recording.stream).map())
    assert len(logs) == 3
    assert all(log["t_s"][0] == 0 for log in logs)
