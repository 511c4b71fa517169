"""How late ticks came: a histogram that costs next to nothing a tick and fits into run.json."""

import time
from bisect import bisect_right

from rig.table import Table

EDGES_US = (
    1, 2, 3, 5, 7, 10, 15, 20, 30, 50, 70, 100, 150, 200, 300, 500, 700, 1000, 1500, 2000, 3000,
    5000, 7000, 10_000, 20_000, 50_000, 100_000, 1_000_000,
)  # fmt: skip


class Jitter:
    """Histogram of how late ticks came.

    counts: by bins with the edges EDGES_US; ticks: how many; missed: points of the clock's grid at
    which no tick was; worst_us: latest tick [1e-6 s]; values_us: the first `keep` values
    themselves.
    """

    def __init__(self, keep: int = 0) -> None:
        self.counts = [0] * (len(EDGES_US) + 1)
        self.ticks, self.missed, self.worst_us = 0, 0, 0.0
        self.values_us: list[float] = [0.0] * keep

    def add(self, late_s: float, missed: int = 0) -> None:
        """Add a tick that came `late_s` late, and `missed` points of the grid before it."""
        late_us = 1e6 * late_s
        self.counts[bisect_right(EDGES_US, late_us)] += 1
        if self.ticks < len(self.values_us):
            self.values_us[self.ticks] = late_us
        self.ticks += 1
        self.missed += missed
        if late_us > self.worst_us:
            self.worst_us = late_us

    def quantile_us(self, share: float) -> float:
        """Upper edge [1e-6 s] of the bin in which the share of the ticks is reached; inf beyond
        all edges.
        """
        wanted, so_far = share * self.ticks, 0
        for edge, count in zip(EDGES_US, self.counts, strict=False):
            so_far += count
            if so_far >= wanted:
                return float(edge)
        return float("inf")

    def record(self) -> dict:
        """Return the histogram as run.json keeps it.

        counts[i] ticks were at least edges_us[i - 1] late and less than edges_us[i]; the last count
        is that beyond all edges.
        """
        return {
            "ticks": self.ticks,
            "missed": self.missed,
            "worst_us": round(self.worst_us, 1),
            "p50_us": self.quantile_us(0.5),
            "p99_us": self.quantile_us(0.99),
            "p99_9_us": self.quantile_us(0.999),
            "edges_us": list(EDGES_US),
            "counts": list(self.counts),
        }


class Lateness:
    """How late the last tick came: what the table's ticker says, else by the ticks' intervals."""

    def __init__(self, table: Table, jitter: Jitter) -> None:
        self._ticker, self._jitter = getattr(table, "ticker", None), jitter
        self._period_s, self._last_s, self._missed = table.period_s, None, 0

    def __call__(self) -> float:
        now_s = time.monotonic()
        if self._ticker is not None:
            late_s, missed = self._ticker.late_s, self._ticker.missed
        else:
            step_s = self._period_s if self._last_s is None else now_s - self._last_s
            late_s = max(0.0, step_s - self._period_s)
            missed = self._missed + int(late_s / self._period_s)
        self._jitter.add(late_s, missed - self._missed)
        self._last_s, self._missed = now_s, missed
        return late_s
