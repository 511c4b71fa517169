"""Times of day in text, with a date or without, in any zone."""

import re

import numpy as np

_CLOCK = re.compile(
    r"\s*(?:(\d{4}-\d\d-\d\d)[T ]|\d{1,4}[./-]\d{1,2}[./-]\d{1,4},?\s+)?"
    r"(\d{1,2}):(\d\d):(\d\d(?:[.,]\d+)?)\s*([AaPp][Mm])?\s*"
    r"(?:Z|UTC|([+-]\d\d):?(\d\d))?\s*"
)


def is_clock(cell: str) -> bool:
    """Whether the text is a time of day."""
    return _CLOCK.fullmatch(cell) is not None


def clock_seconds(cell: str) -> float:
    """Seconds of a date of ISO 8601 with time (since 1970 at Greenwich), or of a time of day (since
    midnight) whatever other date stands before it: which of its numbers is the day, is open."""
    match = _CLOCK.fullmatch(cell)
    if not match:
        return np.nan
    day, hours, minutes, seconds, half, zone_hours, zone_minutes = match.groups()
    since = 0.0
    if day:
        try:
            since = float(np.datetime64(day, "s").astype(np.int64))
        except ValueError:
            return np.nan
    hour = int(hours)
    if half:
        hour = hour % 12 + 12 * (half.lower() == "pm")
    if zone_hours:
        east = 60 * abs(int(zone_hours)) + int(zone_minutes)
        since -= 60 * east * (-1 if zone_hours[0] == "-" else 1)
    return since + 3600 * hour + 60 * int(minutes) + float(seconds.replace(",", "."))
