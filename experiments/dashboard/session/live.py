"""What the loop said last: the newest row and short memories of it, for whoever draws."""

import threading
import time
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from rig.log import INDEX

POINTS = 250  # of a curve: a panel is no wider
CURVE_S = 20.0
FRESH = 2048  # rows that wait for the ghost: 4 s
_T, _X, _Y = INDEX["t_s"], INDEX["ball_x_m"], INDEX["ball_y_m"]
_COV = INDEX["ball_cov_xx_m2"]
_PHASE = INDEX["phase"]


@dataclass(frozen=True, eq=False)
class Now:
    """The newest row (len(COLUMNS),) with the ball as last seen; None before the first.

    seen_s: the table's time when the ball was last seen; cov_m2: xx, xy, yy of that sight; rate:
    ticks a wall second over the last seconds; silent_s: wall time since the last row.
    """

    row: np.ndarray | None
    seen_s: float
    cov_m2: tuple[float, float, float]
    rate: float
    silent_s: float
    run: int


@dataclass
class Mean:
    """The centroid of a run's ball so far: k-means with one cluster is the mean."""

    n: int = 0
    sum_m: np.ndarray = field(default_factory=lambda: np.zeros(2))

    def add(self, xy_m: np.ndarray) -> None:
        self.n, self.sum_m = self.n + 1, self.sum_m + xy_m

    @property
    def xy_m(self) -> np.ndarray | None:
        return self.sum_m / self.n if self.n else None


class Live:
    """Rows go in from the thread that drains the loop, pictures come out in the thread that draws.

    Nothing here waits: a reader that is slow misses rows.
    """

    def __init__(self, rate_hz: float) -> None:
        self._lock = threading.Lock()
        self._every = max(1, round(CURVE_S * rate_hz / POINTS))
        self._curve: deque[np.ndarray] = deque(maxlen=POINTS)
        self._fresh: deque[np.ndarray] = deque(maxlen=FRESH)
        self._trail: deque[tuple[float, float]] = deque(maxlen=180)
        self._arrivals: deque[tuple[float, int]] = deque(maxlen=64)
        self._row: np.ndarray | None = None
        self._ball, self._cov = np.full(2, np.nan), (np.nan, np.nan, np.nan)
        self._seen_s, self._count, self._last_s, self._run = np.nan, 0, time.monotonic(), 0
        self.centroid = Mean()

    def begin(self) -> None:
        """Another run: its time starts at zero again."""
        with self._lock:
            self._curve.clear()
            self._fresh.clear()
            self._trail.clear()
            self._arrivals.clear()
            self._row, self._ball = None, np.full(2, np.nan)
            self._seen_s, self._count = np.nan, 0
            self.centroid = Mean()
            self._run += 1

    def add(self, row: np.ndarray) -> None:
        """A row of the loop, copied."""
        row = row.copy()
        with self._lock:
            if row[_X] == row[_X]:  # a new observation
                self._ball, self._seen_s = row[_X : _Y + 1].copy(), float(row[_T])
                self._cov = tuple(row[_COV : _COV + 3])
                self._trail.append((float(row[_X]), float(row[_Y])))
                if row[_PHASE] == 2:
                    self.centroid.add(self._ball)
            self._fresh.append(row)
            self._row = row
            self._count += 1
            if self._count % self._every == 0:
                kept = row.copy()
                kept[_X : _Y + 1] = self._ball
                self._curve.append(kept)
            now_s = time.monotonic()
            self._last_s = now_s
            if self._count % 50 == 0:
                self._arrivals.append((now_s, self._count))

    def now(self) -> Now:
        """The newest state; its row is the caller's own."""
        with self._lock:
            row = None if self._row is None else self._row.copy()
            if row is not None:
                row[_X : _Y + 1] = self._ball
            silent_s = time.monotonic() - self._last_s
            return Now(row, self._seen_s, self._cov, self._rate(), silent_s, self._run)

    def _rate(self) -> float:
        if len(self._arrivals) < 2:
            return float("nan")
        (t0, n0), (t1, n1) = self._arrivals[0], self._arrivals[-1]
        return (n1 - n0) / (t1 - t0) if t1 > t0 else float("nan")

    def fresh(self) -> list[np.ndarray]:
        """The rows since the last call, oldest first."""
        with self._lock:
            rows = list(self._fresh)
            self._fresh.clear()
            return rows

    def curve(self) -> np.ndarray:
        """Thinned rows of the last seconds (n <= POINTS, len(COLUMNS)), the ball held."""
        with self._lock:
            return np.array(self._curve)

    def trail(self) -> np.ndarray:
        """The ball's last places (n, 2) [m]."""
        with self._lock:
            return np.array(self._trail).reshape(-1, 2)
