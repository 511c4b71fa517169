"""Waiting for what another thread or process brings about."""

import time
from collections.abc import Callable


def wait_for(
    what: str, holds: Callable[[], object], seconds: float = 60.0, *, every_s: float = 0.02
) -> None:
    """Poll until `holds()` is true; AssertionError names what did not come."""
    end_s = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end_s, f"{what} did not come within {seconds:g} s"
        time.sleep(every_s)
