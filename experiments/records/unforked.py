"""Open files that a forked process does not keep: with its copy of one it would keep the lock, too,
as where a lab's own code forks and leaves."""

import os
from contextlib import suppress

_FILES: dict[int, os.stat_result] = {}


def keep_to_itself(file: int) -> None:
    """Have processes that are forked from now on close their copy of an open file."""
    _FILES[file] = os.fstat(file)


def close(file: int) -> None:
    """Close such a file."""
    _FILES.pop(file, None)
    os.close(file)


def _close_copies() -> None:
    """Of the files that are still open: the number of one that others closed may be of another."""
    for file, was in _FILES.items():
        with suppress(OSError):
            if os.path.samestat(os.fstat(file), was):
                os.close(file)
    _FILES.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_close_copies)
