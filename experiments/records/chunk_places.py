"""Where the compressed chunks of an MCAP file lie, found by their own bytes: what is damaged before
one, or its opcode or one of its lengths, costs no rows of it.

A chunk's content: first and last time, size and checksum of what it holds, the name of the
compression, the length of the compressed data, and these.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain, pairwise

from experiments.records.samples_file import CHUNK, HEAD

ZSTD = struct.pack("<I", 4) + b"zstd"  # with its length, as a chunk names its compression
NAME = 28  # bytes of a chunk's content before that name
DATA = NAME + len(ZSTD) + 8  # and before the compressed data


@dataclass(frozen=True)
class ChunkPlace:
    """Bytes begin to end of a chunk's record; sound: its opcode and its lengths agree."""

    begin: int
    end: int
    sound: bool

    def content(self, buffer: bytes) -> bytes:
        """The record's content, with the length of the data that its place tells."""
        begin = self.begin + HEAD
        length = struct.pack("<Q", self.end - begin - DATA)
        return buffer[begin : begin + DATA - 8] + length + buffer[begin + DATA : self.end]


def chunk_places(buffer: bytes) -> Iterator[ChunkPlace]:
    """Yield the chunks of `buffer` that are there whole, in order.

    Of a chunk whose lengths do not agree the longer one counts that keeps within the next chunk's
    begin: the decoder takes no more than its own.
    """
    for begin, after in pairwise(chain(_begins(buffer), [len(buffer)])):
        opcode, outer, inner = _head(buffer, begin)
        least = begin + HEAD + DATA
        ends = [end for end in (least + inner, begin + HEAD + outer) if least <= end <= after]
        if ends:
            yield ChunkPlace(begin, max(ends), opcode == CHUNK and outer == DATA + inner)


def _begins(buffer: bytes) -> Iterator[int]:
    """Yield where a chunk begins: its compression is named, its opcode or its lengths are right."""
    found = buffer.find(ZSTD)
    while found >= 0:
        begin = found - NAME - HEAD
        if 0 <= begin <= len(buffer) - HEAD - DATA:
            opcode, outer, inner = _head(buffer, begin)
            if opcode == CHUNK or outer == DATA + inner:
                yield begin
        found = buffer.find(ZSTD, found + 1)


def _head(buffer: bytes, begin: int) -> tuple[int, int, int]:
    """Opcode, length of the content, length of the compressed data."""
    opcode, outer = struct.unpack_from("<BQ", buffer, begin)
    (inner,) = struct.unpack_from("<Q", buffer, begin + HEAD + DATA - 8)
    return opcode, outer, inner
