"""A run is recorded, killed, cut short by a full disk, and read back bit for bit."""

import errno
import json
import mmap
import os
import random
import signal
import struct
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from experiments.records import recording
from experiments.records.recording import (
    Recorder,
    being_recorded,
    lock,
    new_run_folder,
    read_run,
    recover,
    write_run,
    write_truth,
)
from experiments.records.samples_file import RECORD, opening, plain_ending
from experiments.records.samples_reading import LEFT_OUT, LONGEST_MESSAGE, MOST_EVENT_BYTES
from experiments.runs.runs import reject
from rig.log import COLUMNS, Log
from tests.support import ROOT
from tests.support.waiting import wait_for

START = {"source": "simulated", "protocol": "hold", "arm": "with", "seed": 7}
ANY = st.floats(allow_nan=True, allow_infinity=True, width=64)
ROWS = arrays(np.float64, st.tuples(st.integers(0, 5), st.just(len(COLUMNS))), elements=ANY)
EVENTS = [{"t_s": 0.0, "text": "begin"}, {"t_s": 0.5, "text": "push", "speed_m_s": [0.1, -0.2]}]


def example(n=100, seed=1):
    rows = np.random.default_rng(seed).normal(size=(n, len(COLUMNS)))
    rows[:, 0] = np.arange(n) * 0.002
    rows[1::2, 5:7] = np.nan
    return rows


def record(folder, rows, events=EVENTS):
    recorder = Recorder(folder, START)
    for event in events:
        recorder.event(**event)
    for row in rows:
        recorder.append(row)
    return recorder


def assert_rows(log, rows):
    assert log.rows.tobytes("C") == np.ascontiguousarray(rows).tobytes()


@settings(max_examples=25)
@given(ROWS, st.booleans())
def test_rows_come_back_bit_for_bit(tmp_path_factory, rows, at_once):
    rows[:, 0] = np.arange(len(rows)) * 0.002
    folder = tmp_path_factory.mktemp("runs") / "run"
    if at_once:
        write_run(folder, START, Log.from_rows(rows), EVENTS)
    else:
        record(folder, rows).finish("done")
    run = read_run(folder)
    assert_rows(run.log, rows)
    assert run.events == EVENTS
    assert run.meta["truncated"] is False
    assert run.meta["rows"] == len(rows)


def test_several_chunks_and_events_among_rows(tmp_path):
    rows = example(5000)
    recorder = Recorder(tmp_path / "a", START)
    for i, row in enumerate(rows):
        if i % 700 == 3:
            recorder.event(row[0], "tick", number=i)
        recorder.append(row)
    before = read_run(tmp_path / "a")
    recorder.finish("done")
    after = read_run(tmp_path / "a")
    for run in before, after:
        assert_rows(run.log, rows)
        assert [event["number"] for event in run.events] == list(range(3, 5000, 700))
    assert (before.meta["truncated"], after.meta["truncated"]) == (True, False)
    assert (before.meta["outcome"], after.meta["outcome"]) == (None, "done")


def test_both_ways_of_writing_leave_the_same_files(tmp_path):
    start = {**START, "created": "2026-11-20T10:15:02Z", "more": "kept"}
    rows = example()
    recorder = Recorder(tmp_path / "a", start)
    for event in EVENTS:
        recorder.event(**event)
    for row in rows:
        recorder.append(row)
    recorder.finish("ball-lost", "it left the plate")
    log = Log.from_rows(rows)
    write_run(tmp_path / "b", start, log, EVENTS, "ball-lost", "it left the plate")
    for name in ("run.json", "samples.mcap"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == ["run.json", "samples.mcap"]


def test_run_json_has_a_start_record_and_then_a_stop_record(tmp_path):
    rig = {"limit_V": np.inf, "gain": np.float64(1.5), "corners": np.eye(2), "file": Path("r.toml")}
    recorder = Recorder(tmp_path, {**START, "rig": rig})
    start = json.loads((tmp_path / "run.json").read_text())
    assert list(start)[:3] == ["schema", "source", "protocol"]
    assert start["outcome"] is None
    assert start["calibration"] is None
    assert start["versions"]["numpy"] == np.__version__
    assert start["rig"] == {
        "limit_V": "inf",
        "gain": 1.5,
        "corners": [[1, 0], [0, 1]],
        "file": "r.toml",
    }
    assert abs(datetime.fromisoformat(start["created"]) - datetime.now(UTC)).total_seconds() < 60
    recorder.append(example()[3])
    recorder.finish("done", "target reached")
    stop = json.loads((tmp_path / "run.json").read_text())
    assert stop == start | {
        "outcome": "done",
        "reason": "target reached",
        "rows": 1,
        "duration_s": 0.006,
    }
    with pytest.raises(ValueError, match="finished already"):
        recorder.finish("done")


def test_truth_stands_in_its_own_file(tmp_path):
    write_run(tmp_path, START, Log.from_rows(example()))
    write_truth(tmp_path, {"effects": {"saturation": {"x": {"limit_V": np.inf}}}})
    truth = json.loads((tmp_path / "truth.json").read_text())
    assert float(truth["effects"]["saturation"]["x"]["limit_V"]) == np.inf
    assert "effects" not in (tmp_path / "run.json").read_text()


@pytest.mark.parametrize(
    ("error", "outcome", "reason"),
    [
        (None, "done", ""),
        (ValueError("encoder silent"), "aborted", "ValueError: encoder silent"),
        (KeyboardInterrupt(), "interrupted", "by the operator"),
        (SystemExit(3), "aborted", "SystemExit: 3"),
    ],
)
def test_the_context_manager_notes_how_it_ended(tmp_path, error, outcome, reason):
    def session():
        with Recorder(tmp_path, START) as recorder:
            recorder.append(example()[0])
            if error:
                raise error

    if error:
        with pytest.raises(type(error)):
            session()
    else:
        session()
    meta = read_run(tmp_path).meta
    assert (meta["outcome"], meta["reason"], meta["truncated"]) == (outcome, reason, False)


def test_an_outcome_given_inside_the_context_stays(tmp_path):
    with Recorder(tmp_path, START) as recorder:
        recorder.finish("ball-lost")
    assert read_run(tmp_path).meta["outcome"] == "ball-lost"


def test_folder_names_sort_by_time_and_never_meet(tmp_path):
    now = datetime(2026, 11, 20, 10, 15, 2, tzinfo=UTC)
    names = [new_run_folder(tmp_path, "hold", "with", now).name for _ in range(3)]
    stem = "20261120T101502-hold-with"
    assert names == [stem, f"{stem}-2", f"{stem}-3"]
    odd = new_run_folder(tmp_path, "my steps/2", "a:b", now)
    assert odd.parent == tmp_path
    assert odd.name == "20261120T101502-my_steps_2-a_b"
    assert new_run_folder(tmp_path / "runs", "hold", "with").is_dir()


def test_a_second_run_in_a_folder_is_refused(tmp_path):
    write_run(tmp_path, START, Log.from_rows(example()))
    for again in (
        lambda: Recorder(tmp_path, START),
        lambda: write_run(tmp_path, START, Log.from_rows(example())),
    ):
        with pytest.raises(FileExistsError, match="another folder"):
            again()
    assert len(read_run(tmp_path).log) == 100


@pytest.mark.parametrize(
    ("start", "words"),
    [
        ({}, "simulated or measured"),
        ({"source": "dreamt"}, "dreamt"),
        ({"source": "measured", "created": "2026-11-20T10:15:02"}, "time zone"),
        ({"source": "measured", "created": "2300-01-01T00:00:00Z"}, "before 2262"),
        ({"source": "measured", "created": "1970-01-01T01:00:00+02:00"}, "from 1970"),
        ({"source": "measured", "created": "1600-01-01T00:00:00Z"}, "from 1970"),
    ],
)
def test_a_bad_start_record_is_refused(tmp_path, start, words):
    with pytest.raises(ValueError, match=words):
        Recorder(tmp_path / "run", start)
    assert not (tmp_path / "run").exists()


def test_a_clock_that_was_never_set_keeps_no_run_from_being_recorded(tmp_path):
    start = START | {"created": "1970-01-01T00:00:07Z"}
    write_run(tmp_path, start, Log.from_rows(example()))
    assert_rows(read_run(tmp_path).log, example())


def test_bad_rows_are_refused_and_leave_no_trace(tmp_path):
    recorder = record(tmp_path, example(3))
    with pytest.raises(ValueError, match=f"{len(COLUMNS)} columns"):
        recorder.append(np.zeros(5))
    for i, t_s in enumerate((np.nan, np.inf, 1e300, -1e10)):
        row = example(1)[0]
        row[0] = t_s
        with pytest.raises(ValueError, match=r"t_s = .* cannot be recorded"):
            recorder.append(row)
        with pytest.raises(ValueError, match=r"t_s = .* cannot be recorded"):
            recorder.event(t_s, "never")
        with pytest.raises(ValueError, match=r"t_s = .* cannot be recorded"):
            write_run(tmp_path / str(i), START, Log.from_rows(row[None]))
        assert not (tmp_path / str(i)).exists()
    recorder.finish("done")
    run = read_run(tmp_path)
    assert_rows(run.log, example(3))
    assert run.events == EVENTS


@pytest.mark.parametrize("at_once", [False, True])
def test_events_beyond_all_measure_are_left_out_and_no_row_is(tmp_path, at_once):
    row = np.zeros(len(COLUMNS))
    size = 60_000
    events = [
        {"t_s": 0.0, "text": f"{i} {'x' * size}"} for i in range(MOST_EVENT_BYTES // size + 9)
    ]
    if at_once:
        write_run(tmp_path / "run", START, Log.from_rows(row[None]), events)
    else:
        recorder = Recorder(tmp_path / "run", START)
        recorder.append(row)
        for event in events:
            recorder.event(**event)
        recorder.append(row)
        recorder.finish("completed")
    run = read_run(tmp_path / "run")
    assert len(run.log) == 2 - at_once
    assert not run.meta["truncated"]
    assert MOST_EVENT_BYTES // size - 2 <= len(run.events) <= MOST_EVENT_BYTES // size + 1
    assert run.events[:-1] == events[: len(run.events) - 1]
    assert run.events[-1] == {"t_s": 0.0, "text": LEFT_OUT}
    assert recover(tmp_path / "run").meta["outcome"] == run.meta["outcome"]


def test_an_event_that_is_too_long_is_left_out_and_the_next_is_not(tmp_path):
    with Recorder(tmp_path / "run", START) as recorder:
        recorder.append(np.zeros(len(COLUMNS)))
        for text in ("x" * (LONGEST_MESSAGE - 50), "x" * LONGEST_MESSAGE, "y" * LONGEST_MESSAGE):
            recorder.event(0.0, text)
        recorder.event(0.0, "released")
    run = read_run(tmp_path / "run")
    assert [one["text"] for one in run.events][1:] == [LEFT_OUT, "released"]
    assert not run.meta["truncated"]


def test_an_event_without_a_text_is_refused(tmp_path):
    with pytest.raises(ValueError, match="t_s and text, this one has t_s"):
        write_run(tmp_path / "a", START, Log.from_rows(example()), [{"t_s": 0.0}])
    assert not (tmp_path / "a").exists()


def test_what_is_no_run_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no run\.json"):
        read_run(tmp_path)
    write_run(tmp_path / "a", START, Log.from_rows(example()))
    (tmp_path / "a/samples.mcap").write_bytes(b"something else")
    with pytest.raises(ValueError, match="MCAP"):
        read_run(tmp_path / "a")
    for text, words in (("{", "readable"), ("[]", "schema"), ('{"schema": 99}', "update")):
        (tmp_path / "a/run.json").write_text(text)
        with pytest.raises(ValueError, match=words):
            read_run(tmp_path / "a")


def run_until_full(folder, rows):
    """Record until the disk refuses; how many rows were taken is in the second value."""
    recorder = Recorder(folder, START)

    def session():
        with recorder:
            for row in rows:
                recorder.append(row)

    with pytest.raises(OSError, match="free disk space") as caught:
        session()
    return caught.value, recorder.rows


def open_files():
    return len(list(Path("/proc/self/fd").iterdir()))


def full_disk(monkeypatch, room):
    """Let `os.write` take `room` bytes, the last piece of them a part of what it was asked."""
    left, write = [room], os.write

    def limited(file, data):
        if not left[0]:
            raise OSError(errno.ENOSPC, "No space left on device")
        written = write(file, data[: left[0]])
        left[0] -= written
        return written

    monkeypatch.setattr(recording.os, "write", limited)


@pytest.mark.parametrize("room", [8_000, 12_345, 20_001])
def test_a_full_disk_is_said_and_what_was_written_stays(tmp_path, monkeypatch, room):
    full_disk(monkeypatch, room)
    rows = example(200)
    error, taken = run_until_full(tmp_path, rows)
    assert error.errno == errno.ENOSPC
    assert f"after {taken} rows" in str(error)
    run = read_run(tmp_path)
    assert 0 < taken < 200
    assert_rows(run.log, rows[:taken])
    assert run.meta["outcome"] == "aborted"
    assert "No space left" in run.meta["reason"]
    assert run.meta["rows"] == taken


def test_the_ending_of_a_full_disk_fits_where_the_older_record_was(tmp_path, monkeypatch):
    """All rows were there, but the run was "cut short", and recover made it "damaged: 20 of 20"."""
    write, replace = os.write, recording.replace_json
    recorder = record(tmp_path, example(20))
    full_disk(monkeypatch, 0)
    monkeypatch.setattr(recorder, "_compress", lambda: None)  # for which there is no room

    def and_make_room(path, content):
        replace(path, content)
        monkeypatch.setattr(recording.os, "write", write)

    monkeypatch.setattr(recording, "replace_json", and_make_room)
    recorder.finish("aborted", "the disk is full")
    run = read_run(tmp_path)
    assert_rows(run.log, example(20))
    assert not run.meta["truncated"]


def test_recover_leaves_the_outcome_of_a_run_that_lacks_its_ending_alone(tmp_path, monkeypatch):
    recorder = record(tmp_path, example(20))
    full_disk(monkeypatch, 0)
    monkeypatch.setattr(recorder, "_compress", lambda: None)
    recorder.finish("aborted", "the disk is full")
    meta = recover(tmp_path).meta
    assert (meta["outcome"], meta["reason"], meta["rows"]) == ("aborted", "the disk is full", 20)
    assert not meta["truncated"]


def test_names_that_are_no_unicode_leave_a_record_that_can_be_read(tmp_path):
    """A protocol's file from another system, k\xfcrze.toml: nobody could read its runs."""
    name = os.fsdecode(b"k\xfcrze")
    recorder = Recorder(tmp_path, START | {"protocol": {"name": name}, name: Path(name)})
    recorder.append(example(1)[0])
    recorder.event(0.0, name)
    recorder.finish("done", name)
    run = read_run(tmp_path)
    assert run.meta["protocol"] == {"name": "k?rze"}
    assert (run.meta["k?rze"], run.meta["reason"]) == ("k?rze", "k?rze")
    assert [event["text"] for event in run.events] == ["k?rze"]


def test_half_a_record_is_taken_back_so_that_the_recording_can_go_on(tmp_path, monkeypatch):
    rows, write = example(50), os.write
    recorder = record(tmp_path, rows[:20])
    size = (tmp_path / "samples.mcap").stat().st_size
    full_disk(monkeypatch, 100)  # of the bytes of one row
    with pytest.raises(OSError, match="after 20 rows"):
        recorder.append(rows[20])
    assert (tmp_path / "samples.mcap").stat().st_size == size
    monkeypatch.setattr(recording.os, "write", write)  # somebody has made room
    for row in rows[20:]:
        recorder.append(row)
    monkeypatch.setattr(recorder, "_compress", lambda: None)
    recorder.finish("completed")
    run = read_run(tmp_path)
    assert_rows(run.log, rows)
    assert not run.meta["truncated"]


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="counts open files in /proc")
def test_a_full_disk_from_the_start_leaves_no_open_file(tmp_path, monkeypatch):
    full_disk(monkeypatch, 100)
    files = open_files()
    with pytest.raises(OSError, match="after 0 rows"):
        Recorder(tmp_path, START)
    assert open_files() == files


def test_a_file_size_limit_of_the_system_ends_the_run_readable(tmp_path):
    resource = pytest.importorskip("resource")
    rows = example(500)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, hard))
        _, taken = run_until_full(tmp_path, rows)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, before)
    run = read_run(tmp_path)
    assert_rows(run.log, rows[:taken])
    assert 100 < taken < 200
    assert run.meta["outcome"] == "aborted"


def test_no_room_to_compress_leaves_the_plain_file(tmp_path, monkeypatch):
    def refuse(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(recording, "write_whole", refuse)
    record(tmp_path, example()).finish("done")
    run = read_run(tmp_path)
    assert_rows(run.log, example())
    assert (run.meta["truncated"], run.meta["outcome"]) == (False, "done")


def test_recover_completes_a_killed_run_once(tmp_path):
    recorder = record(tmp_path, example())
    os.write(recorder._file, b"\x05half a record")
    os.close(recorder._file)  # as a kill does
    run = recover(tmp_path)
    assert_rows(run.log, example())
    assert run.events == EVENTS
    assert (run.meta["truncated"], run.meta["outcome"]) == (False, "killed")
    content = (tmp_path / "samples.mcap").read_bytes(), (tmp_path / "run.json").read_bytes()
    os.utime(tmp_path / "run.json", (0, 0))
    recover(tmp_path)
    assert (tmp_path / "run.json").stat().st_mtime == 0  # it was not written again
    assert not (tmp_path / "samples.damaged.mcap").exists()  # half a record is nothing to keep
    assert content == (
        (tmp_path / "samples.mcap").read_bytes(),
        (tmp_path / "run.json").read_bytes(),
    )


def test_recover_keeps_the_bytes_that_it_cannot_read(tmp_path):
    rows = example()
    recorder = record(tmp_path, rows, events=[])
    os.close(recorder._file)
    path = tmp_path / "samples.mcap"
    content = bytearray(path.read_bytes())
    content[len(opening()) + 10 * RECORD.itemsize + 4] ^= 0x08  # the length of row 10
    path.write_bytes(content)
    assert_rows(recover(tmp_path).log, np.delete(rows, 10, axis=0))
    assert (tmp_path / "samples.damaged.mcap").read_bytes() == content


@pytest.mark.parametrize(("more", "kept"), [(-1, False), (0, True)])
def test_recover_keeps_a_tail_that_may_be_a_whole_row(tmp_path, more: int, kept: bool):
    recorder = record(tmp_path, example(), events=[])
    os.write(recorder._file, bytes(RECORD.itemsize + more))
    os.close(recorder._file)
    recover(tmp_path)
    assert (tmp_path / "samples.damaged.mcap").exists() == kept


def test_recover_of_a_run_that_was_killed_before_its_last_word_leaves_its_rows(tmp_path):
    recorder = record(tmp_path, example())
    recorder._write(plain_ending())
    os.close(recorder._file)
    content = (tmp_path / "samples.mcap").read_bytes()
    meta = recover(tmp_path).meta
    assert (meta["outcome"], meta["rows"], meta["duration_s"]) == ("killed", 100, 99 * 0.002)
    assert (tmp_path / "samples.mcap").read_bytes() == content


def test_recover_of_a_run_that_had_ended_names_what_it_lost(tmp_path):
    recorder = record(tmp_path, example(), events=[])
    recorder._compress = lambda: None  # type: ignore[method-assign]
    recorder.finish("completed")
    path, older = tmp_path / "samples.mcap", tmp_path / "samples.damaged.mcap"
    content = path.read_bytes()
    damaged = content[: len(opening()) + 40 * RECORD.itemsize] + bytes(2000)
    path.write_bytes(damaged)
    older.write_bytes(b"of an earlier time")
    meta = recover(tmp_path).meta
    assert (meta["outcome"], meta["rows"], meta["duration_s"]) == ("damaged", 40, 39 * 0.002)
    assert meta["reason"] == "40 of 100 rows left of a run that had ended"
    assert older.read_bytes() == b"of an earlier time"
    assert [one.read_bytes() for one in tmp_path.glob("samples.damaged-*.mcap")] == [damaged]
    path.write_bytes(damaged)
    recover(tmp_path)  # kept already
    assert len(list(tmp_path.glob("samples.damaged*"))) == 2


def test_recover_of_a_run_without_rows(tmp_path):
    os.close(record(tmp_path, example()[:0])._file)
    meta = recover(tmp_path).meta
    assert (meta["outcome"], meta["rows"], meta["duration_s"]) == ("killed", 0, None)


@pytest.mark.skipif(sys.platform == "win32", reason="locks of POSIX")
def test_recover_and_lists_that_ask_at_once_take_each_other_for_no_recorder(tmp_path):
    recorder = record(tmp_path, example()[:5])
    recorder.finish("done")
    with (tmp_path / "samples.mcap").open("rb") as asks:
        assert lock(asks.fileno(), shared=True)
        assert not being_recorded(tmp_path)
        assert not lock(os.open(tmp_path / "samples.mcap", os.O_RDONLY))


@pytest.mark.skipif(sys.platform == "win32", reason="locks of POSIX")
def test_a_recording_is_locked_though_somebody_asks_as_it_begins(tmp_path, monkeypatch):
    """Who asks has the lock for a moment; who keeps it prevents the recording."""
    import fcntl

    locked, tries = fcntl.flock, []

    def flock(file: int, how: int) -> None:
        tries.append(how)
        if len(tries) < 4:
            raise BlockingIOError
        locked(file, how)

    monkeypatch.setattr(fcntl, "flock", flock)
    recorder = record(tmp_path / "run", example()[:5])
    assert len(tries) == 4
    assert being_recorded(tmp_path / "run")
    recorder.finish("done")
    tries.clear()
    monkeypatch.setattr(recording, "LOCK_S", 0.0)
    with pytest.raises(OSError, match="another program keeps"):
        record(tmp_path / "other", example()[:5])


def test_a_system_or_a_disk_without_locks_is_no_reason_not_to_record(tmp_path):
    """Windows has none; a network disk says so; any other error is heard."""
    file, before = os.open(tmp_path / "file", os.O_CREAT | os.O_RDWR), sys.modules.get("fcntl")

    def refuse(number: int) -> None:
        def flock(*_: object) -> None:
            raise OSError(number, "no locks")

        sys.modules["fcntl"] = SimpleNamespace(flock=flock, LOCK_EX=2, LOCK_NB=4)  # type: ignore

    try:
        sys.modules["fcntl"] = None  # type: ignore[assignment]
        assert lock(file) is True
        for number in (errno.ENOLCK, errno.EOPNOTSUPP):
            refuse(number)
            assert lock(file) is True
        refuse(errno.EIO)
        with pytest.raises(OSError, match="no locks"):
            lock(file)
    finally:
        os.close(file)
        sys.modules.pop("fcntl")
        if before is not None:
            sys.modules["fcntl"] = before


def test_recover_leaves_a_living_run_alone_however_quiet_it_is(tmp_path):
    rows = example()
    recorder = record(tmp_path, rows[:50])
    with pytest.raises(ValueError, match="still being recorded"):
        recover(tmp_path)
    for row in rows[50:]:
        recorder.append(row)
    recorder.finish("done")
    assert_rows(read_run(tmp_path).log, rows)
    assert recover(tmp_path).meta["outcome"] == "done"


def test_a_recording_that_is_exchanged_while_it_is_made_is_not_called_complete(tmp_path):
    """What lies there is not it: a sentence, in place of what is wrong with the other file."""
    recorder = Recorder(tmp_path, START)
    (tmp_path / "samples.mcap").rename(tmp_path / "moved")
    (tmp_path / "samples.mcap").write_bytes(b"somebody else's")
    with pytest.raises(OSError, match="removed while it was recorded"):
        recorder.finish("completed")
    assert (tmp_path / "samples.mcap").read_bytes() == b"somebody else's"


def test_a_recording_that_is_removed_while_it_is_made_is_not_called_complete(tmp_path):
    recorder = record(tmp_path, example())
    (tmp_path / "samples.mcap").unlink()
    with pytest.raises(OSError, match="removed while it was recorded"):
        recorder.finish("completed")
    assert json.loads((tmp_path / "run.json").read_text())["outcome"] is None


CHILD = """
import mmap, sys, time
import numpy as np
from experiments.records.recording import Recorder
from rig.log import COLUMNS
folder, shared = sys.argv[1:]
file = open(shared, "r+b")
done = np.frombuffer(mmap.mmap(file.fileno(), 16), "<f8")  # outlives the process
recorder = Recorder(folder, {"source": "measured"})
start = time.monotonic()
row = np.empty(len(COLUMNS))
for tick in range(100000):
    while time.monotonic() < start + tick * 0.002:
        time.sleep(0.0005)
    row[:] = tick + np.arange(len(COLUMNS)) / 64
    row[0] = time.monotonic() - start
    recorder.append(row)
    done[0], done[1] = row[0], tick + 1
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="kill -9 is of POSIX")
def test_kill_9_takes_nothing_that_is_older_than_a_fifth_of_a_second(tmp_path, request):
    """Children record in real time and are killed at random moments; what they had is there."""
    children = []
    for i in range(4):
        shared = tmp_path / f"{i}.done"
        shared.write_bytes(bytes(16))
        command = [sys.executable, "-c", CHILD, str(tmp_path / str(i)), str(shared)]
        children.append((subprocess.Popen(command, cwd=ROOT), i))
        request.addfinalizer(children[-1][0].kill)
    for child, i in children:
        with (tmp_path / f"{i}.done").open("rb") as file:
            view = mmap.mmap(file.fileno(), 16, access=mmap.ACCESS_READ)
            wait_for("row 20", lambda now=view: struct.unpack("<2d", now[:16])[1] >= 20)
            time.sleep(random.uniform(0.0, 0.4))
            child.send_signal(signal.SIGKILL)
            child.wait()
            last_s, count = struct.unpack("<2d", view[:16])
            view.close()
        run = read_run(tmp_path / str(i))
        assert count >= 20
        assert run.meta["truncated"] is True
        assert run.meta["outcome"] is None
        assert len(run.log) >= count
        assert run.log["t_s"][-1] >= last_s  # promised: last_s - 0.2
        ticks = np.arange(len(run.log))[:, None] + np.arange(len(COLUMNS)) / 64
        np.testing.assert_array_equal(run.log.rows[:, 1:], ticks[:, 1:])
        assert (np.diff(run.log["t_s"]) > 0).all()


def test_a_run_that_is_being_recorded_is_not_rejected_to_be_forgotten(tmp_path: Path):
    with Recorder(tmp_path / "run", START) as recorder:
        with pytest.raises(ValueError, match="still being recorded: reject it when it has ended"):
            reject(tmp_path / "run", "hand on the plate")
        recorder.finish("completed")
    for nothing in ("", "  "):
        with pytest.raises(ValueError, match="reason is empty: say why"):
            reject(tmp_path / "run", nothing)
    reject(tmp_path / "run", "hand on the plate")
    assert read_run(tmp_path / "run").meta["rejected"] == "hand on the plate"
