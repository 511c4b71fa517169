"""A live stream read by its own thread: the newest frame wins.

A reader slower than the camera would otherwise end seconds behind, on frames queued in the driver.
"""

from __future__ import annotations

import threading
import time
from typing import Protocol

import numpy as np


class Capture(Protocol):
    """What is used of `cv2.VideoCapture`."""

    def read(self) -> tuple[bool, np.ndarray]: ...
    def release(self) -> None: ...


class LiveReader:
    """Keeps the newest frame of a capture and the moment it arrived (monotonic, from start)."""

    def __init__(self, capture: Capture, *, patience_s: float = 5.0) -> None:
        self._capture = capture
        self._patience_s = patience_s
        self._news = threading.Condition()
        self._newest: tuple[np.ndarray, float] | None = None
        self._ended = False
        self._start_s = time.monotonic()
        self._thread = threading.Thread(target=self._pump, daemon=True)
        self._thread.start()

    def _pump(self) -> None:
        while not self._ended:
            ok, image = self._capture.read()
            with self._news:
                if ok:
                    self._newest = (image, time.monotonic() - self._start_s)
                else:
                    self._ended = True
                self._news.notify()

    def read(self) -> tuple[np.ndarray, float] | None:
        """The newest frame not read before, waiting for it; None after the stream's end.

        Raises `OSError` when nothing came for `patience_s`.
        """
        with self._news:
            arrived = self._news.wait_for(
                lambda: self._newest is not None or self._ended, self._patience_s
            )
            newest, self._newest = self._newest, None
        if not arrived:
            raise OSError(f"no frame for {self._patience_s:g} s; is the camera still connected?")
        return newest

    def close(self) -> None:
        """Stop reading and free the camera."""
        self._ended = True
        self._thread.join(timeout=2.0)
        self._capture.release()
