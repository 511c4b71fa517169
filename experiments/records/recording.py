"""Record a run tick by tick or at once, and read it back.

A row is given to the operating system in the tick in which it is appended (one small write), so
that a kill -9 takes none of the rows before it.
"""

import errno
import math
import os
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from experiments.records import unforked
from experiments.records.run_folder import (
    nanoseconds,
    new_run_folder,
    plain,
    read_meta,
    refuse_second_run,
    replace_json,
    reserve,
    start_record,
    stop_record,
    write_truth,
)
from experiments.records.samples_file import (
    HEAD,
    LONGEST_S,
    MESSAGE_HEAD,
    RECORD,
    SHORTEST_S,
    check_times,
    event_record,
    finished_file,
    message_records,
    opening,
    plain_ending,
)
from experiments.records.samples_reading import (
    LEAST_EVENT,
    LEFT_OUT,
    LONGEST_MESSAGE,
    MOST_EVENT_BYTES,
    SamplesFile,
    read_samples,
)
from rig.files import READS, file_bytes, write_whole
from rig.log import COLUMNS, Log
from rig.loop.loop import ending_of

__all__ = ["Recorder", "Run", "new_run_folder", "read_run", "recover", "write_run", "write_truth"]

LONGEST_SAMPLES = 1 << 32  # bytes; chosen: three hours at 1 kHz, uncompressed
LOCK_S = 1.0  # chosen: who asks has the lock for a millisecond, on a busy machine for ten
DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@dataclass(frozen=True, eq=False)
class Run:
    """A run as read from its folder.

    meta: run.json, and "truncated" (True where the samples end before their time); events: dicts
    with "t_s", "text" and plain data; growing: a program was writing it still.
    """

    folder: Path
    meta: dict
    log: Log
    events: list[dict]
    growing: bool = False

    @property
    def part(self) -> str:
        """Why its rows are a part of the run, in words; "" where they are not."""
        if self.growing:
            return "still being recorded: these are its rows so far"
        return "the recording was cut off" if self.meta["truncated"] else ""


class Recorder:
    """Records a run while it happens; a context manager that also notes how the run ended.

    `folder`: made where missing. `start`: the start record, "source" ("simulated" or "measured")
    and what else is known of `START_KEYS`; further keys are kept. FileExistsError: the folder holds
    a run already. ValueError: another source, or a "created" without time zone. OSError: nothing
    can be written there.
    """

    def __init__(self, folder: Path | str, start: dict) -> None:
        self.folder = Path(folder)
        self.rows = 0
        self._start = start_record(start)
        self._start_ns = nanoseconds(self._start["created"])
        self._events = 0
        self._event_room = MOST_EVENT_BYTES - LONGEST_MESSAGE  # bytes; what is left tells of more
        self._left_out = False
        self._last_s = math.nan
        self._finished = False
        self._record = message_records(np.zeros((1, len(COLUMNS))), 0)
        self._bytes = self._record.view(np.uint8).data
        self._values = self._record["cells"]["value"][0]
        self._size = 0
        refuse_second_run(self.folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        replace_json(self.folder / "run.json", self._start)
        reserve(self.folder / "run.json")
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
        self._file = os.open(self.folder / "samples.mcap", flags, 0o644)
        unforked.keep_to_itself(self._file)
        try:
            _lock_soon(self._file, self.folder)
            self._write(opening())
        except OSError:
            unforked.close(self._file)
            raise

    def append(self, row: np.ndarray) -> None:
        """Record the row (len(COLUMNS),) of one tick. ValueError: its shape or time is wrong.

        OSError: it could not be written (a full disk); all rows before it stay readable.
        """
        if len(row) != len(COLUMNS):
            raise ValueError(f"a row has {len(COLUMNS)} columns (rig.log.COLUMNS), not {len(row)}")
        t_s = float(row[0])
        if not SHORTEST_S <= t_s <= LONGEST_S:
            check_times(t_s)
        record = self._record
        record["sequence"] = self.rows
        record["log_time"] = record["publish_time"] = self._start_ns + round(t_s * 1e9)
        self._values[:] = row
        self._write(self._bytes)
        self._last_s = t_s
        self.rows += 1

    def event(self, t_s: float, text: str, **data: Any) -> None:
        """Record the event `text` at t_s [s], with further data that JSON can hold.

        What no reader would take, because it is too long or comes after too many, is left out, and
        the first time the event `LEFT_OUT` stands in its place. ValueError: the time cannot be
        recorded. OSError: it could not be written.
        """
        event = plain({"t_s": float(t_s), "text": text, **data})
        record = event_record(event, self._start_ns, self._events)
        size = max(len(record) - HEAD - MESSAGE_HEAD, LEAST_EVENT)
        if size > min(self._event_room, LONGEST_MESSAGE):
            if self._left_out:
                return
            self._left_out, size = True, 0  # room for this one is kept
            event = {"t_s": float(t_s), "text": LEFT_OUT}
            record = event_record(event, self._start_ns, self._events)
        self._write(record)
        self._event_room -= size
        self._events += 1

    def finish(self, outcome: str, reason: str = "", **notes: Any) -> None:
        """End the recording and write the stop record, with `notes` (plain data) if there are any.

        outcome: one word or two, such as "completed"; reason: a sentence. The samples are rewritten
        compressed and indexed; without room for that they stay as they are, complete all the same.
        ValueError: the recording was finished before. OSError: run.json cannot be written, or the
        file that was written is no longer in its folder.
        """
        if self._finished:
            raise ValueError(f"the recording in {self.folder} is finished already")
        self._finished = True
        duration_s = self._last_s if self.rows else None
        start = self._start | plain(notes)
        stop = stop_record(start, outcome, reason, self.rows, duration_s)
        try:
            ended = self._end_file()
            if not self._is_in_place():
                raise OSError(f"{self.folder}: samples.mcap was removed while it was recorded")
            replace_json(self.folder / "run.json", stop)
            if not ended:  # on a full disk the older run.json has made room for it
                self._end_file()
        finally:
            unforked.close(self._file)
        with suppress(OSError):
            self._compress()

    def _end_file(self) -> bool:
        """Whether the samples could be given their ending; without it the rows are readable too."""
        with suppress(OSError):
            self._write(plain_ending())
            return True
        return False

    def _is_in_place(self) -> bool:
        """Whether the file that was written is the one in the folder still."""
        with suppress(OSError):
            there = os.stat(self.folder / "samples.mcap")  # noqa: PTH116  (as of the open one)
            return os.path.samestat(os.fstat(self._file), there)
        return False

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, _: object) -> None:
        """Finish a recording not finished yet: as "done", or as `error` ended it."""
        if self._finished:
            return
        if error is None:
            self.finish("done")
        else:
            self.give_up(error)

    def give_up(self, error: BaseException, **notes: Any) -> None:
        """Finish a run that `error` ended, with the outcome and reason that the error stands for.

        notes: as of `finish`. Does not raise OSError: that error becomes a note of `error`.
        """
        ending = ending_of(error)
        try:
            self.finish(ending.outcome, ending.reason, **notes)
        except OSError as second:  # the first error is the one to hear of
            error.add_note(f"run.json has no outcome: {second}")

    def _compress(self) -> None:
        """Rewrite the samples compressed and indexed, if every row is found again."""
        path = self.folder / "samples.mcap"
        samples = read_samples(path.read_bytes())
        if samples.complete and len(samples.rows) >= self.rows:
            _rewrite(path, samples, self._start_ns)

    def _write(self, data: bytes | memoryview) -> None:
        """Give all of `data` to the system, or none: half a record is taken back."""
        written = 0
        try:
            while written < len(data):
                written += os.write(self._file, data[written:])
        except OSError as error:
            with suppress(OSError):
                os.ftruncate(self._file, self._size)
                os.lseek(self._file, self._size, os.SEEK_SET)
            cure = "free disk space" if error.errno in DISK_ERRORS else "check the disk"
            raise OSError(
                error.errno,
                f"{self.folder}: recording failed after {self.rows} rows, which stay readable "
                f"({os.strerror(error.errno or 0)}): {cure}",
            ) from error
        self._size += written


def write_run(
    folder: Path | str,
    start: dict,
    log: Log,
    events: Sequence[dict] = (),
    outcome: str = "done",
    reason: str = "",
) -> None:
    """Write a whole finished run at once, with the content that a `Recorder` would have written.

    start: as of `Recorder`; events: dicts with "t_s", "text" and plain data. FileExistsError: the
    folder holds a run. ValueError: a start record, time or event that cannot be recorded. OSError:
    the folder cannot be written.
    """
    folder, record = Path(folder), start_record(start)
    refuse_second_run(folder)
    start_ns = nanoseconds(record["created"])
    content = finished_file(log.rows, plain(list(events)), start_ns)  # before anything is made
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "samples.mcap", content)
    duration_s = float(log["t_s"][-1]) if len(log) else None
    stop = stop_record(record, outcome, reason, len(log), duration_s)
    replace_json(folder / "run.json", stop)


def read_run(folder: Path | str) -> Run:
    """Read a run folder, also one that was cut off by a kill (meta["truncated"] is True then).

    FileNotFoundError: run.json or samples.mcap is missing. ValueError: they are not readable as a
    run.
    """
    folder = Path(folder)
    for name in ("run.json", "samples.mcap"):
        if not (folder / name).is_file():
            raise FileNotFoundError(f"{folder} is no run folder: it has no {name}")
    growing = being_recorded(folder)  # before it is read: it may end meanwhile
    try:
        meta = read_meta(folder)
        samples = read_samples(file_bytes(folder / "samples.mcap", LONGEST_SAMPLES))
    except ValueError as error:
        raise ValueError(f"{folder} is not readable as a run: {error}") from error
    rows = meta.get("rows")
    meta["truncated"] = not samples.complete or (rows is not None and len(samples.rows) < rows)
    return Run(folder, meta, Log.from_rows(samples.rows), samples.events, growing)


def being_recorded(folder: Path | str) -> bool:
    """Whether a program is still writing the recording in `folder`."""
    path = Path(folder) / "samples.mcap"
    return path.is_file() and _is_locked(path)


def recover(folder: Path | str, outcome: str = "killed", reason: str = "recovered later") -> Run:
    """Complete a run that was killed: whole records compressed and indexed, with this outcome and
    reason.

    A run that had ended but lost rows gets the outcome "damaged", one that has them all keeps its
    own; a complete run is only read. A file that held more than could be read, or columns and
    topics of another version or tool, stays as samples.damaged.mcap, with its hash where an earlier
    one lies there.
    Errors as of `read_run`; ValueError: it is still being recorded; OSError: no room for the new
    file (the old one stays).
    """
    path = Path(folder) / "samples.mcap"
    if being_recorded(folder):
        raise ValueError(f"{folder} is still being recorded: stop that run first")
    run = read_run(folder)
    if run.meta["truncated"]:
        _keep_damaged(path, ended=run.meta["outcome"] is not None)
        start_ns = nanoseconds(run.meta["created"])
        _rewrite(path, SamplesFile(run.log.rows, run.events), start_ns)
    if run.meta["outcome"] is None or run.meta["truncated"]:
        meta = {key: value for key, value in run.meta.items() if key != "truncated"}
        last_s = float(run.log["t_s"][-1]) if len(run.log) else None
        rows, ended = run.meta.get("rows"), run.meta["outcome"] is not None
        if ended and rows is not None and len(run.log) >= rows:  # its ending, or an event, is lost
            outcome, reason = str(run.meta["outcome"]), run.meta.get("reason") or ""
        elif ended:
            outcome = "damaged"
            reason = f"{len(run.log)} of {rows} rows left of a run that had ended"
        meta = stop_record(meta, outcome, reason, len(run.log), last_s)
        replace_json(run.folder / "run.json", meta)
    return read_run(folder)


def _keep_damaged(path: Path, *, ended: bool) -> None:
    """Keep a file that may hold more than could be read, beside the one that replaces it.

    Half a record at the end is what a kill leaves: of that there is nothing to be had. A run that
    had `ended` lost rows otherwise, and what another version or tool wrote would be lost here.
    """
    content = file_bytes(path, LONGEST_SAMPLES)
    found = read_samples(content)
    is_killed = found.unread == found.tail < RECORD.itemsize
    if not ended and is_killed and not found.foreign:
        return
    kept = path.with_suffix(f".damaged{path.suffix}")
    if kept.exists():  # of an earlier damage
        kept = path.with_suffix(f".damaged-{sha256(content).hexdigest()}{path.suffix}")
    write_whole(kept, content)


def _rewrite(path: Path, samples: SamplesFile, start_ns: int) -> None:
    """Replace a file by its compressed and indexed form; it is whole at every moment."""
    write_whole(path, finished_file(samples.rows, samples.events, start_ns), sync=True)


def _lock_soon(file: int, folder: Path) -> None:
    """Lock a recording that begins: who asks whether it is locked has it for a moment. OSError:
    another program keeps it.
    """
    until_s = time.monotonic() + LOCK_S
    while not lock(file):
        if time.monotonic() > until_s:
            raise OSError(errno.EBUSY, f"{folder}: another program keeps samples.mcap locked")
        time.sleep(LOCK_S / 100)


def lock(file: int, *, shared: bool = False) -> bool:
    """Lock an open file for its process; shared: with others that ask so. False: another has it.

    On Windows the open file itself is the lock: it cannot be replaced.
    """
    try:
        import fcntl
    except ImportError:
        return True
    try:
        fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno not in (errno.ENOLCK, errno.EOPNOTSUPP):  # a disk without locks: go on
            raise
    return True


def _is_locked(path: Path) -> bool:
    """Whether a recorder has the file."""
    handle = os.open(path, READS)
    try:
        return not lock(handle, shared=True)
    finally:
        os.close(handle)
