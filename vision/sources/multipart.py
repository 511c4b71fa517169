"""How is a multipart/x-mixed-replace stream cut into its parts (RFC 2046, section 5.1)?

The chunks may be cut anywhere. What cameras send differs from the standard and is accepted: bare
newlines, boundaries declared with their dashes, no newline before a boundary, lengths missing or
wrong. A JPEG is complete with its own last byte (`JpegEnd`): the next frame need not begin first,
and a broken JPEG costs no later frame.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

MAX_HEAD = 16 * 1024  # bytes; chosen: ten times what camera servers send
MAX_BODY = 64 * 1024 * 1024  # bytes; chosen: an uncompressed 20 megapixel image
_BLANK_LINE = re.compile(rb"\n\r?\n")

START = b"\xff\xd8"  # of every JPEG
# In entropy-coded data 0xff is followed by a stuffed 0 or a restart marker, before a real marker
# by fill bytes 0xff at most.
_MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")
_SCAN, _END = 0xDA, 0xD9
_FRAMES = frozenset({*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC})


@dataclass(frozen=True)
class Part:
    """One part: `headers` by lower-case name, `body`, and `fault` in words where it is broken."""

    headers: dict[str, str]
    body: bytes
    fault: str = ""


def boundary_of(content_type: str) -> str:
    """The boundary that `content_type`, a Content-Type header, declares, without its dashes.
    `ValueError`: it declares none.
    """
    found = re.search(r'boundary\s*=\s*(?:"([^"]+)"|([^\s;,]+))', content_type, re.IGNORECASE)
    name = (found[1] or found[2]).lstrip("-") if found else ""
    if not name:
        raise ValueError(f"no boundary in Content-Type {content_type!r}")
    return name


class Multipart:
    """Parser of one multipart stream with this `boundary` (without its dashes); `closed` is True
    after the last boundary."""

    def __init__(self, boundary: str) -> None:
        name = boundary.lstrip("-").encode("latin-1")
        self._boundary = re.compile(
            rb"(?:\r?\n)?-{2,8}" + re.escape(name) + rb"(?:(--)|[ \t]{0,16}\r?\n)"
        )
        self._mark = b"--" + name
        self._longest = len(name) + 32  # of a boundary line
        self._data = bytearray()
        self._state = self._seek
        self._from = 0  # what lies before was searched already
        self._headers: dict[str, str] = {}
        self._jpeg = JpegEnd()
        self._parts: list[Part] = []
        self.closed = False

    def feed(self, chunk: bytes) -> list[Part]:
        """The parts that this chunk completes, in order; broken parts have a `fault`."""
        self._data += chunk
        while not self.closed and self._state():
            pass
        parts, self._parts = self._parts, []
        return parts

    # Each state returns whether it got further with what is there.

    def _seek(self) -> bool:
        """Between parts: skip whatever stands before the next boundary."""
        found = self._find_boundary(0)
        if found is None:
            del self._data[: -self._longest]
            return False
        self._enter_head(found)
        return True

    def _find_boundary(self, start: int) -> re.Match[bytes] | None:
        # A plain search first: the expression alone takes longer than decoding the image.
        at = self._data.find(self._mark, start)
        while at >= 0:
            first = max(start, at - 8)  # six more dashes and a newline may stand before
            found = self._boundary.search(self._data, first, at + self._longest)
            if found is not None:
                return found
            at = self._data.find(self._mark, at + 1)
        return None

    def _enter_head(self, found: re.Match[bytes]) -> None:
        self.closed = found[1] is not None
        del self._data[: found.end() - 1]  # its newline also ends an empty head
        self._state, self._from = self._head, 0

    def _head(self) -> bool:
        found = _BLANK_LINE.search(self._data, max(0, self._from - 2))
        self._from = len(self._data)
        if found is None or found.start() > MAX_HEAD:
            if len(self._data) <= MAX_HEAD:
                return False
            self._broken("a part's header does not end")
            return True
        lines = bytes(self._data[: found.start()]).decode("latin-1").split("\n")
        pairs = (line.partition(":") for line in lines if ":" in line)
        self._headers = {key.strip().lower(): value.strip() for key, _, value in pairs}
        del self._data[: found.end()]
        self._state, self._from, self._jpeg = self._body, 0, JpegEnd()
        return True

    def _body(self) -> bool:
        stated = self._headers.get("content-length", "")
        length = int(stated) if stated.isascii() and stated.isdigit() and len(stated) < 12 else None
        if length is not None and length > MAX_BODY:
            self._broken(f"a part of {length} bytes")
            return True
        if len(self._data) < (2 if length is None else min(2, length)):
            return False
        if self._data[:2] == START and (length is None or length >= 2):
            return self._jpeg_body(length)
        if length is not None:
            return self._counted_body(length)
        return self._open_body()

    def _jpeg_body(self, length: int | None) -> bool:
        stop = length
        if length is None:  # a boundary before the image's end: it was cut off
            found = self._find_boundary(self._from)
            self._from = max(0, len(self._data) - self._longest)
            stop = None if found is None else found.start()
        try:
            end = self._jpeg.find(self._data, stop)
        except ValueError as error:
            self._broken(str(error))
            return True
        if end is not None:
            self._finish(end)
        elif stop is not None and len(self._data) >= stop:
            self._broken("corrupt JPEG: cut off")
        else:
            return self._too_long()
        return True

    def _counted_body(self, length: int) -> bool:
        if len(self._data) < length:
            return False
        self._finish(length)
        return True

    def _open_body(self) -> bool:
        """A body that only the next boundary ends."""
        found = self._find_boundary(self._from)
        if found is None:
            self._from = max(0, len(self._data) - self._longest)
            return self._too_long()
        self._parts.append(Part(self._headers, bytes(self._data[: found.start()])))
        self._enter_head(found)
        return True

    def _finish(self, end: int) -> None:
        self._parts.append(Part(self._headers, bytes(self._data[:end])))
        del self._data[:end]
        self._state = self._seek

    def _too_long(self) -> bool:
        if len(self._data) <= MAX_BODY:
            return False
        self._broken(f"a part of more than {MAX_BODY} bytes")
        return True

    def _broken(self, fault: str) -> None:
        """Report the part; the next one begins at the next boundary, wherever this was to end."""
        self._parts.append(Part(self._headers, b"", fault))
        self._state = self._seek


class JpegEnd:
    """Finds the end of one JPEG that begins at byte 0 of a growing buffer, without decoding it.

    A stream without lengths shows a frame's end only by the next frame's beginning, one frame too
    late; the JPEG's own markers (ITU-T T.81, annex B) show it at once. They also show most damage,
    which decoders pass as grey or torn images.
    """

    def __init__(self) -> None:
        self._at = 2  # where the next marker is looked for
        self._entropy = False  # whether that is inside entropy-coded data
        self._frame = False  # whether a frame header (the size) was seen
        self._scan = False

    def find(self, data: bytes | bytearray, stop: int | None = None) -> int | None:
        """Index one past the JPEG's last byte, or None while that byte has not arrived.

        `data` is the whole buffer at every call, of which the bytes before `stop` count; bytes
        searched in an earlier call are not searched again.

        `ValueError`: the data cannot be a JPEG.
        """
        size = len(data) if stop is None else min(stop, len(data))
        if size >= 2 and data[:2] != START:
            raise ValueError("no JPEG: it does not begin like one")
        while self._at + 2 <= size:
            if self._entropy:
                found = _MARKER.search(data, self._at, size)
                if found is None:
                    self._at = max(self._at, size - 1)
                    return None
                self._at, self._entropy = found.start(), False
            if data[self._at] != 0xFF:
                raise ValueError("corrupt JPEG: data where a marker belongs")
            kind = data[self._at + 1]
            if kind == 0xFF:
                self._at += 1
            elif kind == _END:
                if not (self._frame and self._scan):
                    raise ValueError("corrupt JPEG: it ends before its image")
                return self._at + 2
            elif not self._segment(data, kind, size):
                return None
        return None

    def _segment(self, data: bytes | bytearray, kind: int, size: int) -> bool:
        """Step over one segment; False where its length has not arrived."""
        if kind < 0xC0 or kind == 0xD8 or 0xD0 <= kind <= 0xD7:
            raise ValueError(f"corrupt JPEG: marker 0x{kind:02x} out of place")
        if self._at + 4 > size:
            return False
        length = int.from_bytes(data[self._at + 2 : self._at + 4], "big")
        if length < 2:
            raise ValueError("corrupt JPEG: a segment shorter than its own length")
        self._frame |= kind in _FRAMES
        if kind == _SCAN and not self._frame:
            raise ValueError("corrupt JPEG: a scan before the frame header")
        self._at += 2 + length
        self._entropy = kind == _SCAN
        self._scan |= self._entropy
        return True
