"""Frames of a camera class of a lab's own, which may print, wait, leave or crash the program."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Timer
from typing import TYPE_CHECKING, Any, TypeVar

from rig.files import printable
from rig.foreign_trial import Here, LeftError, Tells, in_copy, standard_error
from rig.loop.signals import end_by

if TYPE_CHECKING:
    from vision.sources.sources import Source

T = TypeVar("T")
SAY_S = 3.0  # chosen: who waits longer for a camera asks whether the program lives
OPEN_S = 30.0  # chosen: makers' libraries take some seconds to find and start a camera


@contextmanager
def opened(address: str | Path | int, tells: Tells) -> Iterator["Source"]:
    """`open_source` in work of `with_camera`, which says on standard error what it waits for where
    it takes SAY_S; a camera class of a lab's own has OPEN_S."""
    from vision.sources.addresses import without_password
    from vision.sources.sources import open_source

    waits = Timer(SAY_S, _say_waiting, (without_password(str(address)),))
    waits.daemon = True
    waits.start()
    tells.begins(f"{address}: opening it", OPEN_S)
    try:
        source = open_source(address)
    finally:
        waits.cancel()
    tells.begins(str(address), None)
    with source:
        yield source


def _say_waiting(name: str) -> None:
    with suppress(OSError):  # nobody reads it
        print(f"opening {printable(name)}: waiting for its first frame", file=sys.stderr)


def with_camera(
    address: str | Path | int,
    work: Callable[[Tells], T],
    *,
    heard: Callable[[Any], None] = lambda told: None,
) -> T:
    """Return `work(tells)`, which reads the address (`opened`); `heard` gets what it says.

    Where the address is a camera class of a lab's own it is done, on Linux, in a copy of this
    process, whose prints go to standard error, those of compiled code, too; elsewhere makers'
    libraries do not live in one. UserCameraError: the class hung as it opened, left the program or
    crashed it; what was written so far stays.
    """
    from vision.sources.source_errors import UserCameraError
    from vision.sources.user_camera import split_address

    if split_address(str(address)) is None or not sys.platform.startswith("linux"):
        return work(Here(heard))

    def left(error: LeftError) -> T:
        if error.number:
            end_by(error.number)
        raise UserCameraError(str(error)) from None

    return in_copy(work, heard=heard, output=standard_error, passes_on=True, left=left)
