"""A time in two columns is one; two columns that only look like it stay as they are."""

from pathlib import Path

import numpy as np
import pytest

from experiments.importing.columns.split_stamps import whole_stamps
from experiments.importing.formats.choose import read_recording
from experiments.importing.recording import Stream

MS = 1_700_000_000_000 + 20 * np.arange(200) + 7
WHOLE, PART = MS // 1000, MS % 1000


@pytest.mark.parametrize(
    ("names", "size"),
    [(("sec", "nanosec"), 10**6), (("t [s]", "t [ms]"), 1), (("stamp.secs", "stamp.nsecs"), 10**6)],
)
def test_seconds_and_the_part_of_one(names: tuple[str, str], size: int, tmp_path: Path):
    path = tmp_path / "a.csv"
    rows = (f"{s},{size * ms},{s % 7}" for s, ms in zip(WHOLE, PART, strict=True))
    path.write_text("\n".join([f"{names[0]},{names[1]},x", *rows, ""]))
    found = read_recording(path)
    assert list(found.stream.columns) == [names[0], "x"]
    assert found.stream.units == {names[0]: "s"}
    np.testing.assert_allclose(found.stream.columns[names[0]], MS / 1000, atol=1e-6)
    assert found.notes == (f"{names[0]} and {names[1]} are one time",)


@pytest.mark.parametrize(
    "columns",
    [
        {"t_s": MS / 1000, "t_ms": MS},
        {"t_s": WHOLE, "loop_ms": PART},
        {"t_s": WHOLE, "t_ms": np.full(200, 20)},
        {"t_ms": WHOLE, "t_us": PART},
        {"t_s": WHOLE, "t_ms": PART, "t_us": PART},
        {"t_s": np.full(200, np.nan), "t_ms": PART},
    ],
)
def test_what_only_looks_like_it(columns: dict[str, np.ndarray]):
    stream = Stream({name: values.astype(float) for name, values in columns.items()})
    assert whole_stamps(stream) is stream
