"""How another machine's clock stands to ours, from messages that go both ways all the time.

One exchange gives the offset to half its round trip, whatever the two ways' shares were, so the
fastest exchange of the last seconds is believed (NTP's clock filter, RFC 5905 section 10).
"""

from collections import deque
from dataclasses import dataclass
from math import inf, nan

EVERY_S = 0.5  # the fastest exchange of so long makes one point
BELIEVED = 8  # points among which the fastest gives the offset
KEPT = 1200  # points of the line that gives the drift: ten minutes
SHORTEST_S = 5.0  # of that line


@dataclass(frozen=True)
class ClockRecord:
    """Their clock minus ours [s], good to half the round trip [s], and the drift of that offset.

    drift_ppm [1e-6]: NaN before `SHORTEST_S`; exchanges: how many were seen.
    """

    offset_s: float
    round_trip_s: float
    drift_ppm: float
    exchanges: int


class LinkClock:
    """Estimates another machine's clock from exchanges of messages."""

    def __init__(self) -> None:
        self._points: deque[tuple[float, float, float]] = deque(maxlen=KEPT)  # ours, offset, trip
        self._best: tuple[float, float, float] = (nan, nan, inf)
        self._begin_s = nan
        self._exchanges = 0

    def exchange(
        self, sent_s: float, received_s: float, answered_s: float, arrived_s: float
    ) -> float:
        """Take one exchange and return its round trip [s].

        sent_s, arrived_s: by our clock; received_s, answered_s: by theirs.

        Offset and round trip by RFC 5905, section 8: offset = ((received - sent) + (answered -
        arrived))/2, round trip = (arrived - sent) - (answered - received).
        """
        trip_s = (arrived_s - sent_s) - (answered_s - received_s)
        offset_s = 0.5 * ((received_s - sent_s) + (answered_s - arrived_s))
        self._exchanges += 1
        if self._exchanges == 1 or arrived_s - self._begin_s >= EVERY_S:
            if self._exchanges > 1:
                self._points.append(self._best)
            self._begin_s, self._best = arrived_s, (nan, nan, inf)
        if trip_s < self._best[2]:
            self._best = (arrived_s, offset_s, trip_s)
        return trip_s

    def fastest_s(self) -> float:
        """Return the shortest round trip of the last `EVERY_S` to twice that; inf without any."""
        last_s = self._points[-1][2] if self._points else inf
        return min(last_s, self._best[2])

    def record(self) -> ClockRecord:
        """Return what is known of their clock: the offset of the fastest recent exchange."""
        recent = [*list(self._points)[-BELIEVED:], self._best]
        _, offset_s, trip_s = min(recent, key=lambda point: point[2])
        return ClockRecord(offset_s, trip_s, self._drift_ppm(), self._exchanges)

    def _drift_ppm(self) -> float:
        """Slope of the line through the points, each weighted by its trip: slow ones say less."""
        if not self._points or self._points[-1][0] - self._points[0][0] < SHORTEST_S:
            return nan
        weighted = [(t, o, 1.0 / max(trip, 1e-5) ** 2) for t, o, trip in self._points]
        total = sum(w for _, _, w in weighted)
        mean_t = sum(w * t for t, _, w in weighted) / total
        mean_o = sum(w * o for _, o, w in weighted) / total
        square = sum(w * (t - mean_t) ** 2 for t, _, w in weighted)
        return 1e6 * sum(w * (t - mean_t) * (o - mean_o) for t, o, w in weighted) / square
