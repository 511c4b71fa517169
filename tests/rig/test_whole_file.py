"""A file that grows or is kept is never lost to a disk without room."""

import errno
import signal
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from calibration.bundle import Draft
from experiments.export.export_model import export_model
from experiments.records.exporting import export_log
from rig.files import write_ours, write_whole
from rig.hardware.homing.home import Homing
from rig.hardware.homing.homed import Homed
from rig.hardware.wiring import Wiring
from rig.log import Log
from rig.parameters import Rig
from rig.rigfile import write_rig

DRAFT = Draft(made=datetime(2026, 1, 1, tzinfo=UTC), source="measured")
HOMED = Homed.of(Homing(Wiring(), (1.2, 1.2), (0.4, 0.4)), Rig(), None)
WRITERS: dict[str, Callable[[Path], object]] = {
    "bytes": lambda path: write_whole(path, bytes(100)),
    "calibration": DRAFT.save,
    "rig": lambda path: write_rig(Rig(), path),
    "homing": HOMED.save,
    "log": lambda path: export_log(Log.from_columns({"t_s": np.arange(200.0)}), path),
    "model": lambda path: export_model(Rig(), "table", "mjcf", path),
}


@pytest.mark.skipif(sys.platform == "win32", reason="file size limits are POSIX")
@pytest.mark.parametrize("kind", WRITERS)
def test_without_room_the_older_file_stays(tmp_path: Path, kind: str):
    import resource

    name = {"log": "kept.csv"}.get(kind, "kept.xml")
    path, write = tmp_path / name, WRITERS[kind]
    path.write_text("what took an hour to measure")
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50, hard))
    try:
        with pytest.raises(OSError) as caught:  # noqa: PT011
            write(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, before)
    assert caught.value.errno == errno.EFBIG
    assert caught.value.filename == str(path)
    assert path.read_text() == "what took an hour to measure"
    assert [one.name for one in tmp_path.iterdir()] == [name]


def test_a_folder_in_the_files_place_is_told_by_its_own_name(tmp_path: Path):
    (tmp_path / "results.json").mkdir()
    with pytest.raises(OSError, match="irectory") as caught:
        write_whole(tmp_path / "results.json", b"{}")
    assert caught.value.filename == str(tmp_path / "results.json")


def test_of_two_who_write_at_once_each_file_is_whole(tmp_path: Path):
    """Two programs on one folder: what is read is one's or the other's, never a part of both."""
    path = tmp_path / "results.json"
    contents = {bytes([n]) * 100_000 for n in (1, 2)}
    torn, over = [], threading.Event()
    write_whole(path, min(contents))

    def write(content: bytes) -> None:
        for _ in range(150):
            write_whole(path, content)

    def read() -> None:
        while not over.is_set():
            torn.append(path.read_bytes() not in contents)

    reader = threading.Thread(target=read)
    reader.start()
    with ThreadPoolExecutor(2) as writers:
        list(writers.map(write, contents))
    over.set()
    reader.join()
    assert torn
    assert not any(torn)
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_of_somebody_elses_is_kept_beside_ours(tmp_path: Path):
    path, mark = tmp_path / "exercise.md", b"made by us"
    for content in (b"made by us, once", b"made by us, twice"):
        write_ours(path, content, mark)
        assert path.read_bytes() == content
    assert [one.name for one in tmp_path.iterdir()] == ["exercise.md"]
    for text in (b"my own", b"of mine again"):
        path.write_bytes(text)
        write_ours(path, content, mark)
    assert path.read_bytes() == content
    assert (tmp_path / "exercise.md.1").read_bytes() == b"my own"
    assert (tmp_path / "exercise.md.2").read_bytes() == b"of mine again"
