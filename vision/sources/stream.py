"""How are streams read that OpenCV decodes: rtsp, udp, and what HTTP serves besides MJPEG?

OpenCV assumes their time stamps (25 fps for a 60 fps stream), so frames are dated on arrival.
"""

from __future__ import annotations

import time

import cv2
import numpy as np

from vision.sources.addresses import without_password
from vision.sources.camera_device import capture
from vision.sources.live import Feed
from vision.sources.source_errors import GoneError


class StreamFeed(Feed):
    """A stream read through OpenCV.

    `address`: rtsp://, udp:// or http://; `timeout_s`: to connect, and of every read. `fps` is the
    rate that it claims [1/s], `is_file` whether it has an end: a file on a server.
    """

    def __init__(self, address: str, *, timeout_s: float) -> None:
        """Connect. Raises `GoneError` where nothing answers within `timeout_s`."""
        limit_ms = round(1e3 * timeout_s)
        limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, limit_ms]
        limits += [cv2.CAP_PROP_READ_TIMEOUT_MSEC, limit_ms]
        self._address = without_password(address)
        self._device = capture(address, cv2.CAP_FFMPEG, limits)
        if not self._device.isOpened():
            self._device.release()
            raise GoneError(
                f"{self._address}: the stream does not answer; check address and camera"
            )
        self.fps = self._device.get(cv2.CAP_PROP_FPS)
        self.is_file = self._device.get(cv2.CAP_PROP_FRAME_COUNT) > 0

    def read(self) -> tuple[np.ndarray, float]:
        """The next image (h, w, 3) uint8 and when it arrived [s, `time.monotonic`].

        `GoneError`: the stream ends or broke off.
        """
        ok, image = self._device.read()
        if not ok:
            raise GoneError(f"{self._address}: the stream ended or broke off; is it still sent?")
        return image, time.monotonic()

    def close(self) -> None:
        """End the connection."""
        self._device.release()
