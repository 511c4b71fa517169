"""The ball's motion against the servos: level, backlash of the joint, and the camera's delay.

With the plate at sin(phi) = f(theta_p), f the linkage and theta_p the servo angle behind the
joint's backlash, the ball's centre obeys x'' + r phi'' = k g (sin(phi) + slope) but for terms of
second order in the tilt. In a window of a second the encoder gives everything but the start;
integrated twice,

    x(t) + r phi(t) = x0 + v0 t + c J(t) + b t^2/2,   J'' = f(theta_p)/ratio,  c = k g ratio,
    b = k g slope,

which is linear in x0, v0 (each window's), c and b; x0 and v0 are projected out. The width of the
backlash and the lateness of the ball's time stamps minimise what is left (nonlinear least squares).
Standard deviations are those of clusters, one a window (`calibration.statistics`).

Two things that no rig file tells look like a lateness, too: what slows the ball, x'' = ... - d x',
about the frequency w like one of -d/w^2 (5 ms for 0.05 1/s at 0.5 Hz), and the height h of the
ball's centre above the plate's pivot, h phi'' in place of r phi''. Fitted with the others they
make lateness and lag useless where the ball swings about one frequency; so d = 0 and h = r are
taken, and told is by how much d = DRAG_1_S and h = 0 move the lateness, with the lag where that is
fitted (to first order).

That holds the plate by the friction of its joints inside the play (theta_p is the play operator).
Where a heavy ball's weight overcomes that friction, m g ratio |x| > F, the joint rests on the
ball's side, theta_p = theta + alpha sgn(x).

Servos that take an angle may have nobody who measures it. Their answer to their commands by the
equations of `rig.plant.position_servo` then stands for the encoder, and their lag T may be fitted
with the others. A dead time of theirs and the camera's delay are one pure delay: the lateness.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf

import numpy as np
from scipy.optimize import least_squares

from calibration.camera.sheet import CalibrationError
from calibration.statistics import clustered_covariance
from rig.compiled import compiled
from rig.control.tick import RUN
from rig.linkage import THREE_ARMS
from rig.log import COMMANDS, Log
from rig.parameters import GRAVITY_M_S2, Rig
from rig.plant.plant_record import pack
from rig.plant.position_plant import felt_sines
from rig.plant.shaft import play_operator
from rig.prediction.commanded import answers
from rig.prediction.innovations import signals

# Chosen: so short that speed errors hardly grow, so long that level and gain are told apart.
WINDOW_S, _MIN_FRAMES, _MIN_WINDOWS = 1.0, 12, 8
_MOST_BACKLASH_RAD, _LONGEST_LAG_S = 0.12, 0.5
_LATE_S = (-0.15, 0.3)
_TOUCHED = 4.0  # times the median of the windows' residuals; chosen, since noise alone gives 1.5
DRAG_1_S = 0.05  # chosen: a rolling ball loses some percent of its speed in a second
_MIN_TILT = 0.009  # sine of the plate's tilt: 0.05 rad of the default table's servos
# Steps of the differences in width, lateness and lag; that of the lag is chosen so wide because a
# lag below the plant's step moves nothing, which a narrow one there takes for no knowledge of it.
_STEPS = (1e-4, 1e-4, 1.5e-2)


@dataclass(frozen=True, eq=False)
class Rolling:
    """One axis of a run: encoder times `t_s` and servo angles `theta_rad` (n,); times of the ball's
    exposures `seen_s` and its places `x_m` in the plate frame (m,); `axis`: 0 x, 1 y; `answer`:
    servo angles (n,) for a lag [s], where they follow from commands (None: they were measured)."""

    t_s: np.ndarray
    theta_rad: np.ndarray
    seen_s: np.ndarray
    x_m: np.ndarray
    axis: int = 0
    answer: Callable[[float], np.ndarray] | None = None


@dataclass(frozen=True)
class RollingFit:
    """(Value, standard deviation) of the level's slope [rad], the gain c [m/s2 per rad], the
    backlash's full width [rad], the lateness of the ball's time stamps [s] and the servo's lag [s];
    rms of the residual [m]; number of windows; lateness and lag together [s], which the ball tells
    where it does not part them; whether the ball's weight overcame the joint's friction; by how
    much `together_s` may be off, as one standard deviation, for what slows the ball and for its
    height above the pivot."""

    slope_rad: tuple[float, float]
    gain_m_s2: tuple[float, float]
    backlash_rad: tuple[float, float]
    late_s: tuple[float, float]
    rms_m: float
    windows: int
    together_s: tuple[float, float]
    lag_s: tuple[float, float] = (0.0, inf)
    loaded: bool = False
    together_off_s: float = 0.0

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the scatter between windows: windows less the 4 parameters."""
        return self.windows - 4


@compiled
def _under_load(theta, half, load, out):
    """The plate behind a joint that a load closes where it exceeds the friction, abs(load) > 1."""
    plate = theta[0]
    for i in range(theta.shape[0]):
        if load[i] > 1.0:
            plate = theta[i] + half
        elif load[i] < -1.0:
            plate = theta[i] - half
        else:
            plate = play_operator(plate, theta[i], half, -half)
        out[i] = plate


def behind_backlash(theta_rad: np.ndarray, width_rad: float) -> np.ndarray:
    """Angle (n,) [rad] of the plate behind a joint whose backlash has the full width `width_rad`,
    from the servo angle `theta_rad` (n,): the play operator (`rig.plant.shaft.play_operator`) from
    sample to sample. A negative width counts as 0."""
    out = np.empty(len(theta_rad))
    theta = np.ascontiguousarray(theta_rad, float)
    _under_load(theta, 0.5 * max(width_rad, 0.0), np.zeros_like(theta), out)
    return out


@compiled
def _sines(p, axis, theta, out):
    for i in range(theta.shape[0]):
        s_x, s_y = felt_sines(p, theta[i] * (1 - axis), theta[i] * axis)
        out[i] = s_x if axis == 0 else s_y


def rolling(log: Log, axis: int, delay_s: float = 0.0, rig: Rig | None = None) -> Rolling:
    """One axis (0 x, 1 y) of the log's free run (phase RUN or later; the whole log if it has no
    phases). `delay_s`: the camera's delay, as in `Log.ball`; `rig`: of servos that take an angle,
    whose answer stands for angles that nobody measured.

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
    commanded = rig is not None and rig.servo.takes_angle and np.isnan(theta).all()
    if commanded and not log.has(*COMMANDS):
        raise CalibrationError(
            f"the run holds neither the angle nor the commands of servo {name}: record "
            "command_x_rad and command_y_rad"
        )
    if not len(seen) or not (commanded or np.isfinite(theta).all()):
        raise CalibrationError(f"the run lacks the servo angle or the ball of axis {name}")
    if quiet.any():
        raise CalibrationError("the ball was pushed in this run: take one without pushes")
    if not commanded:
        return Rolling(log["t_s"], theta, seen, xy[:, axis], axis)
    assert rig is not None
    return _answered(log, axis, rig, Rolling(log["t_s"], theta, seen, xy[:, axis], axis))


def _answered(log: Log, axis: int, rig: Rig, run: Rolling) -> Rolling:
    """The run with its servo's answer to the commands in place of a measured angle."""
    told = signals(log, camera_delay_s=0.0).told_rad
    assert told is not None
    p = pack(rig)
    both = rig.linkage.kind == THREE_ARMS  # whose servos each take part in both tilts

    def answer(lag_s: float) -> np.ndarray:
        for a in (0, 1) if both else (axis,):
            p["lag_s"][a] = lag_s
        return answers(p, run.t_s, told)[1][:, axis]

    times, angles = answers(p, run.t_s, told)
    return replace(run, t_s=times, theta_rad=angles[:, axis], answer=answer)


def fit_rolling(
    runs: list[Rolling], rig: Rig, *, late: bool = True, lag: bool = False
) -> RollingFit:
    """Fit level, gain, backlash and lateness of one axis to one or several runs: the module's
    equation by least squares in windows of a second.

    `late`: fit the lateness of the time stamps, too; otherwise it is 0 with an infinite standard
    deviation. `lag`: fit the lag of servos whose angle nobody measured, likewise.
    `CalibrationError`: under 8 windows, or in some run a plate that was tilted by under 0.009.
    """
    made = [_Windows(run, rig) for run in runs]
    count = sum(len(one.spans) for one in made)
    if count < _MIN_WINDOWS:
        raise CalibrationError(
            f"{count} seconds with enough sightings of the ball, {_MIN_WINDOWS} are needed: "
            "record longer"
        )
    least = _MIN_TILT / rig.linkage.ratios[runs[0].axis]
    moved = min(float(np.ptp(run.theta_rad)) for run in runs)
    if moved < least:
        raise CalibrationError(
            f"the servo moved by {moved:.3f} rad only, {least:.2g} are needed: lead the ball about"
        )
    free = np.array((True, late, lag))
    best = _best(made, rig, free)
    if _leave_out_touched(made, best):
        best = _best(made, rig, free)
    return _with_deviations(made, best, free, rig)


def _best(made: list["_Windows"], rig: Rig, free: np.ndarray) -> np.ndarray:
    """(width, lateness, lag) that minimise what is left, those not `free` (3,) as they are."""
    own_lag = rig.servo.pair("lag_s")[made[0].run.axis]
    fixed = np.array((0.0, 0.0, own_lag))

    def full(p: np.ndarray) -> np.ndarray:
        whole = fixed.copy()
        whole[free] = p
        return whole

    lags = (own_lag, 0.5 * own_lag + 0.03) if free[2] else (own_lag,)
    starts = [np.array((width, 0.0, lag)) for width in (0.002, 0.02, 0.05) for lag in lags]
    bounds = np.array([(0.0, _MOST_BACKLASH_RAD), _LATE_S, (0.0, _LONGEST_LAG_S)])
    fits = [
        least_squares(
            lambda p: 1e3 * _residual(made, full(p)),
            start[free],
            bounds=tuple(bounds[free].T),
            x_scale=np.array((0.01, 0.005, 0.01))[free],
            diff_step=1e-3,
        )
        for start in starts
    ]
    return full(min(fits, key=lambda fit: fit.cost).x)


def _leave_out_touched(made: list["_Windows"], best: np.ndarray) -> bool:
    """Leave out windows in which a hand or the plate's rim moved the ball; whether there are any.

    Never more than half: then the model is wrong, not the windows.
    """
    columns, sides = _columns(made, best)
    found = np.linalg.lstsq(columns, sides)[0]
    ends = np.cumsum([j - i for one in made for i, j in one.spans])[:-1]
    rms = np.sqrt([np.mean(part**2) for part in np.split(sides - columns @ found, ends)])
    kept = iter(rms <= _TOUCHED * np.median(rms))
    before = len(rms)
    for one in made:
        one.spans = [span for span in one.spans if next(kept)]
    return sum(len(one.spans) for one in made) < before


class _Windows:
    """One run cut into windows of a second with enough frames; `spans`: their frames."""

    def __init__(self, run: Rolling, rig: Rig) -> None:
        self.run, self.rig, self._record = run, rig, pack(rig)
        self._theta, self._lag_s = run.theta_rad, rig.servo.pair("lag_s")[run.axis]
        seen = np.isfinite(run.x_m)
        self._ball = run.seen_s[seen], run.x_m[seen]
        torque = rig.ball.mass_kg * GRAVITY_M_S2 * rig.linkage.ratios[run.axis]
        self._load_1_m = torque / max(rig.drive.joint_friction_nm, 1e-9)
        self.loaded = bool(self._load_1_m * np.max(np.abs(run.x_m[seen]), initial=0.0) > 1.0)
        self.spans: list[tuple[int, int]] = []
        begin = run.seen_s[0]
        while begin + WINDOW_S <= run.seen_s[-1]:
            i, j = np.searchsorted(run.seen_s, (begin, begin + WINDOW_S))
            if j - i >= _MIN_FRAMES and np.isfinite(run.x_m[i:j]).all():
                self.spans.append((int(i), int(j)))
            begin += WINDOW_S

    def design(self, p: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Of each window the columns (k, 2) J and t^2/2 and the left side (k,), without what x0
        and v0 explain, at p = (width, lateness, lag)."""
        windows = self._motions(p)
        return [one[:, :2] for one in windows], [one[:, 2] for one in windows]

    def taken(self, p: np.ndarray) -> np.ndarray:
        """What the left sides would be more by (m, 2) with d = DRAG_1_S, and with h = 0."""
        return np.concatenate([one[:, 3:] for one in self._motions(p)])

    def _motions(self, p: np.ndarray) -> list[np.ndarray]:
        """Of each window J, t^2/2, the left side and the columns of `taken` (k, 5)."""
        run, ratio = self.run, self.rig.linkage.ratios[self.run.axis]
        if run.answer is not None and p[2] != self._lag_s:
            self._lag_s, self._theta = float(p[2]), run.answer(float(p[2]))
        plate = np.empty_like(run.t_s)
        behind = np.empty_like(self._theta)
        load = self._load_1_m * np.interp(run.t_s + p[1], *self._ball)
        _under_load(self._theta, 0.5 * max(p[0], 0.0), load, behind)
        _sines(self._record, run.axis, behind, plate)
        plate /= ratio
        period = np.diff(run.t_s)
        speed = np.concatenate(([0.0], np.cumsum(0.5 * (plate[1:] + plate[:-1]) * period)))
        place = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * period)))
        at = run.seen_s - p[1]
        moved = np.interp(at, run.t_s, place)
        turned = self.rig.ball.radius_m * ratio * np.interp(at, run.t_s, plate)
        windows = []
        for i, j in self.spans:
            t = at[i:j] - at[i:j].mean()
            q, _ = np.linalg.qr(np.column_stack((np.ones_like(t), t)))
            x, period = run.x_m[i:j], np.diff(t)
            way = np.concatenate(([0.0], np.cumsum(0.5 * (x[1:] + x[:-1]) * period)))
            wide = (moved[i:j], 0.5 * t * t, x + turned[i:j], DRAG_1_S * way, -turned[i:j])
            wide = np.column_stack(wide)
            windows.append(wide - q @ (q.T @ wide))
        return windows


def _columns(made: list[_Windows], p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns (m, 2) of (c, b) and the left side (m,) of all windows."""
    parts = [one.design(p) for one in made]
    columns = np.concatenate([window for part in parts for window in part[0]])
    sides = np.concatenate([window for part in parts for window in part[1]])
    return columns, sides


def _residual(made: list[_Windows], p: np.ndarray) -> np.ndarray:
    """What the best (c, b) leave at p = (width, lateness, lag), (m,)."""
    columns, sides = _columns(made, p)
    return sides - columns @ np.linalg.lstsq(columns, sides)[0]


def _with_deviations(
    made: list[_Windows], best: np.ndarray, free: np.ndarray, rig: Rig
) -> RollingFit:
    """The fit at `best` (width, lateness, lag), of which those `free` (3,) were fitted, with
    standard deviations from the scatter between windows. The slope is ratio b/c, its deviation by
    first-order propagation."""
    columns, sides = _columns(made, best)
    found = np.linalg.lstsq(columns, sides)[0]
    residual = sides - columns @ found

    def change(k: int) -> np.ndarray:
        moved, its_sides = _columns(made, best + _STEPS[k] * np.eye(3)[k])
        return ((its_sides - moved @ found) - residual) / _STEPS[k]

    derivatives = [change(int(k)) for k in np.flatnonzero(free)]
    jacobian = np.column_stack((-columns, *derivatives))
    sizes = [j - i for one in made for i, j in one.spans]
    windows = np.repeat(np.arange(len(sizes)), sizes)
    covariance = clustered_covariance(jacobian, residual, windows)
    fitted = np.concatenate(([True, True], free))
    std = np.full(5, inf)  # of c, b and what `best` holds
    std[fitted] = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    both = np.array((0.0, 0.0, 0.0, 1.0, 1.0))[fitted]
    together = float(np.sqrt(both @ covariance @ both))
    more = np.concatenate([one.taken(best) for one in made])
    c, b = (float(value) for value in found)
    ratio = rig.linkage.ratios[made[0].run.axis]
    return RollingFit(
        slope_rad=(ratio * b / c, ratio * float(np.hypot(std[1] / c, b * std[0] / c**2))),
        gain_m_s2=(c, float(std[0])),
        backlash_rad=(float(best[0]), float(std[2])),
        late_s=(float(best[1]), float(std[3])),
        rms_m=float(np.sqrt(np.mean(residual**2))),
        windows=len(sizes),
        together_s=(float(best[1] + best[2]), together if free[1] else inf),
        lag_s=(float(best[2]), float(std[4])),
        loaded=any(one.loaded for one in made),
        together_off_s=float(np.hypot(*(both @ np.linalg.lstsq(jacobian, more)[0]))),
    )
