"""The time of rows without a clock, by a rate that the lines above the table state."""

from pathlib import Path

import numpy as np
import pytest

from experiments.importing.formats.choose import read_recording
from experiments.importing.formats.text_tables.head_rate import time_by_rate
from experiments.importing.proposal import propose

ROWS = {"x": np.sin(np.arange(40.0))}
FRAMES = {**ROWS, "frame": np.delete(np.arange(41.0), 7)}


@pytest.mark.parametrize(
    ("line", "rate_hz"),
    [
        ("# Sample rate: 50 Hz", 50.0),
        ("Abtastrate [Hz];200", 200.0),
        ("Fréquence d'échantillonnage = 0,1 kHz", 100.0),
        ("sampling interval 20 ms", 50.0),
        ("% fs = 125", 125.0),
        ("dt: 0.02", 50.0),
        ("FREQUENCY\t100", 100.0),
        ("sample_rate,250", 250.0),
        ("servo update rate: 50 Hz", None),
        ("cutoff_frequency: 5", None),
        ("Samples: 2000 in 40 s", None),
        ("cutoff frequency: 5 Hz", None),
        ("sampled at 50 Hz, written at 10 Hz", None),
        ("camera frame rate: 30 fps", None),
        ("sampling rate 1 kHz, decimated by 10", None),
        ("logged every 10 samples of 1 kHz", None),
        ("dt = 0.001 (solver), written each 20th", None),
        ("resampled, filter window 100 ms", None),
    ],
)
def test_what_lines_state(line: str, rate_hz: float | None):
    found = time_by_rate(ROWS, ["Lab 3, 4.5 V", line])
    assert (found is None) == (rate_hz is None)
    if found and rate_hz:
        np.testing.assert_allclose(found[1], np.arange(40) / rate_hz)


def test_frames_that_are_missing_leave_holes():
    found = time_by_rate(FRAMES, ["camera frame rate: 30 fps"])
    assert found is not None
    np.testing.assert_allclose(np.diff(found[1])[5:8] * 30, [1, 2, 1])


@pytest.mark.parametrize("clock", ["", "t_ms"])
def test_a_clock_of_the_files_own_comes_first(clock: str, tmp_path: Path):
    path = tmp_path / "a.csv"
    t = np.arange(60)
    own = (f"{clock},", [f"{10 * k}," for k in t]) if clock else ("", [""] * len(t))
    rows = [f"{own[1][k]}{np.sin(k / 9):.4f},{np.cos(k / 7):.4f}" for k in t]
    path.write_text(f"# fs = 50\n{own[0]}ball_x_mm,servo_x_deg\n" + "\n".join(rows))
    found = propose(read_recording(path).stream).draft["time"]
    assert found["column"] == (clock or "rows at 50 Hz")
    assert found["unit"] == ("ms" if clock else "s")
