"""Where frames come from: a video file, a folder of images, a stream or a camera.

Repeats that a container shows between two exposures are skipped and counted, see `vision.repeats`.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType

import cv2
import numpy as np

from vision.frames import Frame
from vision.live import LiveReader
from vision.repeats import RepeatFilter, has_repeats

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"})
DEFAULT_FPS = 30.0

Reader = Callable[[], tuple[np.ndarray, float] | None]


class Source:
    """Iterator of `Frame` and context manager over any address; see `open_source`.

    `size` is (w, h) px, `duplicates` the repeats skipped so far, `nominal_fps` what the container
    claims, `frames_total` how many frames it claims (None where it does not say), `missing` how
    many of these could not be decoded (known after the last frame), `live` whether it can be read
    only once.
    """

    def __init__(
        self,
        address: str,
        read: Reader,
        close: Callable[[], None],
        *,
        fps: float,
        frames_total: int | None,
        live: bool = False,
        repeats: bool | None = None,
    ) -> None:
        self.address = address
        self.live = live
        self.nominal_fps = fps
        self.frames_total = frames_total
        self.duplicates = 0
        self.missing = 0
        self._read, self._close = read, close
        self._filter = RepeatFilter(repeats=repeats)
        self._index = 0
        self._last_t_s = -math.inf
        first = read()
        if first is None:
            close()
            raise ValueError(f"{address}: no frame could be decoded; is the file complete?")
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

    def __iter__(self) -> Iterator[Frame]:
        while (got := self._next()) is not None:
            image, stamp_s = got
            index, t_s = self._index, self._sane_time(stamp_s)
            self._index += 1
            if self._filter.is_repeat(image):
                self.duplicates += 1
            else:
                yield Frame(image, t_s, index)
        self._count_missing()

    def _next(self) -> tuple[np.ndarray, float] | None:
        first, self._first = self._first, None
        return first if first is not None else self._read()

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


def open_source(address: str | Path | int, *, fps: float | None = None) -> Source:
    """Open a video file, a folder of images, a stream (rtsp, http, udp) or a camera index.

    `fps` is the rate of a folder (images carry no time; 30 where not given). Time stamps of files
    are the container's, of streams and cameras the arrival's. Raises `FileNotFoundError` where
    nothing is, `ValueError` where nothing can be decoded, `OSError` where a stream refuses.
    """
    text = str(address)
    if text.isdigit() or re.match(r"^(rtsps?|https?|udp|tcp|rtmp)://", text):
        return _open_live(text)
    path = Path(text)
    if path.is_dir():
        return _open_folder(path, fps or DEFAULT_FPS)
    if not path.exists():
        raise FileNotFoundError(f"{text}: no such file or folder; check the address")
    if path.stat().st_size == 0:
        raise ValueError(f"{text}: the file is empty (0 bytes)")
    return _open_file(path)


def _capture(target: str | int) -> cv2.VideoCapture:
    # The libraries beneath would print several lines of their own about a broken file.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    return cv2.VideoCapture(target)


def _open_file(path: Path) -> Source:
    capture = _capture(str(path))
    if not capture.isOpened():
        raise ValueError(f"{path}: not a video that can be decoded (truncated, or no video at all)")
    claimed = capture.get(cv2.CAP_PROP_FPS)
    fps = claimed if math.isfinite(claimed) and 0.1 < claimed < 1e5 else DEFAULT_FPS
    count = capture.get(cv2.CAP_PROP_FRAME_COUNT)

    def read() -> tuple[np.ndarray, float] | None:
        ok, image = capture.read()
        return (image, capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3) if ok else None

    return Source(
        str(path),
        read,
        capture.release,
        fps=fps,
        frames_total=int(count) if count > 0 else None,
        repeats=has_repeats(_images(path)),
    )


def _images(path: Path) -> Iterator[np.ndarray]:
    """The images of a video file, read on their own."""
    capture = _capture(str(path))
    try:
        while (got := capture.read())[0]:
            yield got[1]
    finally:
        capture.release()


def _open_folder(path: Path, fps: float) -> Source:
    files = [f for f in path.iterdir() if f.suffix.lower() in IMAGE_SUFFIXES]
    if not files:
        raise ValueError(f"{path}: no images in this folder (looked for {_suffixes()})")
    # "frame10" comes after "frame9".
    files.sort(key=lambda f: [int(p) if p.isdigit() else p for p in re.split(r"(\d+)", f.name)])
    numbered = iter(enumerate(files))

    def read() -> tuple[np.ndarray, float] | None:
        for i, file in numbered:
            image = cv2.imread(str(file), cv2.IMREAD_COLOR)
            if image is None:
                raise ValueError(f"{file}: not an image that can be decoded; remove or replace it")
            return image, i / fps
        return None

    pictures = (image for f in files if (image := cv2.imread(str(f))) is not None)
    return Source(
        str(path),
        read,
        lambda: None,
        fps=fps,
        frames_total=len(files),
        repeats=has_repeats(pictures),
    )


def _suffixes() -> str:
    return ", ".join(sorted(IMAGE_SUFFIXES))


def _open_live(text: str) -> Source:
    capture = _capture(int(text) if text.isdigit() else text)
    if not capture.isOpened():
        raise OSError(f"{text}: the camera or stream does not answer; check address and cable")
    claimed = capture.get(cv2.CAP_PROP_FPS)
    fps = claimed if math.isfinite(claimed) and 0.1 < claimed < 1e4 else DEFAULT_FPS
    reader = LiveReader(capture)
    return Source(text, reader.read, reader.close, fps=fps, frames_total=None, live=True)
