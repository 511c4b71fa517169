"""When the ball's model fails, in words, where most of its error comes in a short time."""

from math import ceil

import numpy as np

from calibration.gap.findings import Findings

# Chosen, because a fault of the table shows whenever the ball moves: what takes less of a log is an
# event, a hand at the ball or a jump of the camera.
SHORT_SHARE = 0.15
NOTHING = 1.05  # noise floors: below, there is nothing to find (the report's own words)


def stretch(found: Findings) -> tuple[float, float, float] | None:
    """Begin and end [s] of the shortest time that holds most (more than half) of the ball's error
    beyond noise, and the end of the log; None where that time is not short, or where there is
    hardly an error."""
    over_time = [p for p in found.profiles if p.quantity == "time" and p.channel.startswith("ball")]
    if not over_time:
        return None
    edges = over_time[0].edges  # of both axes, which are seen together
    over_time = [one for one in over_time if len(one.edges) == len(edges)]
    beyond = sum(one.count * np.nan_to_num(np.maximum(one.gap**2 - 1.0, 0.0)) for one in over_time)
    sums = np.concatenate([[0.0], np.cumsum(beyond)])
    if sums[-1] <= (NOTHING**2 - 1.0) * sum(int(one.count.sum()) for one in over_time):
        return None
    for bins in range(1, int(SHORT_SHARE * (len(edges) - 1)) + 1):
        inside = sums[bins:] - sums[:-bins]
        first = int(np.argmax(inside))
        if inside[first] > sums[-1] / 2:
            return float(edges[first]), float(edges[first + bins]), float(edges[-1])
    return None


def when_words(found: Findings, *, logs: int, files: bool) -> str:
    """A sentence on when most of the error comes and what to do about it; "" where it comes all
    along, or of several logs, whose times are not one. files: they are files of other programs."""
    short = stretch(found) if logs == 1 else None
    if short is None:
        return ""
    begin, end, whole = short
    said = f"Most of the ball's error lies in {begin:.1f} to {end:.1f} s of {whole:.0f} (a hand?)"
    if files and end < whole / 2:
        return f"{said}: leave it out with --from {ceil(end)}."
    return f"{said}: was the table touched then? Record again, or cut it out of the log."
