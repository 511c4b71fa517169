"""Where frames come from: a video file, a folder of images, a stream or a camera.

A container may claim more frames than the camera took (a 250 fps file of a 30 fps webcam). Such
repeats carry no new light but a later time stamp, which would turn a moving ball into a stuttering
one; they are skipped and counted.
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

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"})
# A new exposure differs from the last by 1.13 sigma of sensor noise on average (mean of
# |N(0, 2 sigma^2)|). A re-encoded repeat stays an order of magnitude below that.
REPEAT_SHARE = 0.08
# Mean difference of an 8x8 block that no codec refinement of the same picture reaches.
LOCAL_CHANGE = 8.0
DEFAULT_FPS = 30.0

Reader = Callable[[], tuple[np.ndarray, float] | None]


def noise_level(image: np.ndarray) -> float:
    """Standard deviation of the pixel noise of an image (h, w, 3) uint8, in grey levels.

    J. Immerkaer, "Fast noise variance estimation", CVIU 64 (1996): the mean response of a
    difference of two Laplacians, blind to constant, linear and quadratic shading.
    """
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
    response = cv2.filter2D(image[:, :, 1], cv2.CV_32F, kernel)
    return float(np.abs(response).mean()) * math.sqrt(math.pi / 2) / 6


class RepeatFilter:
    """Tells a repeat of the container from a new exposure, one frame after the other."""

    def __init__(self) -> None:
        self._last: np.ndarray | None = None
        self._kept: np.ndarray | None = None
        self._noise = 0.0

    def is_repeat(self, image: np.ndarray) -> bool:
        """True where the (h, w, 3) image shows the same exposure as its predecessor.

        The mean change is judged against the noise of the picture itself, so a clean still scene
        drops exact copies only; the largest local change since the last kept frame saves a small
        ball creeping over a large still plate.
        """
        last, kept = self._last, self._kept
        self._last = image
        if last is None or kept is None or last.shape != image.shape:
            self._kept, self._noise = image, noise_level(image)
            return False
        mean_change = float(np.mean(cv2.mean(cv2.absdiff(image, last))[:3]))
        if mean_change <= REPEAT_SHARE * self._noise:
            h, w = image.shape[:2]
            blocks = (max(1, w // 8), max(1, h // 8))
            change = cv2.resize(cv2.absdiff(image, kept), blocks, interpolation=cv2.INTER_AREA)
            if float(change.max()) <= LOCAL_CHANGE:
                return True
        self._kept = image
        self._noise += 0.05 * (noise_level(image) - self._noise)
        return False


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
    ) -> None:
        self.address = address
        self.live = live
        self.nominal_fps = fps
        self.frames_total = frames_total
        self.duplicates = 0
        self.missing = 0
        self._read, self._close = read, close
        self._filter = RepeatFilter()
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
        str(path), read, capture.release, fps=fps, frames_total=int(count) if count > 0 else None
    )


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

    return Source(str(path), read, lambda: None, fps=fps, frames_total=len(files))


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
