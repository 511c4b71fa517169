"""How are a video file and a folder of images read, every frame in its order?"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from statistics import mode

import cv2
import numpy as np

from vision.sources.camera_device import capture
from vision.sources.encoded_image import TooLargeError, check_size, decoded
from vision.sources.repeats import has_repeats

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"})
DEFAULT_FPS = 30.0
# How files begin that the decoder follows to other files, pipes and addresses: lists of ffconcat
# and of HLS, an index of VobSub; it looks for that behind a tag of ID3, too, which no film has.
# Somewhere in what it looks at (PROBED bytes) a line of SDP is enough.
LISTS, SDP_LINE, PROBED = (b"ffconcat", b"#EXTM3U", b"# VobSub", b"ID3"), b"c=IN IP", 1 << 20

Reader = Callable[[], tuple[np.ndarray, float] | None]


@dataclass(frozen=True)
class RecordedFrames:
    """How to read a recording: `read` gives (image (h, w, 3) uint8, container's stamp [s]), None at
    the end; `close` frees it.

    `fps` is the claimed rate, `frames_total` the claimed count (None where unknown), `repeats`
    whether it is known to hold repeats (None: not known).
    """

    read: Reader
    close: Callable[[], None]
    fps: float
    frames_total: int | None
    repeats: bool | None


def open_file(path: str | Path) -> RecordedFrames:
    """Open the video file `path`, or the address of one. `ValueError`: it cannot be decoded, is a
    list of others, or its frames are too large.
    """
    _refuse_list(Path(path))
    device = capture(str(path))
    if not device.isOpened():
        raise ValueError(f"{path}: not a video that can be decoded (truncated, or no video at all)")
    try:
        check_size(device.get(cv2.CAP_PROP_FRAME_WIDTH), device.get(cv2.CAP_PROP_FRAME_HEIGHT))
    except TooLargeError as error:
        device.release()
        raise TooLargeError(f"{path}: {error}") from None
    claimed = device.get(cv2.CAP_PROP_FPS)
    fps = claimed if math.isfinite(claimed) and 0.1 < claimed < 1e5 else DEFAULT_FPS
    count = device.get(cv2.CAP_PROP_FRAME_COUNT)

    def read() -> tuple[np.ndarray, float] | None:
        ok, image = device.read()
        return (image, device.get(cv2.CAP_PROP_POS_MSEC) / 1e3) if ok else None

    total = int(count) if count > 0 else None
    return RecordedFrames(read, device.release, fps, total, _holds_repeats(path))


def _refuse_list(path: Path) -> None:
    """ValueError: the decoder would go on from this file to others. An address is not looked at."""
    if not path.is_file():
        return
    with path.open("rb") as file:
        begin = file.read(PROBED)
    if begin.startswith(LISTS) or SDP_LINE in begin:
        raise ValueError(f"{path}: a list of other files or addresses, no video: give the video")


def _holds_repeats(path: str | Path) -> bool | None:
    """`has_repeats` of a video file; looked at once, however often an unchanged file is opened."""
    file = Path(path)
    if not file.is_file():  # an address
        return has_repeats(_images(path))
    state = file.stat()
    return _looked_at(file, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=16)
def _looked_at(path: Path, _changed_ns: int, _bytes: int) -> bool | None:
    return has_repeats(_images(path))


def _images(path: str | Path) -> Iterator[np.ndarray]:
    """The images of a video file, read on their own."""
    device = capture(str(path))
    try:
        while (got := device.read())[0]:
            yield got[1]
    finally:
        device.release()


def open_folder(path: Path, fps: float) -> RecordedFrames:
    """The images of a folder in natural order, dated at `fps`; a frame that is missing in their
    numbering leaves a hole in time.

    `ValueError`: the folder has no images; `read` raises it for one that cannot be decoded.
    """
    files = [f for f in path.iterdir() if f.suffix.lower() in IMAGE_SUFFIXES]
    if not files:
        looked_for = ", ".join(sorted(IMAGE_SUFFIXES))
        raise ValueError(f"{path}: no images in this folder (looked for {looked_for})")
    # "frame10" comes after "frame9".
    files.sort(key=lambda f: [int(p) if p.isdigit() else p for p in re.split(r"(\d+)", f.name)])
    dated = iter(zip(frame_numbers([f.stem for f in files]), files, strict=True))

    def read() -> tuple[np.ndarray, float] | None:
        for number, file in dated:
            return _picture(file), number / fps
        return None

    def pictures() -> Iterator[np.ndarray]:
        for file in files:
            with suppress(ValueError):
                yield _picture(file)

    return RecordedFrames(read, lambda: None, fps, len(files), has_repeats(pictures()))


def frame_numbers(names: Sequence[str]) -> list[int]:
    """The frame of each of some sorted names, from 0: the one number in which they differ, in units
    of its usual step. Their order, where they differ otherwise or a step is no multiple of the
    usual one, as of times in milliseconds.
    """
    parts = [re.split(r"(\d+)", name) for name in names]
    order = list(range(len(names)))
    if len({tuple(part[::2]) for part in parts}) > 1:
        return order
    columns = [[int(n) for n in column] for column in zip(*(p[1::2] for p in parts), strict=True)]
    differing = [column for column in columns if column[0] != column[-1]]
    if len(differing) != 1:
        return order
    numbers = differing[0]
    steps = [b - a for a, b in pairwise(numbers)]
    usual = mode(steps)
    if usual < 1 or 2 * steps.count(usual) < len(steps) or any(s < 1 or s % usual for s in steps):
        return order
    return [(n - numbers[0]) // usual for n in numbers]


def _picture(file: Path) -> np.ndarray:
    """A picture (h, w, 3) uint8, BGR. ValueError (one line): no file, or as of `decoded`."""
    if not file.is_file():
        raise ValueError(f"{file}: no file, but a folder, a pipe or a device; remove it")
    try:
        return decoded(file.read_bytes())
    except (OSError, ValueError) as error:
        raise ValueError(f"{file}: {error}") from None
