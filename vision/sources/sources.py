"""What `open_source` gives: an iterator of frames, from something kept or something live."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from types import TracebackType

import numpy as np

from vision.frames import Frame
from vision.live import LiveReader
from vision.recorded import Recorded
from vision.repeats import RepeatFilter
from vision.source_errors import GarbageError


class Source:
    """Iterator of `Frame` and context manager over any address; see `vision.sources.open_source`.

    `size` is (w, h) px, `duplicates` the repeats skipped so far, `nominal_fps` what the container
    claims, `frames_total` how many frames it claims (None where it does not say), `missing` how
    many of these could not be decoded (known after the last frame), `live` whether it can be read
    only once, `stamped_by` whose times they are ("container", "kernel", "stream", "server",
    "camera" or "arrival"). Of a live source, `dropped` counts the frames that came while nobody
    asked, and `start_s` is the zero of the times on `time.monotonic` (None for what is kept).
    """

    live = False
    start_s: float | None = None

    def __init__(
        self,
        address: str,
        read: Callable[[], tuple[np.ndarray, float] | None],
        close: Callable[[], None],
        *,
        fps: float,
        frames_total: int | None,
    ) -> None:
        self.address = address
        self.nominal_fps = fps
        self.frames_total = frames_total
        self.missing = 0
        self._read, self._close = read, close
        self._index = 0
        try:
            first = read()
            if first is None:
                raise ValueError(f"{address}: no frame could be decoded; is the file complete?")
        except BaseException:
            close()
            raise
        self._first: tuple[np.ndarray, float] | None = first
        self.size = (first[0].shape[1], first[0].shape[0])

    def __enter__(self) -> Source:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._close()

    def __iter__(self) -> Source:
        return self

    def __next__(self) -> Frame:
        raise NotImplementedError

    @property
    def duplicates(self) -> int:
        raise NotImplementedError

    @property
    def dropped(self) -> int:
        return 0

    @property
    def stamped_by(self) -> str:
        return "container"

    def _next(self) -> tuple[np.ndarray, float] | None:
        first, self._first = self._first, None
        return first if first is not None else self._read()

    def reconnect(self, timeout_s: float | None = None) -> None:
        """Close and open a live source again, see `LiveReader.reconnect`; nothing for others."""


class RecordedSource(Source):
    """Every frame of something kept, at the container's times, without its repeats."""

    def __init__(self, address: str, kept: Recorded) -> None:
        self._filter = RepeatFilter(repeats=kept.repeats)
        self._repeats = 0
        self._last_t_s = -math.inf
        super().__init__(
            address, kept.read, kept.close, fps=kept.fps, frames_total=kept.frames_total
        )

    @property
    def duplicates(self) -> int:
        return self._repeats

    def __next__(self) -> Frame:
        while (got := self._next()) is not None:
            image, stamp_s = got
            index, t_s = self._index, self._sane_time(stamp_s)
            self._index += 1
            if not self._filter.is_repeat(image):
                return Frame(image, t_s, index)
            self._repeats += 1
        self._count_missing()
        raise StopIteration

    def _sane_time(self, stamp_s: float) -> float:
        """The container's stamp where it moves on, else the last one plus a nominal frame."""
        if not math.isfinite(stamp_s) or stamp_s <= self._last_t_s:
            start = 0.0 if self._last_t_s == -math.inf else self._last_t_s
            stamp_s = start + (1.0 / self.nominal_fps if self._index else 0.0)
        self._last_t_s = stamp_s
        return stamp_s

    def _count_missing(self) -> None:
        # A variable rate makes the claimed count a guess, hence the second look at the time.
        if self.frames_total is None:
            return
        short = self.frames_total - self._index
        end_s = self.frames_total / self.nominal_fps
        if short > 1 and self._last_t_s + 2.0 / self.nominal_fps < end_s:
            self.missing = short


class LiveSource(Source):
    """The newest frame of a camera or stream, at its own or its arrival's time.

    After a `SourceError` the next frame may be asked for: it connects again where that is needed.
    """

    live = True

    def __init__(self, address: str, reader: LiveReader, fps: float) -> None:
        self._reader = reader
        self.start_s = reader.start_s
        self._skipped_first = 0
        super().__init__(address, self._first_read, reader.close, fps=fps, frames_total=None)
        self._read = reader.read

    def _first_read(self) -> tuple[np.ndarray, float] | None:
        """Whoever comes in the middle of a stream may find half a frame; the next one is whole."""
        deadline_s = time.monotonic() + self._reader.patience_s
        while True:
            try:
                return self._reader.read()
            except GarbageError:
                if time.monotonic() > deadline_s:
                    raise

    @property
    def duplicates(self) -> int:
        return self._reader.duplicates

    @property
    def dropped(self) -> int:
        return self._reader.dropped + self._skipped_first

    @property
    def stamped_by(self) -> str:
        return self._reader.stamped_by

    def __next__(self) -> Frame:
        if self._first is not None and self._reader.newer():
            self._first = None  # it was read to know the size, and has aged since
            self._skipped_first = 1
        got = self._next()
        if got is None:
            raise StopIteration
        # Frames that nobody took count, as the repeats of a file do.
        index = self._index + self.dropped + self.duplicates
        self._index += 1
        return Frame(*got, index)

    def reconnect(self, timeout_s: float | None = None) -> None:
        self._reader.reconnect(timeout_s)
