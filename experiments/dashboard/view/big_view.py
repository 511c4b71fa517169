"""What the big view tells of the live table: numbers and curves as JSON holds them."""

from typing import Any

import numpy as np

from experiments.dashboard.session.live import LiveState
from experiments.dashboard.session.plan import METHOD_WORDS, SessionStatus
from rig.log import INDEX
from rig.parameters import Rig

POINTS = 200  # of a curve; chosen: a screen shows no more
RMS_S = 10.0
UNSEEN_S = 0.3  # an older sight of the ball is not shown
RESTING = ("at rest", "stopped")  # states in which what was seen last is no longer so
_T, _BALL, _TARGET = (INDEX[name] for name in ("t_s", "ball_x_m", "target_x_m"))


def big_view(rig: Rig, now: LiveState, status: SessionStatus, curve: np.ndarray) -> dict[str, Any]:
    """The table's state for `server/view.js`: lengths in m, times in s, None for what is unknown.

    now, curve (n, len(COLUMNS)): of the `LiveBuffer`; the root mean square of the ball's distance
    from its target is that of the last RMS_S seconds of the curve. A table that rests has no ball.
    """
    row, run = now.row, status.run
    target = None if row is None else _place(row[_TARGET : _TARGET + 2])
    rests = status.state in RESTING
    seen = row is not None and row[_T] - now.seen_s < UNSEEN_S and not rests
    thin = curve[:: max(1, -(-len(curve) // POINTS))]
    does = status.of or ("stopped" if rests else status.state)
    words = f"run {run.number} of {run.of}, {METHOD_WORDS[run.method]}" if run else does
    return {
        "side_m": rig.linkage.side_m,
        "radius_m": rig.ball.radius_m,
        "ball_m": _place(row[_BALL : _BALL + 2]) if row is not None and seen else None,
        "target_m": target or [0.0, 0.0],
        "rms_m": None if rests else _rms_m(curve),
        "run": words,
        "title": run.plan.protocol.title if run else "",
        "t_s": status.t_s if run else None,
        "duration_s": status.duration_s if run else None,
        "ask": status.operator_step,
        "curve": {
            "t_s": _numbers(thin[:, _T]),
            "x_m": _numbers(thin[:, _BALL]),
            "y_m": _numbers(thin[:, _BALL + 1]),
        },
    }


def _place(xy_m: np.ndarray) -> list[float] | None:
    return [round(float(v), 5) for v in xy_m] if np.isfinite(xy_m).all() else None


def _numbers(values: np.ndarray) -> list[float | None]:
    return [round(float(v), 5) if np.isfinite(v) else None for v in values]


def _rms_m(curve: np.ndarray) -> float | None:
    if not len(curve):
        return None
    newest = curve[curve[:, _T] > curve[-1, _T] - RMS_S]
    target = np.nan_to_num(newest[:, _TARGET : _TARGET + 2])
    off = newest[:, _BALL : _BALL + 2] - target
    off = off[np.isfinite(off).all(axis=1)]
    return round(float(np.sqrt(np.mean(np.sum(off**2, axis=1)))), 6) if len(off) else None
