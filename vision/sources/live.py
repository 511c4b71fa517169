"""How is a live source read without falling behind? By a thread of its own; the newest frame wins.

A reader slower than the camera would otherwise fall seconds behind, on frames queued in the driver.
The thread only takes frames in; they are decoded in the consumer's thread, so that it keeps up with
any camera and a dropped frame costs next to nothing.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from vision.sources.source_errors import GarbageError, SizeChangedError, SourceError, StalledError

PATIENCE_S = 5.0  # without a new frame, until a source counts as stalled
RETRY_S = 0.1  # between attempts to connect
JOIN_S = 0.5  # that a thread is given to end


class Feed(Protocol):
    """One connection to a camera. `read` and `close` are called by the capture thread only.

    `duplicates`: repeats of an exposure that it left out; `stamped_by`: where its times are from,
    as `Source.stamped_by`.
    """

    duplicates: int = 0
    stamped_by: str = "arrival"

    def read(self) -> tuple[Any, float] | None:
        """Wait for the next frame: what `decode` takes, and its time [s, `time.monotonic`]; None at
        the regular end.

        `GarbageError`: data that are no frame; `read` may be called again. Any other error: the
        connection is of no more use.
        """
        ...

    def decode(self, raw: Any) -> np.ndarray:
        """The image (h, w, 3) uint8 BGR of what `read` gave, by default just that; called by the
        consumer. `GarbageError`: it is no image."""
        return raw

    def interrupt(self) -> None:
        """Make a waiting `read` return soon where that can be done; from any thread."""

    def close(self) -> None:
        """Free what `read` used."""
        ...


class CaptureThread:
    """Thread that reads a feed into a slot for one frame; `overwritten` counts frames not taken,
    `finished` tells that the feed came to its regular end, `began_s` when it began."""

    def __init__(self, feed: Feed) -> None:
        self.feed = feed
        self.overwritten = 0
        self.ended = self.finished = False
        self.began_s = time.monotonic()
        self._news = threading.Condition()
        self._slot: tuple[Any, float] | None = None
        self._garbage: Exception | None = None
        self._end: Exception | None = None
        self._stopping = False
        self.thread = threading.Thread(target=self._run, daemon=True, name="capture")
        self.thread.start()

    def _run(self) -> None:
        # The thread closes what it reads: a driver must not be freed under a waiting read.
        try:
            while not self._stopping and self._step():
                pass
        except Exception as error:  # raised again where somebody reads
            self._end = error
        try:
            self.feed.close()
        except Exception as error:
            self._end = self._end or error
        with self._news:
            self.ended = True
            self._news.notify_all()

    def _step(self) -> bool:
        try:
            got = self.feed.read()
        except GarbageError as error:
            with self._news:
                self._garbage = error
                self._news.notify_all()
            return True
        if got is None:
            self.finished = not self._stopping
            return False
        with self._news:
            self.overwritten += self._slot is not None
            self._slot = got
            self._news.notify_all()
        return True

    def take(self, patience_s: float) -> tuple[Any, float] | None:
        """The newest frame not taken before and its time [s, `time.monotonic`], waiting for it;
        None after the regular end.

        Raises what the feed raised, once where that was in closing a finished one;
        `StalledError`: nothing came for `patience_s`.
        """
        with self._news:
            if not self._news.wait_for(self._has_news, patience_s):
                raise StalledError(
                    f"no new frame for {patience_s:g} s; has the camera frozen or lost its cable?"
                )
            if self._garbage is not None:
                garbage, self._garbage = self._garbage, None
                raise garbage
            got, self._slot = self._slot, None
        if got is None and (end := self._end) is not None:
            self._end = None if self.finished else end
            raise end
        return got

    def _has_news(self) -> bool:
        return self._slot is not None or self._garbage is not None or self.ended

    def waits(self) -> bool:
        """Whether there is something to take without waiting."""
        with self._news:
            return self._slot is not None

    def stop(self) -> None:
        """End the thread, waiting for it at most `JOIN_S`; one that waits in a driver ends when the
        driver returns."""
        self._stopping = True
        self.feed.interrupt()
        self.thread.join(JOIN_S)


class LiveReader:
    """Reads the newest frame of what `connect` connects to, and connects again after a failure.

    `connect` returns a new connection or raises; `address` names the source in messages;
    `patience_s`: how long a `read` waits. `start_s` is the zero of the frames' times on
    `time.monotonic` (now where not given), `reconnects` counts new connections.
    """

    def __init__(
        self,
        connect: Callable[[], Feed],
        address: str = "camera",
        *,
        patience_s: float = PATIENCE_S,
        start_s: float | None = None,
    ) -> None:
        self._connect, self._address = connect, address
        self.patience_s = patience_s
        self.start_s = time.monotonic() if start_s is None else start_s
        self.reconnects = 0
        self._size: tuple[int, int] | None = None
        self._last_s = -math.inf
        self._dropped = self._duplicates = 0  # of former connections
        self._down = False
        self._capture = CaptureThread(connect())

    @property
    def dropped(self) -> int:
        """Frames that came while nobody asked, or were not newer than the last one."""
        return self._dropped + self._capture.overwritten

    @property
    def duplicates(self) -> int:
        """Frames that showed an exposure again."""
        return self._duplicates + self._capture.feed.duplicates

    @property
    def stamped_by(self) -> str:
        """Where the last frame's time is from, see `Feed`."""
        return self._capture.feed.stamped_by

    def read(self) -> tuple[np.ndarray, float] | None:
        """The newest frame not read before, (h, w, 3) uint8 BGR, and its time [s from `start_s`];
        None after the end. Waits for it, at most `patience_s`.

        `SourceError`: nothing came (`StalledError`), it is damaged (`GarbageError`), has another
        size, or the connection broke; the next call reconnects where that is needed, for at most
        `patience_s`.
        """
        if self._down and not self._capture.waits():
            self.reconnect()
        self._down = False
        try:
            while (got := self._capture.take(self.patience_s)) is not None:
                raw, taken_s = got
                if taken_s > self._last_s:
                    break
                self._dropped += 1  # not newer than what was given already
            else:
                return None
            image = self._capture.feed.decode(raw)
        except GarbageError as error:  # the connection may be sound
            raise GarbageError(f"{self._address}: {error}") from error
        except StalledError as error:
            self._down = True
            raise StalledError(f"{self._address}: {error}") from error
        except Exception:
            self._down = not self._capture.finished  # what has ended is not read anew
            raise
        self._check_size(image)
        self._last_s = taken_s
        return image, taken_s - self.start_s

    def _check_size(self, image: np.ndarray) -> None:
        size = (image.shape[1], image.shape[0])
        self._size = self._size or size
        if size != self._size:
            raise SizeChangedError(
                f"{self._address}: the frames are {size[0]}x{size[1]} now and were "
                f"{self._size[0]}x{self._size[1]}; set the camera back or open it anew"
            )

    def newer(self) -> bool:
        """Whether a newer frame waits to be read."""
        return self._capture.waits()

    def reconnect(self, timeout_s: float | None = None) -> None:
        """Close the connection and open it again, trying for `timeout_s` (`patience_s` where not
        given), no sooner than `RETRY_S` after it was made.

        `SourceError` or `OSError`: that of the last attempt.
        """
        deadline_s = time.monotonic() + (self.patience_s if timeout_s is None else timeout_s)
        self._capture.stop()
        self._down = True
        time.sleep(max(0.0, self._capture.began_s + RETRY_S - time.monotonic()))
        while True:
            try:
                pump = CaptureThread(self._connect())
                break
            except (SourceError, OSError):
                if time.monotonic() + RETRY_S > deadline_s:
                    raise
            time.sleep(RETRY_S)
        self._dropped, self._duplicates = self.dropped, self.duplicates
        self._capture, self._down = pump, False
        self.reconnects += 1

    def close(self) -> None:
        """Stop reading and free the camera."""
        self._capture.stop()
