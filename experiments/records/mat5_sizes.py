"""Walk through a matrix of a MAT file (version 5), in the order in which scipy reads it, and refuse
dimensions that its own bytes cannot hold: scipy takes memory by the dimensions. Likewise types of
numbers that there are not: scipy looks them up beyond the end of its table, and the program ends.
"""

import struct
from collections.abc import Callable
from math import prod

CELL, STRUCT, OBJECT, CHAR, SPARSE, FUNCTION, OPAQUE = 1, 2, 3, 4, 5, 16, 17  # classes of MAT 5
MOST_DEEP = 20  # chosen: deeper than anybody nests
MOST_NAMES = 1 << 20  # bytes of a header's element; chosen: thousands of fields
COMPLEX = 0x800  # flag
# Bytes of a number by the type of its element: int8 to uint32, single, double, 64 bits, UTF-8 to 32
BYTES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8, 16: 1, 17: 2, 18: 4}
STEP = 1 << 20  # bytes that are passed over at once

Read = Callable[[int], bytes]  # the next bytes, fewer at the end


class Matrix:
    """The matrices that `read` gives, in the byte order `order` ("<" or ">")."""

    def __init__(self, read: Read, order: str) -> None:
        self._read, self._order = read, order

    def check(self, depth: int = 0) -> None:
        """Pass over the matrix that begins here. ValueError: it cannot hold what it claims."""
        if depth > MOST_DEEP:
            raise ValueError(f"it is nested more than {MOST_DEEP} deep")
        if self._numbers("II", self._exactly(8))[1] == 0:  # an empty one has no header
            return
        flags = self._numbers("II", self._element()[:8])[0]
        kind = flags & 0xFF
        if kind == OPAQUE:
            for _ in range(3):
                self._element()
            return self.check(depth + 1)
        dims = self._element()
        count = prod(self._numbers(f"{len(dims) // 4}i", dims[: len(dims) // 4 * 4]))
        self._element()  # its name
        if kind in (CELL, STRUCT, OBJECT, FUNCTION):
            self._check_parts(kind, count, depth)
        else:
            self._check_numbers(kind, count, 2 if flags & COMPLEX else 1)
        return None

    def _check_parts(self, kind: int, count: int, depth: int) -> None:
        fields = 1
        if kind == OBJECT:
            self._element()
        if kind in (STRUCT, OBJECT):
            longest = self._numbers("i", self._element()[:4])[0]
            fields = len(self._element()) // max(longest, 1)
            if fields == 0 and count > 1:
                raise ValueError(f"a struct without fields claims {count} parts")
        for _ in range(1 if kind == FUNCTION else count * fields):
            self.check(depth + 1)

    def _check_numbers(self, kind: int, count: int, parts: int) -> None:
        for _ in range(parts + (2 if kind == SPARSE else 0)):
            held = self._pass_over()
            if kind != SPARSE and count > held:
                raise ValueError(f"an array claims {count} numbers, its bytes hold {held}")

    def _numbers(self, form: str, data: bytes) -> tuple[int, ...]:
        return struct.unpack(self._order + form, data)

    def _exactly(self, size: int) -> bytes:
        data = self._read(size)
        if len(data) < size:
            raise ValueError("it ends before its dimensions are full")
        return data

    def _tag(self) -> tuple[int, int, bytes]:
        """Type and bytes of the element that begins here, and these themselves where its tag holds
        them."""
        head = self._exactly(8)
        kind, size = self._numbers("II", head)
        if small := kind >> 16:
            return kind & 0xFFFF, small, head[4 : 4 + small]
        return kind, size, b""

    def _element(self) -> bytes:
        _, size, small = self._tag()
        if size > MOST_NAMES:
            raise ValueError(f"a header of {size} bytes")
        return small or self._exactly(size + -size % 8)[:size]

    def _pass_over(self) -> int:
        """Pass over an element of numbers or letters; return how many it can hold. ValueError: it
        is of a type that there is not."""
        kind, size, small = self._tag()
        if kind not in BYTES:
            raise ValueError(f"numbers of a type {kind} that there is not")
        left = 0 if small else size + -size % 8
        while left > 0:
            left -= len(self._exactly(min(left, STEP)))
        return size // BYTES[kind]
