"""The content of a file that anybody may have made: a pipe, a device or an endless file is refused
and not waited for.
"""

import os
import stat
from pathlib import Path
from typing import Any

from rig.validation import read_json, read_toml

LONGEST = 1 << 24  # bytes; chosen: a hundred times the longest answer or record of a run
LONGEST_TOML = 1 << 20  # bytes; chosen: a hundred times a long rig file
# A pipe that nobody writes to would be waited for, before one could see that it is a pipe.
_FLAGS = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)


def file_bytes(path: Path, longest: int | None = LONGEST) -> bytes:
    """Return the content of a file, of at most `longest` bytes (None: of any length).

    What is looked at is what is then read, so that nobody exchanges it in between. ValueError (one
    line, without the path): a folder, a pipe or a device, or longer. OSError: it cannot be read.
    """
    handle = os.open(path, _FLAGS)
    try:
        about = os.fstat(handle)
        if not stat.S_ISREG(about.st_mode):
            raise ValueError("no file, but a folder, a pipe or a device")
        if longest is not None and about.st_size > longest:
            raise ValueError(f"longer than {longest} bytes")
        with os.fdopen(handle, "rb", closefd=False) as file:
            data = file.read() if longest is None else file.read(longest + 1)
    finally:
        os.close(handle)
    if longest is not None and len(data) > longest:  # it grew, or is one of the system's own
        raise ValueError(f"longer than {longest} bytes")
    return data


def file_text(path: Path, longest: int = LONGEST) -> str:
    """Return the text (UTF-8) of a file; errors as of `file_bytes`. ValueError: no UTF-8, too."""
    try:
        return file_bytes(path, longest).decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        raise ValueError(f"no text in UTF-8 ({error.reason} at byte {error.start})") from None


def toml_of(path: Path) -> dict[str, Any]:
    """Return the data of a TOML file; errors as of `file_text` and `read_toml`."""
    return read_toml(file_text(path, LONGEST_TOML))


def json_of(path: Path, longest: int = LONGEST) -> Any:
    """Return the data of a JSON file; errors as of `file_text` and `read_json`."""
    return read_json(file_text(path, longest))
