"""A run folder of somebody else: nothing outside it is written, and odd ones are one line."""

import errno
import json
import os
from pathlib import Path
from stat import S_ISREG

import numpy as np
import pytest
from mcap.records import Message

from experiments.analysis.regime import rig_of_record
from experiments.blind.analysis_jobs import run_analyses
from experiments.blind.seal import seal
from experiments.dashboard.session.tasks import list_runs
from experiments.records import run_folder
from experiments.records.exporting import export_run
from experiments.records.recording import Recorder, read_run, recover
from experiments.records.run_folder import read_meta, writable
from experiments.records.samples_file import CHANNEL_ID, EVENTS, RECORD, _bytes, opening
from experiments.runs.runs import reject
from experiments.watch.runs import runs_of
from rig.files import LONGEST
from rig.log import COLUMNS

START = {"source": "simulated", "protocol": "hold", "arm": "with", "seed": 7}


def recorded(folder: Path, rows: int = 50) -> Path:
    with Recorder(folder, START) as recorder:
        for i in range(rows):
            recorder.append(np.array([0.002 * i, *np.zeros(len(COLUMNS) - 1)]))
    return folder


def cut_off(folder: Path) -> Path:
    """A recording in the middle of which a bit was flipped, and that was never finished."""
    recorder = Recorder(folder, START)
    for i in range(50):
        recorder.append(np.array([0.002 * i, *np.zeros(len(COLUMNS) - 1)]))
    os.close(recorder._file)
    path = folder / "samples.mcap"
    content = bytearray(path.read_bytes())
    content[len(opening()) + 10 * RECORD.itemsize + 4] ^= 0x08
    path.write_bytes(content)
    return folder


ACTS = {
    "reject": lambda run: reject(run, "why"),
    "recover": recover,
    "export": lambda run: export_run(run, run / "log.csv"),
    "seal": lambda run: seal([], run),
    "analyses": lambda run: run_analyses(["a"], pack, run / "work", answer=verdict, jobs=1),
}


def verdict(folder: Path) -> dict:
    return {"verdict": "undecided"}


def pack(_: str) -> dict:
    return {"log-1.csv": b"t_s"}


@pytest.mark.parametrize("name", ACTS)
def test_no_link_in_a_folder_leads_a_write_out_of_it(tmp_path: Path, name: str):
    run, mine = cut_off(tmp_path / "run"), tmp_path / "mine"
    mine.write_text("precious")
    for inside in ("sealed", "work"):
        (run / inside).mkdir()
    parts = ["run.json.part", "samples.mcap.part", "samples.damaged.mcap.part", "log.csv.part"]
    parts += ["sealed/truth.part", "sealed/truth.json.part", "work/a.part", "work/a.json.part"]
    for part in parts:
        (run / part).unlink(missing_ok=True)
        (run / part).symlink_to(mine)
    (run / "samples.damaged.mcap").symlink_to(tmp_path / "new")
    ACTS[name](run)
    assert mine.read_text() == "precious"
    assert not (tmp_path / "new").exists()
    assert not read_run(run).meta["truncated"] or name != "recover"


def rewritten(folder: Path, **changes: object) -> Path:
    file = recorded(folder) / "run.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | changes))
    return folder


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"schema": 1, "x": ' + "[" * 100_000 + "]" * 100_000 + "}", "brackets are too deep"),
        ('{"schema": 1, "arm": "a\\ud800"}', "no Unicode"),
        ('{"schema": 1, "rows": ' + "9" * 5000 + "}", "a number has too many digits"),
        ("{}" + " " * LONGEST, "longer than"),
    ],
)
def test_a_record_beyond_all_measure_is_one_line_and_no_reason_to_list_no_runs(
    tmp_path: Path, text: str, words: str
):
    (recorded(tmp_path / "1-odd") / "run.json").write_text(text)
    with pytest.raises(ValueError, match=words):
        read_run(tmp_path / "1-odd")
    recorded(tmp_path / "2-good")
    assert [row.folder.name for row in list_runs(tmp_path)] == ["2-good"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes with a name")
@pytest.mark.parametrize("name", ["run.json", "samples.mcap"])
def test_a_file_that_becomes_a_pipe_while_it_is_read_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
):
    folder = recorded(tmp_path / "1")
    (folder / name).unlink()
    os.mkfifo(folder / name)
    monkeypatch.setattr(Path, "is_file", lambda path: True)  # it was one when it was looked at
    with pytest.raises(ValueError, match="no file, but a folder, a pipe or a device"):
        read_run(folder)


def test_another_name_of_a_file_in_the_place_of_what_is_about_to_be_written_is_removed(
    tmp_path: Path,
):
    folder, mine = recorded(tmp_path / "1"), tmp_path / "mine"
    mine.write_text("mine")
    (folder / "run.json.part").hardlink_to(mine)
    reject(folder, "why")
    assert read_meta(folder)["rejected"] == "why"
    assert mine.read_text() == "mine"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes with a name")
def test_a_pipe_in_the_place_of_what_is_about_to_be_written_is_removed(tmp_path: Path):
    folder = recorded(tmp_path / "1")
    os.mkfifo(folder / "run.json.part")
    reject(folder, "why")
    assert read_meta(folder)["rejected"] == "why"


def test_a_folder_in_the_place_of_what_is_about_to_be_written_stays(tmp_path: Path):
    folder = recorded(tmp_path / "1")
    (folder / "run.json.part").mkdir()
    reject(folder, "why")
    assert read_meta(folder)["rejected"] == "why"
    assert (folder / "run.json.part").is_dir()


def test_a_folder_is_tried_by_no_name_that_somebody_may_have_taken(tmp_path: Path):
    """`--out` in a folder of a stranger: what ".probe" led to was overwritten."""
    outside, folder = tmp_path / "outside", tmp_path / "folder"
    outside.write_text("mine")
    folder.mkdir()
    (folder / ".probe").symlink_to(outside)
    assert writable(folder) == folder
    assert outside.read_text() == "mine"
    assert [one.name for one in folder.iterdir()] == [".probe"]


def test_a_disk_without_room_is_no_mistake_in_the_input(tmp_path: Path, monkeypatch):
    def full(**_: object):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(run_folder, "TemporaryFile", full)
    with pytest.raises(OSError, match="No space left") as caught:
        writable(tmp_path)
    assert not isinstance(caught.value, PermissionError)


def test_a_folder_whose_name_no_page_could_be_told_is_not_listed(tmp_path: Path):
    recorded(tmp_path / "run")
    try:
        (tmp_path / "run").rename(tmp_path / os.fsdecode(b"run-\xff"))
    except OSError:
        pytest.skip("this file system takes no such name")
    assert list_runs(tmp_path) == []


def test_values_that_others_compute_with_are_checked(tmp_path: Path):
    with pytest.raises(ValueError, match="by_hand = 5 is no list"):
        read_meta(rewritten(tmp_path / "a", by_hand=5))
    with pytest.raises(ValueError, match=r"seed = .* is no int"):  # `rig check` counts with it
        read_meta(rewritten(tmp_path / "c", seed=[7]))
    with pytest.raises(ValueError, match="rows = -5 must be 0 or more"):
        read_meta(rewritten(tmp_path / "b", rows=-5))
    assert rig_of_record({"linkage": {"unknown": 1}}).linkage.plate_side_m == 0.275
    for given in ({"plate_side_m": "wide"}, [1]):
        with pytest.raises(ValueError, match=r"the rig of run\.json"):
            rig_of_record({"linkage": given})


def test_an_event_without_a_text_or_a_time_is_no_event(tmp_path: Path):
    recorder = Recorder(tmp_path, START)
    for event in ([1], {"t_s": 1.0}, {"text": "x"}, {"t_s": "x", "text": "x"}, "\ud800"):
        data = json.dumps(event).encode()
        recorder._write(_bytes(Message(CHANNEL_ID[EVENTS], 0, data, 0, 0)))
    recorder.event(2.0, "good")
    recorder.finish("done")
    assert read_run(tmp_path).events == [{"t_s": 2.0, "text": "good"}]


@pytest.mark.parametrize("private", ["", "samples.mcap"])
def test_what_nobody_but_its_owner_may_read_hides_no_other_run(tmp_path, monkeypatch, private):
    """A folder, or the samples of a run without an end."""
    recorded(tmp_path / "1-good")
    closed = cut_off(tmp_path / "2-private") / private
    look, look_into, descriptor = Path.stat, Path.open, os.open

    def refuse(path: Path) -> None:
        if path == closed or (closed in path.parents):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))

    def stat(path, **how):
        if path != closed:  # its entry is seen, not what is in it
            refuse(path)
        return look(path, **how)

    def opened(path, *how, **more):
        refuse(path)
        return look_into(path, *how, **more)

    monkeypatch.setattr(Path, "stat", stat)

    def opened_low(path, *how, **more):
        refuse(Path(path))
        return descriptor(path, *how, **more)

    monkeypatch.setattr(Path, "open", opened)
    monkeypatch.setattr(os, "open", opened_low)
    monkeypatch.setattr(Path, "is_file", lambda path: S_ISREG(path.stat().st_mode))
    assert [row.folder.name for row in list_runs(tmp_path)] == ["1-good"]
    assert {one.name: one.why for one in runs_of(tmp_path)} == {
        "1-good": "",
        "2-private": "cannot be read (Permission denied)",
    }
