"""Frames of a source, read on through its failures while its camera recovers."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vision.frames import Frame
    from vision.sources.sources import Source

GIVE_UP_S = 10.0


def frames_of(
    source: Source,
    troubles: list[str],
    *,
    give_up_s: float = GIVE_UP_S,
    now: Callable[[], float] = time.monotonic,
) -> Iterator[Frame]:
    """Yield the source's frames until its end, or until a failing one gave none for `give_up_s`.

    Each kind of `SourceError` on the way is appended to `troubles` at the end: its last message and
    its count. now: clock [s].
    """
    from vision.sources.source_errors import SourceError

    counts: dict[type, int] = {}
    last: dict[type, str] = {}
    last_s = now()
    while True:
        try:
            for frame in source:
                yield frame
                last_s = now()
            break
        except SourceError as error:
            counts[type(error)] = counts.get(type(error), 0) + 1
            last[type(error)] = str(error)
            if now() - last_s >= give_up_s:
                break
    troubles += [f"{last[k]} ({n} time{'s' * (n > 1)})" for k, n in counts.items()]
