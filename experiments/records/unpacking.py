"""How much compressed data may become: a file that claims more than it can hold holds nothing."""

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from typing import Any

# Bytes out to bytes in, of a whole file. Chosen: thirty columns, all but the clock at rest, and a
# clock of doubles that becomes four times smaller.
MOST_RATIO = 128
LEAST_BYTES = 1 << 26  # chosen: so much a file of any size may hold, and a chunk of MCAP at most
PIECE = 1 << 20  # bytes unpacked at once; chosen: a chunk of MCAP as its tools write it


@dataclass
class Room:
    """How many bytes the chunks of a file may still be unpacked to."""

    left: int


def unpacked(chunk: Any, room: Room) -> bytes:
    """The records of an MCAP chunk; what it became is taken from `room`, refused or not: a thousand
    refused chunks cost no more than one. Of a file with one damaged bit that is what they hold.

    ValueError: more than `room`, LEAST_BYTES, or what the chunk itself says, or damaged.
    """
    most = min(room.left, chunk.uncompressed_size, LEAST_BYTES)
    read, pieces, held = _reader(chunk), [], 0
    try:
        while held <= most and (piece := read(min(PIECE, most + 1 - held))):
            pieces.append(piece)
            held += len(piece)
            room.left -= len(piece)
    except Exception as error:  # each decoder has its own
        if held != chunk.uncompressed_size:  # else it is whole: its length was damaged
            raise ValueError(f"a damaged chunk: {error}") from None
    if held > most:
        raise ValueError(f"its chunks hold more than {most} bytes")
    data = b"".join(pieces)
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("a chunk with a wrong checksum")
    return data


def _reader(chunk: Any) -> Callable[[int], bytes]:
    """What reads so many bytes of a chunk's records, none at their end."""
    import lz4.frame
    import zstandard

    packed = BytesIO(chunk.data)
    if chunk.compression == "zstd":
        return zstandard.ZstdDecompressor().stream_reader(packed).read
    if chunk.compression == "lz4":
        return lz4.frame.LZ4FrameFile(packed).read
    return packed.read
