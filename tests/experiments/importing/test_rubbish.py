"""Whatever stands in a table, the answer is a proposal, a question or one line."""

import os
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from experiments.importing.conversion import convert
from experiments.importing.formats.choose import read_recording
from experiments.importing.proposal import propose
from experiments.importing.recording import BadFileError, Stream
from tests.support.parts import needs

NAMES = (
    *("t_s", "time", "ball_x_mm", "ball_y_mm", "x", "y", "servo_cmd_x_deg", "theta_y_rad"),
    *("motor_x_volts", "omega_x", "target_x_mm", "error", "column 7", "ball x filtered", "pwm_y"),
)
KINDS = ("noise", "walk", "constant", "blank", "clock", "steps", "infinite", "huge", "holes")


def column(kind: str, n: int, rng: np.random.Generator) -> np.ndarray:
    noise = rng.standard_normal(n)
    if kind == "walk":
        return np.cumsum(noise)
    if kind == "clock":
        return np.cumsum(rng.integers(0, 3, n)) * 0.01
    if kind == "steps":
        return np.repeat(noise[: n // 10 + 1], 10)[:n]
    if kind == "holes":
        return np.where(rng.random(n) < 0.7, np.nan, noise)
    special = {"constant": 1.0, "blank": np.nan, "infinite": np.inf, "huge": 1e300}
    return np.where(rng.random(n) < 0.9, special[kind], noise) if kind in special else noise


@settings(max_examples=60, derandomize=True)
@given(
    kinds=st.dictionaries(st.sampled_from(NAMES), st.sampled_from(KINDS), min_size=1, max_size=8),
    n=st.sampled_from((1, 2, 5, 30, 400)),
    seed=st.integers(0, 1000),
    clock=st.booleans(),
)
def test_nothing_but_one_line(kinds: dict[str, str], n: int, seed: int, clock: bool):
    rng = np.random.default_rng(seed)
    columns = {name: column(kind, n, rng) for name, kind in kinds.items()}
    if clock:
        columns["t_s"] = np.arange(n) * 0.02
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        said = outcome(Stream(columns))
    assert len(said) < 1000
    assert "\n" not in said
    # a sentence of ours, not a library's
    assert not said.startswith(("zero-size", "cannot", "operands", "SVD", "array", "Singular"))


def outcome(stream: Stream) -> str:
    """What goes wrong with a table, in the words of whoever noticed; empty where nothing does."""
    try:
        found = propose(stream)
        if not found.doubts:
            for log in convert(stream, found.map()):
                assert np.all(np.diff(log["t_s"]) > 0)
    except ValueError as error:
        return str(error)
    return ""


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes with a name")
@pytest.mark.parametrize("within", ["", "data"])
def test_a_pipe_in_the_place_of_a_file_is_one_line(tmp_path: Path, within: str):
    """Opened, it would wait for ever; a device might have no end."""
    folder = tmp_path / "recording" / within
    folder.mkdir(parents=True)
    os.mkfifo(folder / "samples.mcap")
    asked = tmp_path / "recording" if within else folder / "samples.mcap"
    with pytest.raises(BadFileError, match=r"samples.mcap is no file but a pipe or a device"):
        read_recording(asked)


def test_a_damaged_files_error_is_one_short_printable_line(tmp_path: Path):
    """The library names what it did not find by the 7000 bytes that it took for its name."""
    path = tmp_path / "a.mat"
    savemat(path, {"t": np.arange(1000) * 0.02}, format="4")
    data = bytearray(path.read_bytes())
    data[16:20] = (7000).to_bytes(4, "little")  # the length of a name
    path.write_bytes(data)
    with pytest.raises(BadFileError) as caught:
        read_recording(path)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 600 + len(str(path))


@needs("nptdms")
def test_damaged_floats_warn_nobody(tmp_path: Path):
    from nptdms import ChannelObject, TdmsWriter

    path = tmp_path / "a.tdms"
    with TdmsWriter(path) as writer:
        damaged = np.full(50, 0x7F800001, np.uint32).view(np.float32)  # a signalling NaN
        writer.write_segment([ChannelObject("g", "u", damaged)])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.isnan(read_recording(path).stream.columns["g/u"]).all()


@pytest.mark.parametrize("head", ["_", "[", "10*"])
def test_a_name_of_a_hundred_thousand_characters_is_one_line(tmp_path: Path, head: str):
    """What names mean is searched for, which took hours of one as long as a small file."""
    rows = "\n".join(f"{i / 100},{i % 7},{i % 5}" for i in range(60))
    (tmp_path / "a.csv").write_text(f"t [s],{(head * 120_000)[:120_000]}mm],y\n{rows}\n")
    with pytest.raises(BadFileError, match=r"^[^\n]*limit: 300[^\n]*$") as error:
        read_recording(tmp_path / "a.csv")
    assert len(str(error.value)) < 400


def test_a_line_above_the_table_is_searched_for_a_rate_only_if_it_is_one(tmp_path: Path):
    rows = "\n".join(f"{i % 3};{i % 7};{i % 5}" for i in range(60))
    (tmp_path / "a.csv").write_text(f"{'rate' * 30_000}0\nx;y;a\n{rows}\n")
    assert [*read_recording(tmp_path / "a.csv").stream.columns] == ["x", "y", "a"]


@pytest.mark.parametrize(
    ("name", "long", "row"),
    [
        ("a.jsonl", '{{"t": 0, "w": "12:00:00{0}x"}}', '{{"t": {0}, "x": {1}, "y": {2}}}'),
        ("a.txt", "t:0 x:2 a=({1}", "t:{0} x:{1} y:{2}"),
    ],
)
def test_one_long_text_is_looked_through_once(tmp_path: Path, name: str, long: str, row: str):
    """What its words mean was tried in every way in which blanks or digits can be shared out, for
    hours."""
    rows = [row.format(k / 100 + 0.01, k % 7, k % 5) for k in range(300)]
    lines = [long.format(" " * 100_000, "1" * 100_000), *rows]
    (tmp_path / name).write_text("\n".join(lines) + "\n")
    stream = read_recording(tmp_path / name).stream
    assert {*stream.columns} == {"t", "x", "y"}
