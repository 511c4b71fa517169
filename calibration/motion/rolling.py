"""The ball's motion against the encoders: level, backlash of the joint, and the camera's delay.

With the plate at sin(phi) = ratio sin(theta_p), theta_p the servo angle behind the joint's
backlash, the ball's centre obeys x'' + r phi'' = k g (sin(phi) + slope) but for terms of second
order in the tilt. In a window of a second the encoder gives everything but the start; integrated
twice,

    x(t) + r phi(t) = x0 + v0 t + c J(t) + b t^2/2,   J'' = sin(theta_p),  c = k g ratio,
    b = k g slope,

which is linear in x0, v0 (each window's), c and b; x0 and v0 are projected out. The width of the
backlash and the lateness of the ball's time stamps minimise what is left (nonlinear least squares).
Standard deviations are those of clusters, one a window (`calibration.statistics`).
"""

from dataclasses import dataclass
from math import inf

import numpy as np
from scipy.optimize import least_squares

from calibration.camera.sheet import CalibrationError
from calibration.statistics import clustered_covariance
from rig.compiled import compiled
from rig.control.tick import RUN
from rig.log import Log
from rig.parameters import Rig
from rig.plant.shaft import play_operator

# Chosen: so short that speed errors hardly grow, so long that level and gain are told apart.
WINDOW_S, _MIN_FRAMES, _MIN_WINDOWS = 1.0, 12, 8
_MOST_BACKLASH_RAD = 0.12


@dataclass(frozen=True, eq=False)
class Rolling:
    """One axis of a run: encoder times `t_s` and servo angles `theta_rad` (n,); times of the ball's
    exposures `seen_s` and its places `x_m` in the plate frame (m,)."""

    t_s: np.ndarray
    theta_rad: np.ndarray
    seen_s: np.ndarray
    x_m: np.ndarray


@dataclass(frozen=True)
class RollingFit:
    """(Value, standard deviation) of the level's slope [rad], the gain c [m/s2 per rad], the
    backlash's full width [rad] and the lateness of the ball's time stamps [s]; rms of the residual
    [m]; number of windows."""

    slope_rad: tuple[float, float]
    gain_m_s2: tuple[float, float]
    backlash_rad: tuple[float, float]
    late_s: tuple[float, float]
    rms_m: float
    windows: int

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the scatter between windows: windows less the 4 parameters."""
        return self.windows - 4


@compiled
def _behind(theta, half, out):
    plate = theta[0]
    for i in range(theta.shape[0]):
        plate = play_operator(plate, theta[i], half, -half)
        out[i] = plate


def behind_backlash(theta_rad: np.ndarray, width_rad: float) -> np.ndarray:
    """Angle (n,) [rad] of the plate behind a joint whose backlash has the full width `width_rad`,
    from the servo angle `theta_rad` (n,): the play operator (`rig.plant.shaft.play_operator`) from
    sample to sample. A negative width counts as 0."""
    out = np.empty(len(theta_rad))
    _behind(np.ascontiguousarray(theta_rad, float), 0.5 * max(width_rad, 0.0), out)
    return out


def rolling(log: Log, axis: int, delay_s: float = 0.0) -> Rolling:
    """One axis (0 x, 1 y) of the log's free run (phase RUN or later; the whole log if it has no
    phases). `delay_s`: the camera's delay, as in `Log.ball`.

    `CalibrationError`: the run is too short, servo angle or ball are missing, or the ball was
    pushed.
    """
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
    """Fit level, gain, backlash and lateness of one axis to one or several runs: the module's
    equation by least squares in windows of a second.

    `late`: fit the lateness of the time stamps, too; otherwise it is 0 with an infinite standard
    deviation. `CalibrationError`: under 8 windows, or in some run a servo that moved by under 0.05
    rad.
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

    def left(p: np.ndarray) -> np.ndarray:
        return 1e3 * _residual(made, p[0], p[1] if late else 0.0)

    starts = [(width, 0.0) for width in (0.002, 0.02, 0.05)]
    bounds = ([0.0, -0.05], [_MOST_BACKLASH_RAD, 0.15])
    fits = [
        least_squares(left, start, bounds=bounds, x_scale=(0.01, 0.005), diff_step=1e-3)
        for start in starts
    ]
    best = min(fits, key=lambda fit: fit.cost)
    return _with_deviations(made, best.x, rig, late)


class _Windows:
    """One run cut into windows of a second with enough frames; `spans`: their frames."""

    def __init__(self, run: Rolling, rig: Rig) -> None:
        self.run, self.rig = run, rig
        self.spans: list[tuple[int, int]] = []
        begin = run.seen_s[0]
        while begin + WINDOW_S <= run.seen_s[-1]:
            i, j = np.searchsorted(run.seen_s, (begin, begin + WINDOW_S))
            if j - i >= _MIN_FRAMES and np.isfinite(run.x_m[i:j]).all():
                self.spans.append((int(i), int(j)))
            begin += WINDOW_S

    def design(self, width_rad: float, late_s: float) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Of each window the columns (k, 2) J and t^2/2 and the left side (k,), without what x0
        and v0 explain."""
        run, ratio = self.run, self.rig.linkage.ratio
        plate = np.sin(behind_backlash(run.theta_rad, width_rad))
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


def _columns(made: list[_Windows], width: float, late: float) -> tuple[np.ndarray, np.ndarray]:
    """Columns (m, 2) of (c, b) and the left side (m,) of all windows."""
    parts = [one.design(width, late) for one in made]
    columns = np.concatenate([window for part in parts for window in part[0]])
    sides = np.concatenate([window for part in parts for window in part[1]])
    return columns, sides


def _residual(made: list[_Windows], width: float, late: float) -> np.ndarray:
    """What the best (c, b) leave at this width and lateness, (m,)."""
    columns, sides = _columns(made, width, late)
    return sides - columns @ np.linalg.lstsq(columns, sides)[0]


def _with_deviations(made: list[_Windows], best: np.ndarray, rig: Rig, late: bool) -> RollingFit:
    """The fit at `best` (width, lateness), with standard deviations from the scatter between
    windows. The slope is ratio b/c, its deviation by first-order propagation."""
    width, lateness = float(best[0]), float(best[1]) if late else 0.0
    columns, sides = _columns(made, width, lateness)
    found = np.linalg.lstsq(columns, sides)[0]
    residual, step = sides - columns @ found, 1e-4

    def change(more_width: float, more_late: float) -> np.ndarray:
        moved, its_sides = _columns(made, width + more_width, lateness + more_late)
        return ((its_sides - moved @ found) - residual) / step

    derivatives = [change(step, 0.0)] + ([change(0.0, step)] if late else [])
    jacobian = np.column_stack((-columns, *derivatives))
    sizes = [j - i for one in made for i, j in one.spans]
    windows = np.repeat(np.arange(len(sizes)), sizes)
    covariance = clustered_covariance(jacobian, residual, windows)
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    c, b = (float(value) for value in found)
    ratio = rig.linkage.ratio
    return RollingFit(
        slope_rad=(ratio * b / c, ratio * float(np.hypot(std[1] / c, b * std[0] / c**2))),
        gain_m_s2=(c, float(std[0])),
        backlash_rad=(width, float(std[2])),
        late_s=(lateness, float(std[3]) if late else inf),
        rms_m=float(np.sqrt(np.mean(residual**2))),
        windows=len(sizes),
    )
