"""How long may a camera class take to open? In a thread of its own, which may never return."""

from __future__ import annotations

import threading
from collections.abc import Callable

from vision.sources.live import Feed
from vision.sources.source_errors import UserCameraError

OPEN_S = 30.0  # chosen: makers' libraries take some seconds to find and start a camera


def open_within(connect: Callable[[], Feed], address: str, patience_s: float) -> Feed:
    """What `connect` returns, called in a thread of its own.

    A feed that comes later than `patience_s` is closed, as nobody waits for it any more.
    `UserCameraError`: it does not return within `patience_s`; whatever `connect` raises.
    """
    opening = _Opening(connect)
    opening.thread.join(patience_s)
    return opening.taken(
        f"{address}: does not open within {patience_s:g} s; is its camera there and free, or does "
        "its file wait for something?"
    )


class _Opening:
    """A thread that opens a feed, for as long as somebody waits for it."""

    def __init__(self, connect: Callable[[], Feed]) -> None:
        self._connect = connect
        self._lock, self._given_up = threading.Lock(), False
        self._feed: Feed | None = None
        self._error: BaseException | None = None
        self.thread = threading.Thread(target=self._run, daemon=True, name="opening")
        self.thread.start()

    def _run(self) -> None:
        try:
            feed = self._connect()
        except BaseException as error:  # raised again where somebody waits
            self._error = error
            return
        with self._lock:
            self._feed, late = feed, self._given_up
        if late:
            feed.close()

    def taken(self, overdue: str) -> Feed:
        with self._lock:
            if self._error is not None:
                raise self._error
            if self._feed is None:
                self._given_up = True
                raise UserCameraError(overdue)
            return self._feed
