"""A file that gzip packed: `run.csv.gz`."""

import gzip
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from experiments.importing.recording import BadFileError
from experiments.records.unpacking import LEAST_BYTES, MOST_RATIO

ENDING = ".gz"
MAX_BYTES = 1_000_000_000  # as of text
BLOCK_BYTES = 1 << 20


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """A file with the content of the packed one, in a folder that goes with the context, under the
    name without ENDING. BadFileError: damaged, or of more than MAX_BYTES unpacked, or than it can
    hold: blank lines, of which a small file may hold a billion, take minutes to read."""
    most = min(MAX_BYTES, max(LEAST_BYTES, MOST_RATIO * path.stat().st_size))
    with TemporaryDirectory(prefix="import-") as folder:
        inside = Path(folder) / path.stem
        try:
            with gzip.open(path) as packed, inside.open("wb") as file:
                while block := packed.read(BLOCK_BYTES):
                    file.write(block)
                    if file.tell() > most:
                        raise BadFileError(f"it unpacks to more than {most} bytes")
        except (gzip.BadGzipFile, zlib.error, EOFError) as error:
            raise BadFileError(f"not readable as gzip's ({error})") from error
        yield inside
