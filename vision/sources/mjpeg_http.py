"""How is MJPEG over HTTP read? Each frame when its last byte came, at the time its server says.

Read here rather than by a general video library, which hides a part's headers (the server's time
stamps) and dates frames by a rate that it assumes.
"""

from __future__ import annotations

import base64
import contextlib
import http.client
import math
import socket
import time
from collections import deque
from urllib.parse import unquote, urljoin, urlsplit

import numpy as np

from vision.sources.addresses import without_password
from vision.sources.clock import ForeignClock, own_clock, wall_minus_monotonic
from vision.sources.encoded_image import decoded
from vision.sources.live import Feed
from vision.sources.multipart import Multipart, Part, boundary_of
from vision.sources.source_errors import GarbageError, GoneError, SourceError

CHUNK = 1 << 20  # bytes read at a time at most
REDIRECTS = 5
# Headers with the moment of the exposure come first; the others say when the frame was sent.
STAMP_HEADERS = (
    "x-ustreamer-grab-begin-time",
    "x-ustreamer-grab-time",
    "x-ustreamer-grab-timestamp",
    "x-timestamp",
    "x-time",
    "timestamp",
)


class NotMultipartError(SourceError, ValueError):
    """The address answers with something other than a multipart stream."""


def server_stamp(headers: dict[str, str]) -> float | None:
    """The server's time stamp [s of its clock] among a part's headers (lower-case name -> value);
    None where there is none.

    Stamps in milli-, micro- or nanoseconds since 1970 are recognised by their size.
    """
    for name in STAMP_HEADERS:
        try:
            stamp = float(headers[name])
        except (KeyError, ValueError):
            continue
        if math.isfinite(stamp) and stamp > 0.0:
            unit = next((u for u in (1e9, 1e6, 1e3) if stamp > 1e8 * u), 1.0)
            return stamp / unit
    return None


class PartClock:
    """Dates parts on `time.monotonic`: by the server's stamp where there is one, else on arrival.

    A server on this machine (`same_machine`) stamps with our own clocks; any other has its own,
    see `ForeignClock`.
    """

    def __init__(self, *, same_machine: bool) -> None:
        self._same_machine = same_machine
        self._foreign = ForeignClock()
        self._last_s = -math.inf

    def date(self, stamp_s: float | None, arrived_s: float, wall_minus_monotonic_s: float) -> float:
        """The part's time [s] on `time.monotonic`, not after its arrival where it has a stamp
        (`stamp_s` None: it has none)."""
        if stamp_s is None:
            # Parts of one chunk arrive together and are still one after the other.
            taken_s = max(arrived_s, self._last_s + 1e-6)
        else:
            own_s = None
            if self._same_machine:
                own_s = own_clock(stamp_s, arrived_s, wall_minus_monotonic_s)
            taken_s = self._foreign.to_rig(stamp_s, arrived_s) if own_s is None else own_s
        self._last_s = taken_s
        return taken_s


class HttpFeed(Feed):
    """One connection to an MJPEG server.

    `address`: http:// or https://, with user:password@ where the server asks for it; `timeout_s`:
    to connect and be answered.
    """

    def __init__(self, address: str, *, timeout_s: float) -> None:
        """Connect. Raises `GoneError` where nobody answers, `NotMultipartError` for other data."""
        self._address = without_password(address)
        connection, self._socket, self._response = _get(address, timeout_s)
        self._close_connection = connection.close
        try:
            self._multipart = Multipart(boundary_of(_multipart_type(self._response)))
        except ValueError as error:
            self.close()
            raise NotMultipartError(f"{self._address}: {error}") from error
        self._clock = PartClock(same_machine=_same_machine(self._socket))
        self._socket.settimeout(None)  # patience is the consumer's; `interrupt` ends a wait
        self._parts: deque[Part] = deque()
        self._last: tuple[bytes, float | None] = (b"", None)

    def read(self) -> tuple[bytes, float] | None:
        """The next image's bytes and time [s, `time.monotonic`]; None at the regular end.

        `GarbageError`: a broken part; later ones may be sound. `GoneError`: the connection broke
        off.
        """
        while True:
            while not self._parts:
                if self._multipart.closed:
                    return None
                self._parts.extend(self._multipart.feed(self._receive()))
            part = self._parts.popleft()
            if part.fault:
                raise GarbageError(part.fault)
            stamp_s = server_stamp(part.headers)
            same, self._last = self._last == (part.body, stamp_s), (part.body, stamp_s)
            if same:
                self.duplicates += 1
                continue
            self.stamped_by = "arrival" if stamp_s is None else "server"
            return part.body, self._clock.date(stamp_s, time.monotonic(), wall_minus_monotonic())

    def _receive(self) -> bytes:
        try:
            # All that has arrived, so that a late reader catches up at once.
            data = self._response.read1(CHUNK)
        except (OSError, ValueError, http.client.HTTPException) as error:
            raise GoneError(f"{self._address}: the connection broke off ({error})") from error
        if not data:
            raise GoneError(f"{self._address}: the server closed the connection; is it still up?")
        return data

    def decode(self, raw: bytes) -> np.ndarray:
        """The image (h, w, 3) uint8 BGR of a part's bytes. `GarbageError`: they are no image."""
        try:
            return decoded(raw)
        except ValueError as error:
            raise GarbageError(f"a frame of {len(raw)} bytes: {error}") from None

    def interrupt(self) -> None:
        """End a waiting `read`; it then raises `GoneError`."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """End the connection."""
        self._response.close()
        self._close_connection()
        self._socket.close()


def _multipart_type(response: http.client.HTTPResponse) -> str:
    kind = response.headers.get("Content-Type", "")
    if not kind.lower().startswith("multipart/"):
        raise ValueError(f"not an MJPEG stream but {kind or 'something without a type'}")
    return kind


def _same_machine(connected: socket.socket) -> bool:
    return connected.getpeername()[0] == connected.getsockname()[0]


def _get(
    address: str, timeout_s: float
) -> tuple[http.client.HTTPConnection, socket.socket, http.client.HTTPResponse]:
    """GET with redirects. Raises `GoneError` for everything but a 200."""
    shown = without_password(address)
    for _ in range(REDIRECTS):
        try:
            connection, connected, response = _request(address, timeout_s)
        except (OSError, ValueError, http.client.HTTPException) as error:
            reason = "no answer in time" if isinstance(error, TimeoutError) else error
            raise GoneError(
                f"{shown}: the stream does not answer ({reason}); check address and camera"
            ) from error
        if response.status == 200:
            return connection, connected, response
        location = response.headers.get("Location")
        response.close()
        connection.close()
        if location is None or response.status not in (301, 302, 303, 307, 308):
            cure = "put user:password@ before the host" if response.status == 401 else "check it"
            raise GoneError(
                f"{shown}: the server answers {response.status} {response.reason}; {cure}"
            )
        address = urljoin(address, location)
    raise GoneError(f"{shown}: more than {REDIRECTS} redirects; check the address")


def _request(
    address: str, timeout_s: float
) -> tuple[http.client.HTTPConnection, socket.socket, http.client.HTTPResponse]:
    url = urlsplit(address)
    secure = url.scheme == "https"
    kind = http.client.HTTPSConnection if secure else http.client.HTTPConnection
    connection = kind(url.hostname or "", url.port, timeout=timeout_s)
    headers = {"Accept": "multipart/x-mixed-replace, image/jpeg, */*", "Connection": "close"}
    if url.username is not None:
        login = f"{unquote(url.username)}:{unquote(url.password or '')}"
        headers["Authorization"] = "Basic " + base64.b64encode(login.encode()).decode("ascii")
    path = (url.path or "/") + (f"?{url.query}" if url.query else "")
    try:
        connection.request("GET", path, headers=headers)
        connected = connection.sock
        return connection, connected, connection.getresponse()
    except BaseException:
        connection.close()
        raise
