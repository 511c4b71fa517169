"""A ball's run against the encoders: level, play of the joint, and the camera's delay.

With the plate at sin(phi) = ratio sin(theta_p), theta_p the servo angle behind the joint's play,
the ball's centre obeys x'' + r phi'' = k g (sin(phi) + slope) but for terms of second order in the
tilt. In a window of a second everything but the start is known from the encoder: integrated twice,

    x(t) + r phi(t) = x0 + v0 t + c J(t) + b t^2/2,   J'' = sin(theta_p),  c = k g ratio,
    b = k g slope,

which is linear in x0, v0 (each window's), c and b. The play and the camera's delay are what makes
the residual smallest.
"""

from dataclasses import dataclass
from math import inf

import numpy as np
from scipy.optimize import least_squares

from calibration.backlash import behind_play
from calibration.sheet import CalibrationError
from rig.log import Log
from rig.parameters import Rig
from rig.pilot import RUN

WINDOW_S, _MIN_FRAMES, _MIN_WINDOWS = 1.0, 12, 8
_MOST_PLAY_RAD = 0.12


@dataclass(frozen=True, eq=False)
class Rolling:
    """One axis of a run: encoder t_s (n,), theta (n,); ball times (m,) and places (m,)."""

    t_s: np.ndarray
    theta_rad: np.ndarray
    seen_s: np.ndarray
    x_m: np.ndarray


@dataclass(frozen=True)
class RollingFit:
    """What a run tells: values and standard deviations of slope [rad], gain c [m/s2 per rad],
    play [rad] and lateness of the ball's time stamps [s]; rms of the residual [m]; windows used."""

    slope_rad: tuple[float, float]
    gain_m_s2: tuple[float, float]
    play_rad: tuple[float, float]
    late_s: tuple[float, float]
    rms_m: float
    windows: int


def rolling(log: Log, axis: int, delay_s: float = 0.0) -> Rolling:
    """One axis of a log's free run (where it has phases); `delay_s` as in `Log.ball`."""
    if log.has("phase"):
        log = log.where(log["phase"] >= RUN)
    if len(log) < 10:
        raise CalibrationError("the run is too short: it holds no free run of the ball")
    seen, xy = log.ball(delay_s)
    name = "xy"[axis]
    quiet = log["push"] > 0 if log.has("push") else np.zeros(len(log), bool)
    theta = log[f"theta_{name}_rad"]
    if np.isnan(theta).any() or not len(seen):
        raise CalibrationError(f"the run lacks the servo angle or the ball of axis {name}")
    if quiet.any():
        raise CalibrationError("the ball was pushed in this run: take one without pushes")
    return Rolling(log["t_s"], theta, seen, xy[:, axis])


def fit_rolling(runs: list[Rolling], rig: Rig, *, late: bool = True) -> RollingFit:
    """Fit one axis of one or several runs. `CalibrationError`: too little motion or data.

    `late`: whether the time stamps' lateness is fitted too, or taken as right.
    """
    made = [_Windows(run, rig) for run in runs]
    count = sum(len(one.spans) for one in made)
    if count < _MIN_WINDOWS:
        raise CalibrationError(
            f"{count} seconds with enough sightings of the ball, {_MIN_WINDOWS} are needed: "
            "record longer"
        )
    moved = min(float(np.ptp(run.theta_rad)) for run in runs)
    if moved < 0.05:
        raise CalibrationError(
            f"the servo moved by {moved:.3f} rad only, 0.05 are needed: lead the ball about"
        )

    def joint(p: np.ndarray) -> np.ndarray:
        return 1e3 * _joint(made, p[0], p[1] if late else 0.0)[0]

    starts = [(play, 0.0) for play in (0.002, 0.02, 0.05)]
    bounds = ([0.0, -0.05], [_MOST_PLAY_RAD, 0.15])
    fits = [
        least_squares(joint, start, bounds=bounds, x_scale=(0.01, 0.005), diff_step=1e-3)
        for start in starts
    ]
    best = min(fits, key=lambda fit: fit.cost)
    return _finish(made, best.x, rig, late)


class _Windows:
    """A run cut into windows; `design` gives their equations for a play and a lateness."""

    def __init__(self, run: Rolling, rig: Rig) -> None:
        self.run, self.rig = run, rig
        self.spans: list[tuple[int, int]] = []
        begin = run.seen_s[0]
        while begin + WINDOW_S <= run.seen_s[-1]:
            i, j = np.searchsorted(run.seen_s, (begin, begin + WINDOW_S))
            if j - i >= _MIN_FRAMES and np.isfinite(run.x_m[i:j]).all():
                self.spans.append((int(i), int(j)))
            begin += WINDOW_S

    def design(self, play_rad: float, late_s: float) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Each window's columns (J, t^2/2) without what x0 and v0 explain, and its left side."""
        run, ratio = self.run, self.rig.linkage.ratio
        plate = np.sin(behind_play(run.theta_rad, play_rad))
        period = np.diff(run.t_s)
        speed = np.concatenate(([0.0], np.cumsum(0.5 * (plate[1:] + plate[:-1]) * period)))
        place = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * period)))
        at = run.seen_s - late_s
        moved = np.interp(at, run.t_s, place)
        turned = self.rig.ball.radius_m * ratio * np.interp(at, run.t_s, plate)
        columns, sides = [], []
        for i, j in self.spans:
            t = at[i:j] - at[i:j].mean()
            q, _ = np.linalg.qr(np.column_stack((np.ones_like(t), t)))
            wide = np.column_stack((moved[i:j], 0.5 * t * t, run.x_m[i:j] + turned[i:j]))
            wide = wide - q @ (q.T @ wide)
            columns.append(wide[:, :2])
            sides.append(wide[:, 2])
        return columns, sides


def _joint(made: list["_Windows"], play: float, late: float):
    """Residual of all windows, (c, b), and the columns, at this play and lateness."""
    parts = [one.design(play, late) for one in made]
    columns = np.concatenate([c for part in parts for c in part[0]])
    sides = np.concatenate([s for part in parts for s in part[1]])
    found, *_ = np.linalg.lstsq(columns, sides)
    return sides - columns @ found, found, parts


def _finish(made, best: np.ndarray, rig: Rig, late: bool) -> RollingFit:
    """Values with standard deviations from the windows' scatter (a sandwich by window)."""
    play, lateness = float(best[0]), float(best[1]) if late else 0.0
    residual, (c, b), parts = _joint(made, play, lateness)
    steps = (1e-4, 1e-4)
    ups = [
        _left(made, play + steps[0], lateness, c, b),
        _left(made, play, lateness + steps[1], c, b),
    ]
    base = _left(made, play, lateness, c, b)
    extra = [(up - base) / step for up, step in zip(ups, steps, strict=True)]
    columns = np.concatenate([col for part in parts for col in part[0]])
    jacobian = np.column_stack((-columns, *(extra if late else extra[:1])))
    sizes = [len(side) for part in parts for side in part[1]]
    normal = jacobian.T @ jacobian
    inverse = np.linalg.pinv(normal)
    meat, row = np.zeros_like(normal), 0
    for size in sizes:
        g = jacobian[row : row + size].T @ residual[row : row + size]
        meat, row = meat + np.outer(g, g), row + size
    n = len(sizes)
    cov = inverse @ meat @ inverse * n / max(n - jacobian.shape[1], 1)
    std = np.sqrt(np.maximum(np.diag(cov), 0.0))
    ratio = rig.linkage.ratio
    slope = ratio * b / c
    slope_std = ratio * float(np.hypot(std[1] / c, b * std[0] / c**2))
    return RollingFit(
        (slope, slope_std),
        (float(c), float(std[0])),
        (play, float(std[2])),
        (lateness, float(std[3]) if late else inf),
        float(np.sqrt(np.mean(residual**2))),
        n,
    )


def _left(made, play: float, late: float, c: float, b: float) -> np.ndarray:
    parts = [one.design(play, late) for one in made]
    columns = np.concatenate([col for part in parts for col in part[0]])
    sides = np.concatenate([side for part in parts for side in part[1]])
    return sides - columns @ (c, b)
