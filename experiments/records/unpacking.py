"""How much compressed data may become: a file that claims more than it can hold holds nothing."""

import zlib
from io import BytesIO
from typing import Any

MOST_RATIO = 1032  # of deflate: bytes out to bytes in; rows of numbers stay far below
LZ4_RATIO = 255  # the same of LZ4, whose decoder takes what it may fill before it begins
LEAST_BYTES = 1 << 26  # chosen: so much a file of any size may hold


def unpacked(chunk: Any, most: int) -> bytes:
    """The records of an MCAP chunk.

    ValueError: more than `most` bytes, or than the chunk itself says, or a wrong checksum.
    """
    import lz4.frame
    import zstandard

    most = min(most, chunk.uncompressed_size)
    if chunk.compression == "zstd":
        data = zstandard.ZstdDecompressor().stream_reader(BytesIO(chunk.data)).read(most + 1)
    elif chunk.compression == "lz4":
        room = min(most, LZ4_RATIO * len(chunk.data))
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=room + 1)
    else:
        data = chunk.data
    if len(data) > most:
        raise ValueError(f"its chunks hold more than {most} bytes")
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("a chunk with a wrong checksum")
    return data
