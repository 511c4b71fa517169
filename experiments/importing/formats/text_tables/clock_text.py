"""Times of day in text, with a date or without, in any zone."""

import re

import numpy as np

from experiments.importing.units import canonical, factor

LONGEST = 64  # characters; chosen: a date, a time to the nanosecond and a zone have 35
_SPAN = re.compile(r"(\d+(?:[.,]\d+)?(?:e[-+]?\d+)?)\s*([a-zµμ]+)")
_CLOCK = re.compile(
    r"(?:(\d{4}-\d\d-\d\d)[T ]|\d{1,4}[./-]\d{1,2}[./-]\d{1,4},?\s+|(\d+) days?,? )?"
    r"(\d{1,2}):(\d\d):(\d\d(?:[.,]\d+|:\d{3})?)\s*([AaPp][Mm])?\s*"
    r"(?:Z|UTC|([+-]\d\d):?(\d\d))?"
)


def _match(pattern: re.Pattern[str], cell: str) -> re.Match[str] | None:
    """How a text is of a pattern; one that is longer than LONGEST is of none."""
    cell = cell.strip()
    return pattern.fullmatch(cell) if len(cell) <= LONGEST else None


def is_clock(cell: str) -> bool:
    """Whether the text is a time of day."""
    return _match(_CLOCK, cell) is not None or _span_s(cell) is not None


def _span_s(cell: str) -> float | None:
    """Seconds of a number with its unit, `0.02 sec`; None: it is none."""
    match = _match(_SPAN, cell)
    unit = canonical(match[2]) if match else None
    if match and unit in ("s", "min"):  # 1.5 ms is rather a servo's pulse
        return float(match[1].replace(",", ".")) * (factor(unit, "t_s") or 1.0)
    return None


def clock_seconds(cell: str) -> float:
    """Seconds of a date of ISO 8601 with time (since 1970 at Greenwich), or of a time of day (since
    midnight) whatever other date stands before it: which of its numbers is the day, is open. Of a
    span, too: `0 days 00:00:00.02`, `0.02 sec`."""
    match = _match(_CLOCK, cell)
    if not match:
        span = _span_s(cell)
        return np.nan if span is None else span
    day, days, hours, minutes, seconds, half, zone_hours, zone_minutes = match.groups()
    since = 86400.0 * int(days or 0)
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
    return since + 3600 * hour + 60 * int(minutes) + float(re.sub("[,:]", ".", seconds))
