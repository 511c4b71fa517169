"""Times of day in text, with a date (ISO 8601) or without."""

import re

import numpy as np

_CLOCK = re.compile(r"\s*(?:(\d{4}-\d\d-\d\d)[T ])?(\d{1,2}):(\d\d):(\d\d(?:[.,]\d+)?)\s*Z?\s*")


def is_clock(cell: str) -> bool:
    """Whether the text is a time of day."""
    return _CLOCK.fullmatch(cell) is not None


def clock_seconds(cell: str) -> float:
    """Seconds of a date with time (since 1970), or of a time of day (since midnight)."""
    match = _CLOCK.fullmatch(cell)
    if not match:
        return np.nan
    day, hours, minutes, seconds = match.groups()
    since = 0.0
    if day:
        try:
            since = np.datetime64(day, "s").astype(np.int64)
        except ValueError:
            return np.nan
    return float(since) + 3600 * int(hours) + 60 * int(minutes) + float(seconds.replace(",", "."))
