"""Where a JPEG ends, without decoding it (ITU-T T.81, annex B).

A stream without lengths shows a frame's end by the next frame's beginning, one frame too late; the
image itself says it at once. It also shows most damage, which decoders pass as grey or torn images.
"""

from __future__ import annotations

import re

START = b"\xff\xd8"
# In entropy-coded data 0xff is followed by a stuffed 0 or a restart marker, before a real marker
# by fill bytes 0xff at most.
_MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")
_SCAN, _END = 0xDA, 0xD9
_FRAMES = frozenset({*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC})


class JpegEnd:
    """Looks for the end of one JPEG that begins at byte 0 of a growing buffer."""

    def __init__(self) -> None:
        self._at = 2  # where the next marker is looked for
        self._entropy = False  # whether that is inside entropy-coded data
        self._frame = False  # whether a frame header (the size) was seen
        self._scan = False

    def find(self, data: bytes | bytearray, stop: int | None = None) -> int | None:
        """One past the last byte, None where it is not there yet; `ValueError` where none can be.

        `data` is the whole buffer each time (only what lies before `stop` counts); what was looked
        through before is not again.
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
