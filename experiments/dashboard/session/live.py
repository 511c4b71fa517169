"""Latest log row and a short ring buffer, read by the drawing thread."""

import threading
import time
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from rig.log import COLUMNS, INDEX

POINTS = 250  # of a curve; chosen: a panel is about so many pixels wide
CURVE_S = 20.0  # length of the curves; chosen
UNREAD = 2048  # rows kept for the drawing thread: 4 s at 500 Hz
TRAIL = 180  # observations in the ball's trail: 3 s at 60 Hz
_T, _X, _Y = INDEX["t_s"], INDEX["ball_x_m"], INDEX["ball_y_m"]
_COV = INDEX["ball_cov_xx_m2"]
_PHASE = INDEX["phase"]
_TARGETS = [INDEX["target_x_m"], INDEX["target_y_m"]]


@dataclass(frozen=True, eq=False)
class LiveState:
    """The loop's newest state.

    row (len(COLUMNS),): the newest row, its ball the last one observed; None before the first.
    seen_s: the table's time of that observation; cov_m2: its covariance xx, xy, yy; rate: ticks a
    second of wall time, over the last seconds; silent_s: wall time since the last row or, before
    the first, since the run began; run: counts the runs.
    """

    row: np.ndarray | None
    seen_s: float
    cov_m2: tuple[float, float, float]
    rate: float
    silent_s: float
    run: int


@dataclass
class RunningCentroid:
    """Mean of the ball's observations so far, which is k-means with one cluster: `n` of them, with
    the sum `sum_m` (2,).
    """

    n: int = 0
    sum_m: np.ndarray = field(default_factory=lambda: np.zeros(2))

    def add(self, xy_m: np.ndarray) -> None:
        """Add the observation xy_m (2,)."""
        self.n, self.sum_m = self.n + 1, self.sum_m + xy_m

    @property
    def xy_m(self) -> np.ndarray | None:
        """The centroid (2,) [m]; None without observations."""
        return self.sum_m / self.n if self.n else None


class LiveBuffer:
    """The newest rows of the loop: written by the session's thread, read by the drawing thread; a
    slow reader misses rows. rate_hz: ticks a second.
    """

    def __init__(self, rate_hz: float) -> None:
        self._lock = threading.Lock()
        self._every = max(1, round(CURVE_S * rate_hz / POINTS))
        self._curve: deque[np.ndarray] = deque(maxlen=POINTS)
        self._unread: deque[np.ndarray] = deque(maxlen=UNREAD)
        self._trail: deque[tuple[float, float]] = deque(maxlen=TRAIL)
        self._arrivals: deque[tuple[float, int]] = deque(maxlen=64)
        self._row: np.ndarray | None = None
        self._ball, self._cov = np.full(2, np.nan), (np.nan, np.nan, np.nan)
        self._seen_s, self._count, self._last_s, self._run = np.nan, 0, time.monotonic(), 0
        self.centroid, self._has_ball = RunningCentroid(), True

    def begin(self, *, has_ball: bool = True) -> None:
        """Forget all rows, as another run begins whose time starts at zero; has_ball False: of the
        servos alone, whose log has angles for targets: they are no places on the plate.
        """
        with self._lock:
            self._has_ball = has_ball
            self._curve.clear()
            self._unread.clear()
            self._trail.clear()
            self._arrivals.clear()
            self._row, self._ball = None, np.full(2, np.nan)
            self._seen_s, self._count, self._last_s = np.nan, 0, time.monotonic()
            self.centroid = RunningCentroid()
            self._run += 1

    def add(self, row: np.ndarray) -> None:
        """Add a row of the loop (len(COLUMNS),); it is copied."""
        row = row.copy()
        with self._lock:
            if not self._has_ball:
                row[_TARGETS] = np.nan
            if row[_X] == row[_X]:  # a new observation
                self._ball, self._seen_s = row[_X : _Y + 1].copy(), float(row[_T])
                self._cov = tuple(row[_COV : _COV + 3])
                self._trail.append((float(row[_X]), float(row[_Y])))
                if row[_PHASE] == 2:
                    self.centroid.add(self._ball)
            self._unread.append(row)
            self._row = row
            self._count += 1
            if self._count % self._every == 0:
                point = row.copy()
                point[_X : _Y + 1] = self._ball
                self._curve.append(point)
            now_s = time.monotonic()
            self._last_s = now_s
            if self._count % 50 == 0:
                self._arrivals.append((now_s, self._count))

    def now(self) -> LiveState:
        """The newest state; its row is a copy."""
        with self._lock:
            row = None if self._row is None else self._row.copy()
            if row is not None:
                row[_X : _Y + 1] = self._ball
            silent_s = time.monotonic() - self._last_s
            return LiveState(row, self._seen_s, self._cov, self._rate(), silent_s, self._run)

    def _rate(self) -> float:
        if len(self._arrivals) < 2:
            return float("nan")
        (t0, n0), (t1, n1) = self._arrivals[0], self._arrivals[-1]
        return (n1 - n0) / (t1 - t0) if t1 > t0 else float("nan")

    def unread(self) -> list[np.ndarray]:
        """The rows (len(COLUMNS),) since the last call, oldest first."""
        with self._lock:
            rows = list(self._unread)
            self._unread.clear()
            return rows

    def curve(self) -> np.ndarray:
        """Rows (n, len(COLUMNS)), n <= POINTS, evenly thinned, of the last `CURVE_S` seconds;
        between observations the ball's last position stands.
        """
        with self._lock:
            return np.array(self._curve).reshape(-1, len(COLUMNS))  # none, when a run begins

    def trail(self) -> np.ndarray:
        """The last observations of the ball (n, 2) [m], n <= TRAIL, oldest first."""
        with self._lock:
            return np.array(self._trail).reshape(-1, 2)
