"""How is a camera of the operating system opened and read? V4L2, MSMF or DSHOW, as it is set."""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from vision.sources.clock import ForeignClock, own_clock, wall_minus_monotonic
from vision.sources.live import Feed
from vision.sources.source_errors import GarbageError, GoneError

DEVICE = re.compile(r"^(\d+|/dev/(video\d+|v4l/.+))$")


@dataclass(frozen=True)
class Backend:
    """One system's camera interface: OpenCV's number of it, `api`, and which clock dates its
    frames, `stamps`: "kernel", "stream" (with a zero of its own) or "none"."""

    api: int
    stamps: str


V4L2 = Backend(cv2.CAP_V4L2, "kernel")
MSMF = Backend(cv2.CAP_MSMF, "stream")
DSHOW = Backend(cv2.CAP_DSHOW, "none")
ANY = Backend(cv2.CAP_ANY, "none")


def backends(platform: str = sys.platform) -> tuple[Backend, ...]:
    """The camera interfaces to try on a system (`sys.platform`'s name), best first."""
    if platform.startswith("linux"):
        return (V4L2,)
    return (MSMF, DSHOW) if platform == "win32" else (ANY,)


def capture(
    target: str | int, api: int = cv2.CAP_ANY, params: list[int] | None = None
) -> cv2.VideoCapture:
    """OpenCV's capture of `target`, a file, address or camera index; its libraries are kept from
    printing.

    `api`: OpenCV's number of the interface; `params`: properties and their values in turn. The
    capture may have failed to open: ask `isOpened`.
    """
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    return cv2.VideoCapture(target, api, params or [])


class CameraFeed(Feed):
    """An open camera. `fps` is the rate that it claims [1/s].

    `address` names it in messages; `now` is the clock of arrivals [s]. `stamped_by` is "kernel"
    where the frames carry the driver's stamps, "stream" where these count from the stream's start,
    else "arrival".
    """

    def __init__(
        self,
        device: cv2.VideoCapture,
        backend: Backend,
        address: str,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self._device, self._backend, self._address, self._now = device, backend, address, now
        self._foreign = ForeignClock()
        self.fps = device.get(cv2.CAP_PROP_FPS)

    def read(self) -> tuple[np.ndarray, float]:
        """The next image (h, w, 3) and its time [s, `time.monotonic`]: its stamp's, or its arrival.

        `GoneError`: the camera fails or is unplugged.
        """
        try:
            ok, image = self._device.read()
        except cv2.error as error:
            raise GoneError(f"{self._address}: the camera failed ({error.err})") from error
        arrived_s = self._now()
        if not ok:
            raise GoneError(f"{self._address}: the camera gives no more frames; is it unplugged?")
        return image, self._date(self._device.get(cv2.CAP_PROP_POS_MSEC) / 1e3, arrived_s)

    def _date(self, stamp_s: float, arrived_s: float) -> float:
        self.stamped_by = "arrival"
        if not np.isfinite(stamp_s) or stamp_s <= 0.0:
            return arrived_s
        if self._backend.stamps == "kernel":
            taken_s = own_clock(stamp_s, arrived_s, wall_minus_monotonic())
        elif self._backend.stamps == "stream":
            taken_s = self._foreign.to_rig(stamp_s, arrived_s)
        else:
            taken_s = None
        if taken_s is None:
            return arrived_s
        self.stamped_by = self._backend.stamps
        return min(taken_s, arrived_s)

    def decode(self, raw: np.ndarray) -> np.ndarray:
        """The image (h, w, 3) uint8 BGR, as `read` gave it. `GarbageError`: it is no colour
        image.
        """
        if not isinstance(raw, np.ndarray) or raw.ndim != 3 or raw.size == 0:
            raise GarbageError("the camera gave something that is no colour image")
        return raw

    def close(self) -> None:
        """Free the camera."""
        self._device.release()


def open_camera(
    address: str,
    *,
    candidates: tuple[Backend, ...] | None = None,
    opener: Callable[[str | int, int], cv2.VideoCapture] = capture,
) -> CameraFeed:
    """Open the camera `address`, an index or device path, with the first of the `candidates`
    (default: `backends()`) that answers; `opener` makes the capture.

    `GoneError`: no camera there, or none answers.
    """
    target = int(address) if address.isdigit() else address
    if isinstance(target, str) and not Path(target).exists():
        raise GoneError(f"{address}: no such camera; {_present()}")
    if isinstance(target, str):  # names such as /dev/v4l/by-id/... lead to /dev/videoN
        target = str(Path(target).resolve())
    for backend in candidates or backends():
        device = opener(target, backend.api)
        if device.isOpened():
            return CameraFeed(device, backend, address)
        device.release()
    raise GoneError(
        f"{address}: the camera does not answer; is it plugged in and free? ({_present()})"
    )


def _present() -> str:
    found = sorted(str(p) for p in Path("/dev").glob("video*"))
    return "cameras here: " + (", ".join(found) if found else "none")
