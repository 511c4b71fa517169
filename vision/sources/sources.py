"""Where do frames come from? A video file, a folder of images, a stream or a camera.

`open_source` gives an iterator of frames (`Source`). Repeats that a container shows between two
exposures are skipped and counted (`repeats`). A live source is read by a thread of its own
(`live`); its failures are `source_errors`.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

import numpy as np

from vision.frames import Frame
from vision.sources.addresses import without_password
from vision.sources.camera_device import DEVICE, open_camera
from vision.sources.live import PATIENCE_S, Feed, LiveReader
from vision.sources.mjpeg_http import HttpFeed, NotMultipartError
from vision.sources.recorded import DEFAULT_FPS, RecordedFrames, open_file, open_folder
from vision.sources.repeats import RepeatFilter
from vision.sources.source_errors import GarbageError, GoneError
from vision.sources.stream import StreamFeed
from vision.sources.user_camera import UserFeed, load_class, split_address

STREAM = re.compile(r"^(rtsps?|https?|udp|tcp|rtmp)://")


def recorded(address: str) -> Path | None:
    """The film or folder of an address, there or not; None of a live one: camera 0 is no folder of
    that name, nor is /dev/video0 a film.
    """
    live = split_address(address) or DEVICE.match(address) or STREAM.match(address)
    return None if live else Path(address)


def check_address(address: str) -> None:
    """Raise FileNotFoundError where the address is of a file, and nothing is there."""
    own = split_address(address)
    path = own[0] if own else recorded(address)
    if path is not None and not path.exists():
        raise FileNotFoundError(f"{path}: no such file or folder; check the address")


def open_source(
    address: str | Path | int,
    *,
    fps: float | None = None,
    start_s: float | None = None,
    patience_s: float = PATIENCE_S,
) -> Source:
    """Open any address: a video file, a folder of images, a stream (http, rtsp, udp), a camera by
    index or device path (/dev/video0), a camera class in a user's file ("mine.py:MyCamera").

    `fps`: the rate of a folder, whose images carry no time (default 30); `patience_s`: how long a
    live source waits for something new before it raises `StalledError`. Times of files are the
    container's. Those of live sources count from `start_s` on `time.monotonic` (default: the
    opening) and are the middle of the exposure where it is known, else the driver's or server's
    stamp, else the arrival.

    `FileNotFoundError`: nothing is there; `ValueError`: nothing can be decoded, or a user's file
    without a class; a `SourceError`: troubles of a live source.
    """
    text = str(address)
    user = split_address(text)
    if user is not None:
        file, name = user
        make = load_class(file, name)
        return _live(text, lambda: UserFeed(file, name, make), patience_s, start_s)
    if DEVICE.match(text):
        return _live(text, lambda: open_camera(text), patience_s, start_s)
    if STREAM.match(text):
        return _open_stream(text, patience_s, start_s)
    path = Path(text)
    if path.suffix == ".py":
        raise ValueError(f"{text}: which camera class in that file? write {text}:MyCamera")
    if path.is_dir():
        return RecordedSource(text, open_folder(path, fps or DEFAULT_FPS))
    check_address(text)
    if path.stat().st_size == 0:
        raise ValueError(f"{text}: the file is empty (0 bytes)")
    return RecordedSource(text, open_file(path))


def _open_stream(text: str, patience_s: float, start_s: float | None) -> Source:
    if text.startswith("http"):
        try:
            return _live(text, lambda: HttpFeed(text, timeout_s=patience_s), patience_s, start_s)
        except NotMultipartError as error:
            first = _other_http(text, patience_s, error)
    else:
        first = StreamFeed(text, timeout_s=patience_s)
    if first.is_file:
        first.close()
        return RecordedSource(without_password(text), open_file(text))
    return _live(
        text, lambda: StreamFeed(text, timeout_s=patience_s), patience_s, start_s, first=first
    )


def _other_http(text: str, patience_s: float, error: NotMultipartError) -> StreamFeed:
    """Open what HTTP serves besides MJPEG, such as a file or a playlist."""
    try:
        return StreamFeed(text, timeout_s=patience_s)
    except GoneError:
        raise NotMultipartError(f"{error}, nor a video that can be decoded") from None


def _live(
    text: str,
    connect: Callable[[], Feed],
    patience_s: float,
    start_s: float | None,
    *,
    first: Feed | None = None,
) -> Source:
    """The source of `connect`; `first` is a connection that stands already."""
    first = first or connect()
    claimed = getattr(first, "fps", 0.0)
    fps = claimed if math.isfinite(claimed) and 0.1 < claimed < 1e4 else DEFAULT_FPS
    waiting = [first]
    shown = without_password(text)
    reader = LiveReader(
        lambda: waiting.pop() if waiting else connect(),
        shown,
        patience_s=patience_s,
        start_s=start_s,
    )
    return LiveSource(shown, reader, fps)


class Source:
    """Iterator of `Frame` and context manager over any address; see `sources.open_source`.

    `size`: (w, h) px; `duplicates`: the repeats skipped so far; `nominal_fps`: what the container
    claims; `frames_total`: how many frames it claims (None where it does not say); `missing`: how
    many of these could not be decoded (known after the last frame); `live`: whether it can be read
    only once; `stamped_by`: whose times they are ("container", "kernel", "stream", "server",
    "camera" or "arrival"). Of a live source, `dropped` counts the frames that came while nobody
    asked, and `start_s` is the zero of the times on `time.monotonic` (None for a recording).

    `RecordedSource` and `LiveSource` are its two kinds. `ValueError`: no first frame can be
    decoded.
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
        """Repeats skipped so far."""
        raise NotImplementedError

    @property
    def dropped(self) -> int:
        """Frames that came while nobody asked; 0 for a recording."""
        return 0

    @property
    def stamped_by(self) -> str:
        """Whose times the frames carry; "container" for a recording."""
        return "container"

    def _next(self) -> tuple[np.ndarray, float] | None:
        first, self._first = self._first, None
        return first if first is not None else self._read()

    def reconnect(self, timeout_s: float | None = None) -> None:
        """Close a live source and open it again, see `LiveReader.reconnect`; nothing happens for a
        recording."""


class RecordedSource(Source):
    """Every frame of a file or folder, at the container's times, without its repeats.

    `address` is shown in messages; `kept`: from `open_file` or `open_folder`.
    """

    def __init__(self, address: str, kept: RecordedFrames) -> None:
        self._filter = RepeatFilter(repeats=kept.repeats)
        self._repeats = 0
        self._last_t_s = -math.inf
        super().__init__(
            address, kept.read, kept.close, fps=kept.fps, frames_total=kept.frames_total
        )

    @property
    def duplicates(self) -> int:
        """Repeats skipped so far."""
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

    `address` is shown in messages; `reader` reads the frames; `fps` is the claimed rate [1/s].
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
        """The first whole frame: a connection made within a frame begins with a part of it."""
        deadline_s = time.monotonic() + self._reader.patience_s
        while True:
            try:
                return self._reader.read()
            except GarbageError:
                if time.monotonic() > deadline_s:
                    raise

    @property
    def duplicates(self) -> int:
        """Frames that showed an exposure again and were skipped so far."""
        return self._reader.duplicates

    @property
    def dropped(self) -> int:
        """Frames that came while nobody asked, those before the first one read included."""
        return self._reader.dropped + self._skipped_first

    @property
    def stamped_by(self) -> str:
        """Where the last frame's time is from, see `vision.sources.live.Feed`."""
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
        """Close the source and open it again, see `LiveReader.reconnect`; it raises the error of
        the last attempt."""
        self._reader.reconnect(timeout_s)
