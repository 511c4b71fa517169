"""One step ahead from measured signals: the innovations of a calibrated observer.

The table is a cascade with a measured middle: volts -> servo -> encoder -> plate -> ball -> camera.
So the servo's part predicts the encoder's next count from the volts, and the ball's part predicts
the next exposure from the *measured* encoder angles: servo-side and ball-side effects show in two
separate channels. Shafts are rigid here (a play is its operator); every effect is the compiled
equation that the simulator calls. With true parameters and no noise the innovations vanish with
the tick.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from rig.log import COMMANDS, Log
from rig.parameters import Rig
from rig.plant.plant_record import pack
from rig.plant.position_servo import THREE_ARMS, servos_at_level
from rig.prediction.ball import LONGEST_GAP_S, look_ahead, predict_ball
from rig.prediction.commanded import Answers, predict_told_arms, predict_told_axis
from rig.prediction.last_results import LastResults
from rig.prediction.servo import predict_axis

# The volts of a missing row are not known, and a servo predicted through many of them is taken to
# have been where it was not. One row is bridged: ticks of a recorder on a plain computer vary so.
HOLE_TICKS, USUAL = 2.5, 0.95  # chosen
NOISE = np.dtype(
    [
        ("servo_process", np.float64, (2,)),  # of the speed, rad/s/sqrt(s)
        ("servo_measured", np.float64, (2,)),  # of the encoder, rad
        ("ball_process", np.float64),  # of the velocity, m/s/sqrt(s)
        ("ball_measured", np.float64),  # of the camera, m
        ("ball_memory_s", np.float64),  # in which the camera's noise forgets itself; 0: white
    ]
)


@dataclass(frozen=True, eq=False)
class Signals:
    """What a log gives to predict from; a channel that it lacks is empty.

    t_s (n,): ticks; volts_V, theta_rad (n, 2): applied volts and encoder angles; exposed_s (k,),
    ball_m (k, 2): observations; fresh (k,), optional: true at exposures at which the ball's filter
    starts anew; driven: axes that have a servo channel (the volts of the others are taken as 0);
    corrected (n,), optional: true at ticks whose angles correct the servos' filters (None: all);
    resumed (n,), optional: true at ticks before which rows are missing (`after_holes`), where the
    servos' angles are taken as they are read;
    told_rad (n, 2), optional: angles told to servos that take them and whose angle nobody measures;
    the ball is then predicted from their answer, and theta_rad is no more than a guess of it;
    answered: the last of these answers; tilts: the last innovations of a plate on three arms, which
    both axes share; commanded: the servos read their angle back, and `volts_V`
    holds the angles that they are told [rad] (`read_back`); repeats, outliers: exposures that are
    left out because they tell a place again to the last digit, or one where the ball cannot be.
    """

    t_s: np.ndarray
    volts_V: np.ndarray
    theta_rad: np.ndarray
    exposed_s: np.ndarray
    ball_m: np.ndarray
    fresh: np.ndarray | None = None
    driven: tuple[bool, bool] = (True, True)
    corrected: np.ndarray | None = None
    resumed: np.ndarray | None = None
    told_rad: np.ndarray | None = None
    answered: Answers = field(default_factory=Answers)
    tilts: LastResults = field(default_factory=LastResults)
    commanded: bool = False
    repeats: int = 0
    outliers: int = 0

    def angles(self, p: np.record) -> tuple[np.ndarray, np.ndarray]:
        """Times (m,) [s] and servo angles (m, 2) [rad] for the ball: measured, or the answer to the
        commands under the model p (record PLANT)."""
        if self.told_rad is None:
            return self.t_s, self.theta_rad
        return self.answered.of(p, self.t_s, self.told_rad)

    def has_servo(self, a: int) -> bool:
        """Whether volts and angle of axis `a` are there in every row, and the axis is driven."""
        return self._servos[a]

    @cached_property
    def ball_at_ticks_m(self) -> np.ndarray:
        """Places of the ball at the ticks (n, 2) [m], between two exposures on a line; 0 where none
        is near."""
        found = np.zeros((len(self.t_s), 2))
        seen = np.isfinite(self.ball_m).all(axis=1)
        t_s, ball_m = self.exposed_s[seen], self.ball_m[seen]
        if len(t_s):
            at = np.clip(np.searchsorted(t_s, self.t_s), 1, max(len(t_s) - 1, 1))
            ends = t_s[at - 1], t_s[np.minimum(at, len(t_s) - 1)]
            far_s = np.minimum(*(np.abs(self.t_s - end) for end in ends))
            for a in (0, 1):
                found[:, a] = np.interp(self.t_s, t_s, ball_m[:, a]) * (far_s < LONGEST_GAP_S)
        return found

    @cached_property
    def _servos(self) -> tuple[bool, bool]:
        n, pair = len(self.t_s), (self.volts_V, self.theta_rad)
        there = [
            n > 1 and all(len(p) == n and bool(np.isfinite(p[:, a]).all()) for p in pair)
            for a in (0, 1)
        ]
        return self.driven[0] and there[0], self.driven[1] and there[1]


def signals(log: Log, *, camera_delay_s: float) -> Signals:
    """Return the signals of a log; `camera_delay_s` dates observations without `ball_exposed_s`.

    Where nobody measured an angle, the ball on an axis that was told none is left out.
    """
    exposed, ball = log.ball(camera_delay_s)
    pair = [np.column_stack([log[f"{n}_x_{u}"], log[f"{n}_y_{u}"]]) for n, u in _PAIRS]
    told = log.told() if np.isnan(pair[1]).all() else None
    if told is not None:
        ball[:, [not log.has(name) for name in COMMANDS]] = np.nan
    t_s = np.array(log["t_s"])
    resumed = after_holes(t_s)
    return Signals(t_s, pair[0], pair[1], exposed, ball, resumed=resumed, told_rad=told)


def after_holes(t_s: np.ndarray) -> np.ndarray:
    """True (n,) at ticks t_s (n,) [s] before which rows are missing: more than HOLE_TICKS of the
    longest usual tick, the USUAL quantile, after the last."""
    steps = np.diff(t_s, prepend=t_s[:1])
    return steps > HOLE_TICKS * np.quantile(steps[1:], USUAL) if len(t_s) > 1 else steps > 0.0


def read_back(log: Log, known: Signals) -> Signals:
    """The signals of a log whose servos take an angle: with the commands for volts, where the log
    has them and the angles that they led to."""
    told = log.told()
    if told is None or known.told_rad is not None:
        return known
    x, y = (log.has(name) for name in COMMANDS)
    return replace(known, volts_V=told, driven=(x, y), commanded=True)


_PAIRS = (("voltage", "V"), ("theta", "rad"))


@dataclass(frozen=True, eq=False)
class Innovations:
    """Measured minus predicted, NaN where there is no prediction, and its expected deviation.

    servo, servo_std (n, 2) [rad]; ball (k, 2), ball_std (k,) [m]. The standard deviations are those
    that the filters expect of the innovations.
    """

    servo: np.ndarray
    servo_std: np.ndarray
    ball: np.ndarray
    ball_std: np.ndarray


def noise(
    *,
    servo_process: float | tuple[float, float] = 0.2,
    servo_measured: float | tuple[float, float] = 4.4e-4,
    ball_process: float = 0.002,
    ball_measured: float = 3e-4,
    ball_memory_s: float = 0.0,
) -> np.record:
    """Return the noise levels of the filters (dtype NOISE).

    servo_process: random walk of the servos' speed [rad/s/sqrt(s)] and servo_measured: deviation of
    an encoder reading [rad], each for both axes or (x, y), the latter by default the rounding of
    4096 counts, 2 pi/4096/sqrt(12); ball_process: random walk of the ball's velocity [m/s/sqrt(s)];
    ball_measured: deviation of an observed coordinate [m], correlated over ball_memory_s.
    """
    record = np.zeros(1, NOISE)[0]
    record["servo_process"], record["servo_measured"] = servo_process, servo_measured
    record["ball_process"], record["ball_measured"] = ball_process, ball_measured
    record["ball_memory_s"] = ball_memory_s
    return record


def predict(rig: Rig, known: Signals, levels: np.record) -> Innovations:
    """Return the innovations of a log's signals under the model `rig`, effects included.

    levels: of `noise`. ValueError: effects that are not those of the catalogue.
    """
    p = pack(rig)
    servo = servo_innovations(
        p, known, levels, (rig.servo.gain_rad_s_V,) * 2, (rig.servo.time_constant_s,) * 2
    )
    return Innovations(*servo, *ball_innovations(p, known, levels))


def servo_innovations(
    p: np.record,
    known: Signals,
    levels: np.record,
    gain_rad_s_V: Sequence[float],
    time_constant_s: Sequence[float],
    axes: tuple[int, ...] = (0, 1),
) -> tuple[np.ndarray, np.ndarray]:
    """Return the encoder's innovations and their expected deviations, (n, 2) each [rad].

    p: record PLANT; levels: of `noise`; gain_rad_s_V and time_constant_s: of both servos; axes:
    those to predict. NaN on other axes, on those without a servo channel, in the first row and in
    the first one after a hole.
    """
    shape = known.theta_rad.shape
    out, std = np.full(shape, np.nan), np.full(shape, np.nan)
    rows = len(known.t_s), np.bool_
    corrected = np.ones(*rows) if known.corrected is None else known.corrected
    resumed = np.zeros(*rows) if known.resumed is None else known.resumed
    read = known.t_s, known.volts_V, known.theta_rad
    seen = [known.has_servo(a) for a in (0, 1)]
    arms = known.commanded and p["linkage"] == THREE_ARMS
    if arms and any(seen):
        told = np.array(seen), corrected, resumed
        both = _arms_innovations(p, known, levels, told, np.array(time_constant_s))
        out[:, axes], std[:, axes] = both[0][:, axes], both[1][:, axes]
    for a in axes:
        if not seen[a] or arms:
            continue
        if known.commanded:
            tau_s = time_constant_s[a]
            predict_told_axis(p, levels, a, *read, corrected, resumed, tau_s, out, std)
        else:
            motor = gain_rad_s_V[a], time_constant_s[a]
            seen_ball = known.ball_at_ticks_m
            predict_axis(p, levels, a, *read, seen_ball, corrected, resumed, *motor, out, std)
    return out, std


def _arms_innovations(
    p: np.record,
    known: Signals,
    levels: np.record,
    rows: tuple[np.ndarray, np.ndarray, np.ndarray],
    tau_s: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """As `servo_innovations`, of the tilts of a plate on three arms: `known.tilts`. rows: axes that
    were read (2,), ticks that correct and that resume (n,)."""
    read = known.t_s, known.volts_V, known.theta_rad

    def predicted() -> tuple[np.ndarray, np.ndarray]:
        out, std = np.full(known.theta_rad.shape, np.nan), np.full(known.theta_rad.shape, np.nan)
        predict_told_arms(p, levels, *read, *rows, tau_s, servos_at_level(p), out, std)
        return out, std

    key = b"".join(part.tobytes() for part in (p, levels, tau_s, *rows))
    return known.tilts.of(key, read, predicted)


def ball_innovations(
    p: np.record, known: Signals, levels: np.record
) -> tuple[np.ndarray, np.ndarray]:
    """Return the camera's innovations (k, 2) [m] and their expected deviations (k,) [m].

    p: record PLANT; levels: of `noise`. NaN in exposures without a prediction.
    """
    k = len(known.exposed_s)
    out, std = np.full((k, 2), np.nan), np.full(k, np.nan)
    if k:
        fresh = known.fresh if known.fresh is not None else np.zeros(k, np.bool_)
        predict_ball(
            p,
            levels,
            *known.angles(p),
            known.exposed_s,
            known.ball_m,
            fresh,
            LONGEST_GAP_S,
            out,
            std,
        )
    return out, std


def ball_ahead(
    p: np.record, known: Signals, levels: np.record, *, horizon_s: float = 1.0, every_s: float = 0.5
) -> tuple[np.ndarray, np.ndarray]:
    """Return errors (k, 2) [m] of positions predicted `horizon_s` ahead from the angles alone, and
    their deviations (k,) [m] as the filter expects them.

    p: record PLANT; levels: of `noise`; every_s: least distance of two predictions. Row i belongs
    to the exposure in which a prediction ends; NaN where none does.
    """
    k = len(known.exposed_s)
    errors, spread = np.full((k, 2), np.nan), np.full(k, np.nan)
    if k:
        fresh = known.fresh if known.fresh is not None else np.zeros(k, np.bool_)
        look_ahead(
            p,
            levels,
            *known.angles(p),
            known.exposed_s,
            known.ball_m,
            fresh,
            horizon_s,
            every_s,
            errors,
            spread,
        )
    return errors, spread


def servo_ahead(
    p: np.record,
    known: Signals,
    levels: np.record,
    gain_rad_s_V: Sequence[float],
    time_constant_s: Sequence[float],
    a: int,
    *,
    horizon_s: float = 1.0,
    every_s: float = 0.5,
) -> tuple[np.ndarray, np.ndarray]:
    """Return errors (n,) [rad] of axis `a`'s angle predicted `horizon_s` ahead from the volts
    alone, and their deviations (n,) [rad] as the filter expects them; arguments as of
    `servo_innovations` and `ball_ahead`.

    The filter is corrected for `horizon_s` before each prediction begins; none is made across a
    hole.
    """
    n = len(known.t_s)
    errors, spread = np.full(n, np.nan), np.full(n, np.nan)
    if not known.has_servo(a):
        return errors, spread
    since = known.t_s - known.t_s[0]
    holes = np.zeros(n, int) if known.resumed is None else np.cumsum(known.resumed)
    for shift in np.arange(0.0, 2.0 * horizon_s, every_s):
        part = (since - shift) // horizon_s
        blind = (part >= 0.0) & (part % 2.0 == 1.0)
        ends = np.flatnonzero(np.diff(blind.astype(int)) == -1) + 1
        begun = np.maximum(np.searchsorted(since, since[ends] - horizon_s) - 1, 0)
        ends = ends[holes[ends] == holes[begun]]
        masked = replace(known, corrected=~blind)
        out, std = servo_innovations(p, masked, levels, gain_rad_s_V, time_constant_s, (a,))
        errors[ends], spread[ends] = out[ends, a], std[ends, a]
    return errors, spread
