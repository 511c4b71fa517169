"""Where frames come from: a video file, a folder of images, a stream or a camera.

Repeats that a container shows between two exposures are skipped and counted, see `vision.repeats`.
A live source is read by its own thread (`vision.live`); its troubles are `vision.source_errors`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

from vision.camera_device import DEVICE, CameraSettings, open_camera
from vision.frame_source import LiveSource, RecordedSource, Source
from vision.live import PATIENCE_S, Feed, LiveReader
from vision.mjpeg_http import HttpFeed, NotMultipartError, without_password
from vision.recorded import DEFAULT_FPS, open_file, open_folder
from vision.source_errors import GoneError
from vision.stream import StreamFeed
from vision.user_camera import UserFeed, load_class, split_address

__all__ = ["CameraSettings", "Source", "open_source"]

STREAM = re.compile(r"^(rtsps?|https?|udp|tcp|rtmp)://")


def open_source(
    address: str | Path | int,
    *,
    fps: float | None = None,
    settings: CameraSettings | None = None,
    start_s: float | None = None,
    patience_s: float = PATIENCE_S,
) -> Source:
    """Open any address: a video file, a folder of images, a stream (http, rtsp, udp), a camera by
    index or device path (/dev/video0), a camera class in a user's file ("mine.py:MyCamera").

    `fps` is the rate of a folder (images carry no time; 30 where not given), `settings` what a
    camera is set to. Times of files are the container's. Those of live sources count from `start_s`
    on `time.monotonic` (from the opening where not given) and are the middle of the exposure where
    it is known, else the driver's or server's stamp, else the arrival; a live source raises
    `StalledError` when nothing new came for `patience_s`. Raises `FileNotFoundError` where nothing
    is, `ValueError` where nothing can be decoded, a `SourceError` for troubles of a live source.
    """
    text = str(address)
    user = split_address(text)
    if settings is not None and not DEVICE.match(text):
        raise ValueError(f"{text}: only a camera by index or device path takes settings")
    if user is not None:
        file, name = user
        make = load_class(file, name)
        return _live(text, lambda: UserFeed(file, name, make), patience_s, start_s)
    if DEVICE.match(text):
        return _live(text, lambda: open_camera(text, settings), patience_s, start_s)
    if STREAM.match(text):
        return _open_stream(text, patience_s, start_s)
    path = Path(text)
    if path.suffix == ".py":
        raise ValueError(f"{text}: which camera class in that file? write {text}:MyCamera")
    if path.is_dir():
        return RecordedSource(text, open_folder(path, fps or DEFAULT_FPS))
    if not path.exists():
        raise FileNotFoundError(f"{text}: no such file or folder; check the address")
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
    """What HTTP serves besides MJPEG: a file or a playlist, perhaps."""
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
