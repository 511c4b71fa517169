"""How much compressed data may become: a file that claims more than it can hold holds nothing."""

import zlib
from io import BytesIO
from typing import Any

# Bytes out to bytes in, of a whole file. Chosen: thirty columns, all but the clock at rest, and a
# clock of doubles that becomes four times smaller.
MOST_RATIO = 128
LZ4_RATIO = 255  # of LZ4 at most, whose decoder takes what it may fill before it begins
LEAST_BYTES = 1 << 26  # chosen: so much a file of any size may hold, and a chunk of MCAP at most


def unpacked(chunk: Any, most: int) -> bytes:
    """The records of an MCAP chunk.

    ValueError: more than `most` bytes, LEAST_BYTES, or what the chunk itself says, or a wrong
    checksum.
    """
    import lz4.frame
    import zstandard

    most = min(most, chunk.uncompressed_size, LEAST_BYTES)
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
