"""A file that is written whole or not at all: a full disk leaves the one that was there."""

import os
import stat
from contextlib import suppress
from pathlib import Path


def replace(path: Path, content: bytes, *, sync: bool = False) -> None:
    """Write a new file beside `path` and put it in its place.

    sync: wait until the disk has it. OSError: the old file stays.
    """
    part = part_of(path)
    try:
        with part.open("r+b" if part.exists() else "wb") as file:  # r+b: keep what is reserved
            file.write(content)
            file.truncate()
            if sync:
                file.flush()
                os.fsync(file.fileno())
        part.replace(path)
    except BaseException:
        with suppress(OSError):
            part.unlink()
        raise


def part_of(path: Path) -> Path:
    """Return where a file is written before it takes the place of `path`.

    In somebody else's folder a link may lie there, which leads to any file, a second name of one,
    or a pipe: it is removed.
    """
    part = path.with_name(path.name + ".part")
    with suppress(FileNotFoundError):
        about = part.lstat()
        if not (stat.S_ISREG(about.st_mode) and about.st_nlink == 1):
            part.unlink()
    return part
