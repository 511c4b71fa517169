"""What the table did at each innovation: positions, speeds, reversals, volts, by channel."""

from collections.abc import Callable, Sequence

import numpy as np

from calibration.gap.locate.disturbances import Coordinate
from rig.compiled import compiled
from rig.prediction.innovations import Signals

TIME_BINS, POSITION_BINS, PLACE_BINS = 40, 12, 6
BALL_SPEED_M_S = np.array([0, 0.01, 0.02, 0.04, 0.06, 0.09, 0.13, 0.2, 0.3, 0.5, 1.0])
SERVO_SPEED_RAD_S = np.array([0, 0.1, 0.2, 0.4, 0.7, 1.0, 1.5, 2.5, 4.0, 6.0, 10.0])
VOLTS_V = np.array([0, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1, 1.5, 2, 3, 4, 5, 6, 8, 12, 24.0])
AFTER_S = np.array([0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5])
REVERSAL_SWINGS_RAD = (0.006, 0.02, 0.05)  # smallest swing back that counts as a reversal
SPEED_OVER_S, SPEED_FRAMES = 0.02, 3.0  # window of the slope, of a servo and of a ball


@compiled
def turns(angle: np.ndarray, swing: float) -> tuple[np.ndarray, np.ndarray]:
    """Samples at which `angle` (n,) has come back by `swing` from a turning point: index (k,), and
    the direction of motion since then (k,), +1 or -1. The first direction is no reversal.

    A reversal is dated when it is seen, not where it began: a sample depends on the past alone.
    """
    index, way = np.empty(len(angle), np.int64), np.empty(len(angle), np.int64)
    top, low, going, count = angle[0], angle[0], 0, 0
    for i in range(len(angle)):
        v = angle[i]
        top, low = max(top, v), min(low, v)
        turned = 0
        if going >= 0 and v <= top - swing:
            turned = -1
        elif going <= 0 and v >= low + swing:
            turned = 1
        if turned != 0:
            if going != 0:
                index[count], way[count] = i, turned
                count += 1
            going, top, low = turned, v, v
    return index[:count].copy(), way[:count].copy()


def since_reversal(
    t_s: np.ndarray, angle: np.ndarray, when_s: np.ndarray, swing: float
) -> tuple[np.ndarray, np.ndarray]:
    """Time (k,) [s] since the last reversal of `angle` (n,) before each of `when_s` (k,), NaN
    before the first one, and the direction since, +1 or -1 (0 before the first). `swing`: as in
    `turns`."""
    index, way = turns(angle, swing)
    if not len(index):
        return np.full(len(when_s), np.nan), np.zeros(len(when_s))
    last = np.searchsorted(t_s[index], when_s, side="right") - 1
    known = last >= 0
    last = np.maximum(last, 0)
    return np.where(known, when_s - t_s[index][last], np.nan), np.where(known, way[last], 0.0)


def slope(t_s: np.ndarray, x: np.ndarray, over_s: float) -> np.ndarray:
    """Backward difference quotient (n,) of x (n,) over the last `over_s` seconds, at least two
    samples."""
    if len(t_s) < 2:
        return np.zeros(len(t_s))
    now = np.arange(len(t_s))
    before = np.clip(np.searchsorted(t_s, t_s - over_s - 1e-6), 0, np.maximum(now - 1, 0))
    return (x - x[before]) / np.maximum(t_s - t_s[before], 1e-6)


def evenly(x: np.ndarray, parts: int) -> np.ndarray:
    """Even bin edges (parts + 1,) from -r to r, with r the 0.99 quantile of |x|."""
    x = x[np.isfinite(x)]
    reach = max(float(np.quantile(np.abs(x), 0.99)) if len(x) else 0.0, 1e-6)
    return np.linspace(-reach, reach, parts + 1)


def up_to(edges: np.ndarray, x: np.ndarray) -> np.ndarray:
    """The edges as far as |x| reaches (0.995 quantile), then infinity: the last bin is open."""
    x = np.abs(x[np.isfinite(x)])
    last = int(np.searchsorted(edges, np.quantile(x, 0.995) if len(x) else 0.0))
    return np.append(edges[: max(last, 1)], np.inf)


def by_run(edges: np.ndarray, starts_s: np.ndarray) -> np.ndarray:
    """The even edges (n + 1,) [s] of bins of time, moved so that no bin spans two runs;
    `starts_s` (r,): the runs' starts on the same axis, the first at the first edge."""
    starts, half = starts_s[1:], (edges[1] - edges[0]) / 2
    limits = np.concatenate([edges[[0, -1]], starts])
    far = np.abs(edges[:, None] - limits).min(axis=1) >= half
    return np.unique(np.concatenate([limits, edges[far]]))


def _placed(kind: str, axis: str, x: np.ndarray, parts: int = POSITION_BINS) -> Coordinate:
    edges = evenly(x, parts)
    return Coordinate(kind, axis, np.clip(x, edges[0], edges[-1]), edges)


def _timed(t_s: np.ndarray) -> list[Coordinate]:
    edges = np.linspace(t_s[0], t_s[-1] + 1e-9, TIME_BINS + 1)
    always = Coordinate("always", "", t_s, edges[[0, -1]])
    return [always, Coordinate("time", "", t_s, edges, whole=True)]


def _reversals(
    runs: Sequence[Signals], when: Callable[[Signals], np.ndarray], a: int
) -> list[Coordinate]:
    found = []
    for swing in REVERSAL_SWINGS_RAD:
        pairs = [since_reversal(r.t_s, r.theta_rad[:, a], when(r), swing) for r in runs]
        after, way = (np.concatenate(column) for column in zip(*pairs, strict=True))
        edges = np.append(AFTER_S, np.inf)
        found.append(Coordinate("reversal", "xy"[a], after, edges, way, anchored=True))
    return found


def of_ball(runs: Sequence[Signals], a: int, t_s: np.ndarray) -> list[Coordinate]:
    """The coordinates of the ball's channel `a` (0 x, 1 y); `t_s` (n,): times of its samples on the
    axis that runs on from run to run."""
    frame = float(np.median(np.concatenate([np.diff(r.exposed_s) for r in runs])))
    xy = np.concatenate([r.ball_m for r in runs])
    speed = np.concatenate([slope(r.exposed_s, r.ball_m[:, a], SPEED_FRAMES * frame) for r in runs])
    found = [*_timed(t_s), *_reversals(runs, lambda r: r.exposed_s, a)]
    found.append(
        Coordinate("speed", "xy"[a], np.abs(speed), up_to(BALL_SPEED_M_S, speed), np.sign(speed))
    )
    for b in (a, 1 - a):
        angle = [np.interp(r.exposed_s, r.t_s, r.theta_rad[:, b]) for r in runs]
        found += [_placed("position", "xy"[b], xy[:, b])]
        found += [_placed("angle", "xy"[b], np.concatenate(angle))]
    found.append(_turning(runs, a))
    place = [_placed("position", axis, xy[:, b], PLACE_BINS) for b, axis in enumerate("xy")]
    edges = evenly(xy.ravel(), PLACE_BINS)
    x, y = (
        Coordinate("place", c.axis, np.clip(c.value, edges[0], edges[-1]), edges) for c in place
    )
    return [*found, Coordinate("place", "x", x.value, edges, second=y)]


def _turning(runs: Sequence[Signals], a: int) -> Coordinate:
    """Speed of the servo as the ball was seen."""
    pairs = [(r, slope(r.t_s, r.theta_rad[:, a], SPEED_OVER_S)) for r in runs]
    speed = np.concatenate([np.interp(r.exposed_s, r.t_s, v) for r, v in pairs])
    return Coordinate(
        "turning", "xy"[a], np.abs(speed), up_to(SERVO_SPEED_RAD_S, speed), np.sign(speed)
    )


def of_servo(runs: Sequence[Signals], a: int, t_s: np.ndarray) -> list[Coordinate]:
    """The coordinates of the servo channel `a` (0 x, 1 y); `t_s` (n,) as in `of_ball`. Volts are
    those of the tick before."""
    angle = np.concatenate([r.theta_rad[:, a] for r in runs])
    speed = np.concatenate([slope(r.t_s, r.theta_rad[:, a], SPEED_OVER_S) for r in runs])
    axis = "xy"[a]
    found = [
        *_timed(t_s),
        *_reversals(runs, lambda r: r.t_s, a),
        Coordinate("speed", axis, np.abs(speed), up_to(SERVO_SPEED_RAD_S, speed), np.sign(speed)),
        _placed("position", axis, angle),
    ]
    if any(run.commanded for run in runs):  # nobody gives volts there
        return found
    volts = np.concatenate([np.append(r.volts_V[:1, a], r.volts_V[:-1, a]) for r in runs])
    levels = up_to(VOLTS_V, volts)
    return [*found, Coordinate("voltage", axis, np.abs(volts), levels, np.sign(volts))]
