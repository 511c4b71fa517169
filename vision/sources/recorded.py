"""Frames that are kept: a video file or a folder of images, every one in its order."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from vision.camera_device import capture
from vision.repeats import has_repeats

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"})
DEFAULT_FPS = 30.0

Reader = Callable[[], tuple[np.ndarray, float] | None]


@dataclass(frozen=True)
class Recorded:
    """How to read something kept: `read` gives (image, container's stamp in s) or None at the end.

    `fps` is the claimed rate, `frames_total` the claimed count (None where unknown), `repeats`
    whether it is known to hold repeats.
    """

    read: Reader
    close: Callable[[], None]
    fps: float
    frames_total: int | None
    repeats: bool | None


def open_file(path: str | Path) -> Recorded:
    """Open a video file, or one that a server holds. `ValueError` where it cannot be decoded."""
    device = capture(str(path))
    if not device.isOpened():
        raise ValueError(f"{path}: not a video that can be decoded (truncated, or no video at all)")
    claimed = device.get(cv2.CAP_PROP_FPS)
    fps = claimed if math.isfinite(claimed) and 0.1 < claimed < 1e5 else DEFAULT_FPS
    count = device.get(cv2.CAP_PROP_FRAME_COUNT)

    def read() -> tuple[np.ndarray, float] | None:
        ok, image = device.read()
        return (image, device.get(cv2.CAP_PROP_POS_MSEC) / 1e3) if ok else None

    total = int(count) if count > 0 else None
    return Recorded(read, device.release, fps, total, has_repeats(_images(path)))


def _images(path: str | Path) -> Iterator[np.ndarray]:
    """The images of a video file, read on their own."""
    device = capture(str(path))
    try:
        while (got := device.read())[0]:
            yield got[1]
    finally:
        device.release()


def open_folder(path: Path, fps: float) -> Recorded:
    """The images of a folder in natural order, at `fps`. `ValueError` where there are none."""
    files = [f for f in path.iterdir() if f.suffix.lower() in IMAGE_SUFFIXES]
    if not files:
        looked_for = ", ".join(sorted(IMAGE_SUFFIXES))
        raise ValueError(f"{path}: no images in this folder (looked for {looked_for})")
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
    return Recorded(read, lambda: None, fps, len(files), has_repeats(pictures))
