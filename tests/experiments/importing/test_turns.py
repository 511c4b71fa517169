"""Angles that begin anew at the end of a turn or a counter."""

from pathlib import Path

import numpy as np
import pytest

from experiments.importing.columns.turns import unwound
from experiments.importing.formats.choose import read_recording
from experiments.importing.recording import Stream

SWING = 9 * np.sin(np.arange(400) / 20) + 1


@pytest.mark.parametrize(
    ("name", "whole", "size"),
    [
        ("plate_x_deg", 360.0, 1.0),
        ("enc_x_counts", 65536.0, 40.0),
        ("enc_1", 4096.0, 20.0),
        ("theta_x [rad]", 2 * np.pi, 0.02),
        ("theta_x [turn/1024]", 1024.0, 5.0),
        ("plate_x [0.1 deg]", 3600.0, 10.0),
    ],
)
def test_an_angle_goes_on_over_its_end(name: str, whole: float, size: float):
    """Read as it stood, it had a level near half a turn, and the ball answered as on no table."""
    true = np.where(np.arange(400) % 50 == 7, np.nan, size * SWING)
    stream = unwound(Stream({name: true % whole}))
    np.testing.assert_allclose(stream.columns[name], true, atol=1e-9)
    assert stream.notes == (f"{name} goes on over {whole:.6g}, a turn",)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("plate_x_deg", 170 * np.sign(SWING)),  # a command that jumps
        ("servo_x_deg", np.linspace(0, 359, 400)),  # never over the end
        ("ball_x_mm", SWING % 360),  # no angle
        ("enc_x_counts", np.where(np.arange(400) % 9, 65000.0, 30000.0)),
        ("enc_x_counts", np.full(400, np.nan)),
        ("servo_x", np.where(SWING > 0, 4090, 3) + np.arange(400) % 5),  # from one end to the other
        ("enc_x_counts", np.where(np.arange(400) % 90, 65000 + SWING, 0.0)),  # 0: not read
        ("plate_x [turn/0]", SWING % 1),
    ],
)
def test_what_does_not_go_round_stays(name: str, values: np.ndarray):
    np.testing.assert_array_equal(unwound(Stream({name: values})).columns[name], values)


def test_a_file_says_that_it_was_unwound(tmp_path: Path):
    rows = [f"{k / 50},{SWING[k]:.3f},{SWING[k] % 360:.3f}" for k in range(400)]
    (tmp_path / "a.csv").write_text("t_s,ball_x_mm,plate_x_meas_deg\n" + "\n".join(rows))
    found = read_recording(tmp_path / "a.csv")
    np.testing.assert_allclose(found.stream.columns["plate_x_meas_deg"], SWING, atol=1e-3)
    assert "goes on over 360" in " ".join(found.notes)
