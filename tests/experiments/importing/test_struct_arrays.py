"""MATLAB's arrays of structs, one a moment: version 5 keeps structs, 7.3 a reference a number."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from experiments.importing.formats.choose import read_recording
from experiments.importing.recording import BadFileError

T = np.arange(30) * 0.02
BALL = np.column_stack((np.sin(T), np.cos(T)))


def version_5(path: Path) -> None:
    from scipy.io import savemat

    kinds = [(name, object) for name in ("t", "ball", "servo", "state")]
    moments, servos = np.zeros((1, len(T)), kinds), np.zeros((1, 1), [("deg", object)])
    for i, t in enumerate(T):
        one = servos.copy()
        one[0, 0] = (2 * t,)
        place = np.zeros((0, 0)) if i == 3 else BALL[i : i + 1]
        moments[0, i] = (t, place, one, "runs")
    savemat(path, {"log": moments})


def version_73(path: Path) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        refs, log = file.create_group("#refs#"), file.create_group("log")
        for name, values in (("t", T[:, None]), ("ball", BALL), ("servo/deg", 2 * T[:, None])):
            column = log.create_dataset(name, (len(T), 1), dtype=h5py.ref_dtype)
            for i, value in enumerate(values):
                part = refs.create_dataset(f"{name}{i}", data=value[:, None])
                if i == 3 and name == "ball":
                    part.attrs["MATLAB_empty"] = 1
                column[i, 0] = part.ref
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM")


@pytest.mark.parametrize("write", [version_5, version_73])
def test_a_struct_a_moment_is_a_row(tmp_path: Path, write):
    write(tmp_path / "run.mat")
    stream = read_recording(tmp_path / "run.mat").stream
    assert stream.time == "log.t"
    np.testing.assert_allclose(stream.columns["log.servo.deg"], 2 * T)
    place = np.column_stack([stream.columns[f"log.ball[{i}]"] for i in (1, 2)])
    assert np.isnan(place[3]).all()
    np.testing.assert_allclose(np.delete(place, 3, 0), np.delete(BALL, 3, 0))


def test_a_struct_a_trial_is_a_session(tmp_path: Path):
    from scipy.io import savemat

    trials = np.zeros((1, 3), [("t", object), ("ball_mm", object)])
    trials[0, :] = [(T, 10 * BALL), (T[:25], 20 * BALL[:25]), (T, 30 * BALL)]
    savemat(tmp_path / "run.mat", {"exp": trials})
    stream = read_recording(tmp_path / "run.mat").stream
    assert (stream.time, stream.session, len(stream)) == ("exp.t", "exp.trial", 85)
    np.testing.assert_allclose(stream.columns["exp.ball_mm[1]"][55:], 30 * BALL[:, 0])
    trials[0, 1] = (T, np.zeros((0, 0)))  # without the ball: they stay apart
    savemat(tmp_path / "run.mat", {"exp": trials})
    assert "exp.3.ball_mm[1]" in read_recording(tmp_path / "run.mat").stream.columns


def test_a_struct_a_setting_is_none(tmp_path: Path):
    from scipy.io import savemat

    gains = np.zeros((1, 4), [("kp", object)])
    gains[0, :] = [(1.0,)] * 4
    savemat(tmp_path / "run.mat", {"gains": gains})
    with pytest.raises(BadFileError, match="no array of 20 rows"):
        read_recording(tmp_path / "run.mat")


def test_a_moment_with_more_numbers_than_others_leaves_the_rest(tmp_path: Path):
    from scipy.io import savemat

    moments = np.zeros((1, len(T)), [("t", object), ("ball", object), ("none", object)])
    for i, t in enumerate(T):
        moments[0, i] = (t, np.append(BALL[i], [7.0] * (i == 4)), np.zeros((0, 0)))
    savemat(tmp_path / "run.mat", {"log": moments})
    columns = read_recording(tmp_path / "run.mat").stream.columns
    assert list(columns) == ["log.t", *(f"log.ball[{i}]" for i in (1, 2, 3))]
    np.testing.assert_allclose(columns["log.ball[2]"], BALL[:, 1])
    assert np.isfinite(columns["log.ball[3]"]).tolist() == [i == 4 for i in range(len(T))]
