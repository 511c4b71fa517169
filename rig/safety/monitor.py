"""A watch over a run's readings: a pure function from tick to tick that names what went wrong.

`check` takes the monitor's state and the newest reading; it gives the next state and, where the run
must end, a `Fault`. Where the encoders cannot be trusted any more, levelling by them would be a
second accident: such a fault asks for 0 V at once (`level` False).
"""

from dataclasses import dataclass, replace
from math import copysign, inf, isfinite, log1p, sqrt

from rig.parameters import ANGLE_MARGIN_RAD, Rig, Servo
from rig.safety.follow_watch import FollowLimits, FollowWatch, watch_following
from rig.safety.motion_watch import (
    PLAY_RAD,
    UNKNOWN,
    Both,
    MotionLimits,
    MotionWatch,
    is_overdue,
    sure_volts,
    watch_motion,
    way_of,
)
from rig.table import Reading

MISSED = 0.9  # of a period late: a tick was missed
BLOCKED = "is it blocked, unplugged, reversed?"


@dataclass(frozen=True)
class MonitorLimits:
    """What a healthy table never does; a reading beyond these limits is a fault.

    period_s: of the tick. Between two readings no arm turns faster than rate_rad_s, but for
    noise_rad; beyond angle_rad it runs away; under volts of one sign above stall_V it moves their
    way by stall_rad within stall_s. unseen_s: longest time without a newer exposure while the ball
    is balanced; old_s: largest age of an observation; late_s: latest tick; late_ticks: number of
    missed ticks that is a fault, of which each tick in time makes good late_share; measured: the
    angles are, else they are no numbers; motion: which weaker volts move an arm, None: not known;
    follow: how one that is told an angle goes there, None: nothing tells that.
    """

    period_s: float
    rate_rad_s: float
    noise_rad: float
    angle_rad: float
    stall_V: float = 2.0
    stall_s: float = 0.08
    stall_rad: float = 0.004
    unseen_s: float = 1.25
    old_s: float = 0.5
    late_s: float = 0.1
    late_share: float = 0.05
    late_ticks: float = 25.0
    measured: bool = True
    motion: MotionLimits | None = None
    follow: FollowLimits | None = None

    @classmethod
    def of_rig(cls, rig: Rig, breakaway_V: tuple[Both, ...] = ()) -> "MonitorLimits":
        """Return the limits of a rig's table; breakaway_V: of its homing, () where unknown."""
        return cls.of_servo(rig.servo, 1 / rig.control_rate_hz, sure_volts(rig, breakaway_V))

    @classmethod
    def of_servo(
        cls, servo: Servo, period_s: float, sure_V: tuple[Both, Both] = UNKNOWN
    ) -> "MonitorLimits":
        """Return the limits of a table with these servos, period_s: of its tick; sure_V: as of
        `sure_volts`.

        Its servos turn at most at twice their no-load speed at the voltage limit, or at twice the
        rate limit of servos that take an angle, which no volts can stall; its angles lie within the
        angle limit plus ANGLE_MARGIN_RAD, beyond which the simulated loop ends a run as well.
        Under stall_V such a servo, tau w' = K V - w, has turned round from its top speed K V_max
        after tau ln(1 + V_max / stall_V). From then on it goes K V (t - tau (1 - e^(-t/tau))),
        at least K V t^2 / (2 tau + t): a way s within tau (q + sqrt(q^2 + 8 q)) / 2 with
        q = s / (K V tau). stall_s is as long for the play of the gear and the least motion that
        its encoder tells from a step, and 80 ms for servos that are faster (tau below 24 ms).
        """
        fastest, told = servo.gain_rad_s_V * servo.voltage_limit_V, servo.takes_angle
        if told:
            fastest = max(servo.pair("rate_limit_rad_s"))
        moved_rad, _ = way_of(servo.encoder_step_rad)
        tau_s, way_rad = servo.time_constant_s, PLAY_RAD + moved_rad + servo.encoder_step_rad
        q = way_rad / (servo.gain_rad_s_V * cls.stall_V * tau_s)
        late_s = tau_s * (
            log1p(servo.voltage_limit_V / cls.stall_V) + (q + sqrt(q * q + 8 * q)) / 2
        )
        return cls(
            period_s=period_s,
            rate_rad_s=2 * fastest,
            noise_rad=4 * servo.encoder_step_rad,
            angle_rad=servo.angle_limit_rad + ANGLE_MARGIN_RAD,
            stall_V=inf if told else cls.stall_V,
            stall_s=max(cls.stall_s, late_s + period_s),
            stall_rad=moved_rad,
            measured=servo.has_angle,
            motion=None if told else MotionLimits.of_servo(servo, sure_V),
            follow=FollowLimits.of_servo(servo) if told and servo.has_angle else None,
        )


@dataclass(frozen=True)
class Fault:
    """Why a run must end: its outcome `name` and a `reason` for a person.

    level: whether the plate may be levelled by its encoders; where not, 0 V at once. axis: the one
    whose encoder is no longer to be trusted, the other's may be; None: both.
    """

    name: str
    reason: str
    level: bool = True
    axis: int | None = None


@dataclass(frozen=True)
class StallWatch:
    """One axis under strong volts.

    sign: of the volts (0: they are not strong); theta_rad: where the arm was last seen to make
    progress or to fall back; since_s: when it last moved the way of the volts.
    """

    sign: float = 0.0
    theta_rad: float = 0.0
    since_s: float = 0.0


@dataclass(frozen=True)
class MonitorState:
    """What the monitor keeps from tick to tick.

    t_s, theta_rad: of the last reading (-inf before the first); pushes, motions, follows: by axis;
    exposed_s: newest exposure; seen_s: time of the reading that brought it; missed: missed ticks,
    less late_share for each tick in time; late_s: lateness of the last tick.
    """

    t_s: float = -inf
    theta_rad: tuple[float, float] = (0.0, 0.0)
    pushes: tuple[StallWatch, StallWatch] = (StallWatch(), StallWatch())
    motions: tuple[MotionWatch, MotionWatch] = (MotionWatch(), MotionWatch())
    follows: tuple[FollowWatch, FollowWatch] = (FollowWatch(), FollowWatch())
    exposed_s: float = -inf
    seen_s: float = -inf
    missed: float = 0.0
    late_s: float = 0.0


def check(
    state: MonitorState,
    limits: MonitorLimits,
    reading: Reading,
    volts: tuple[float, float],
    *,
    balancing: bool,
    late_s: float = 0.0,
) -> tuple[MonitorState, Fault | None]:
    """Return the next state, and the fault that ends the run (None: all is well).

    volts: applied from the last reading to this one, or angles told; balancing: the ball is needed;
    late_s: how late the loop came to this tick by the wall clock, where no reading tells.
    """
    first = state.t_s == -inf
    step_s = limits.period_s if first else reading.t_s - state.t_s
    late_s = max(late_s, step_s - limits.period_s)
    fault = _no_number(reading, limits) or _time(state, limits, step_s, late_s)
    fault = fault or _angles(
        reading.theta_rad if first else state.theta_rad, limits, reading, step_s
    )
    if fault is not None:
        if fault.level:  # the reading is one to go on from
            state = replace(state, t_s=reading.t_s, theta_rad=reading.theta_rad)
        return replace(state, late_s=late_s), fault
    missed = late_s > MISSED * limits.period_s
    pushes = [
        watch_stall(state.pushes[a], limits, volts[a], reading.theta_rad[a], reading.t_s)
        for a in (0, 1)
    ]
    after = replace(
        _seen(state, reading, balancing),
        t_s=reading.t_s,
        theta_rad=reading.theta_rad,
        pushes=(pushes[0], pushes[1]),
        motions=_motions(state, limits, reading, volts, step_s),
        follows=_follows(state, limits, reading, volts, step_s),
        missed=state.missed + 1.0 if missed else max(0.0, state.missed - limits.late_share),
        late_s=late_s,
    )
    fault = _stall(after, limits, volts) or _still(after, limits) or _left(after, limits)
    fault = fault or _lost(reading)
    return after, fault or _camera(after, limits, reading, balancing)


def check_step(before: Reading | None, limits: MonitorLimits, reading: Reading) -> Fault | None:
    """Return the fault of a reading by itself, and by the one before it (None: it is the first)."""
    before, first = before or reading, before is None
    step_s = limits.period_s if first else reading.t_s - before.t_s
    fault = _no_number(reading, limits) or _clock(before.t_s, step_s)
    return fault or _angles(before.theta_rad, limits, reading, step_s)


def without(reading: Reading, axis: int, state: MonitorState) -> tuple[Reading, MonitorState]:
    """The reading as if the arm of `axis`, whose encoder is lost and which gets 0 V, stood still,
    and the state in which nothing is held against it.
    """
    pushes, motions, theta = list(state.pushes), list(state.motions), list(reading.theta_rad)
    pushes[axis], motions[axis], theta[axis] = StallWatch(), MotionWatch(), state.theta_rad[axis]
    watched = replace(state, pushes=(pushes[0], pushes[1]), motions=(motions[0], motions[1]))
    return replace(reading, theta_rad=(theta[0], theta[1])), watched


def check_command(x: float, y: float, unit: str = "V") -> Fault | None:
    """Return a fault where what is commanded, volts or angles, is not finite, else None.

    The controller has failed then; the limiter gives 0 V meanwhile, or the angle before.
    """
    if isfinite(x) and isfinite(y):
        return None
    return Fault("no number", f"the controller asked for {x} {unit} and {y} {unit}")


def _no_number(reading: Reading, limits: MonitorLimits) -> Fault | None:
    if not isfinite(reading.t_s):
        return Fault("no number", f"the table's time is {reading.t_s}", level=False)
    lost = [a for a in (0, 1) if not isfinite(reading.theta_rad[a])] if limits.measured else []
    if lost:
        axis = lost[0] if len(lost) == 1 else None
        return Fault("no number", f"the encoders gave {reading.theta_rad}", False, axis)
    ball = reading.ball
    if ball is not None and not all(map(isfinite, (*ball.xy_m, *ball.cov_m2, ball.exposed_s))):
        return Fault("no number", f"the camera gave {ball.xy_m} m at {ball.exposed_s} s")
    return None


def _clock(before_s: float, step_s: float) -> Fault | None:
    if step_s <= 0.0:
        return Fault("link silent", f"the table's time stands still at {before_s:.3f} s", False)
    return None


def _time(state: MonitorState, limits: MonitorLimits, step_s: float, late_s: float) -> Fault | None:
    if fault := _clock(state.t_s, step_s):
        return fault
    if late_s > limits.late_s:
        ms = 1e3 * late_s
        return Fault("late loop", f"a tick came {ms:.0f} ms late (limit {1e3 * limits.late_s:g})")
    if state.missed >= limits.late_ticks:
        share = 100 * limits.late_share
        words = f"more than {share:g} % of the ticks are missed: free the machine"
        return Fault("late loop", f"{words}, or check the table's cable")  # damaged, they miss, too
    return None


def _angles(
    before: tuple[float, float], limits: MonitorLimits, reading: Reading, step_s: float
) -> Fault | None:
    most = limits.rate_rad_s * step_s + limits.noise_rad
    for a, (old, new) in enumerate(zip(before, reading.theta_rad, strict=True)):
        if abs(new - old) > most:
            moved = f"servo {'xy'[a]} from {old:.3f} to {new:.3f} rad in {1e3 * step_s:.1f} ms"
            return Fault("encoder jump", f"{moved}: home again, check the cable", False, a)
    worst = max(map(abs, reading.theta_rad))
    if worst > limits.angle_rad:
        return Fault("limit", f"servo angle {worst:.2f} rad is beyond the limit")
    return None


def watch_stall(
    before: StallWatch, limits: MonitorLimits, volts: float, theta_rad: float, t_s: float
) -> StallWatch:
    """Return the next state of one axis.

    `volts` of a new sign, or progress of stall_rad their way, begin the watch anew at t_s; a fall
    back moves its angle; else nothing changes.
    """
    sign = 0.0 if abs(volts) < limits.stall_V else copysign(1.0, volts)
    moved = sign * (theta_rad - before.theta_rad)
    if sign != before.sign or moved >= limits.stall_rad:
        return StallWatch(sign, theta_rad, t_s)
    return StallWatch(sign, theta_rad, before.since_s) if moved < 0.0 else before


def _stall(after: MonitorState, limits: MonitorLimits, volts: tuple[float, float]) -> Fault | None:
    for a, (one, volt) in enumerate(zip(after.pushes, volts, strict=True)):
        if one.sign != 0.0 and after.t_s - one.since_s > limits.stall_s:
            words = f"servo {'xy'[a]} does not follow {volt:.1f} V: {BLOCKED}"
            return Fault("stall", words, False, a)
    return None


def _motions(
    state: MonitorState,
    limits: MonitorLimits,
    reading: Reading,
    volts: tuple[float, float],
    step_s: float,
) -> tuple[MotionWatch, MotionWatch]:
    motion = limits.motion
    if motion is None:
        return state.motions
    x, y = (
        watch_motion(
            state.motions[a], motion, motion.sure_V[a], volts[a], reading.theta_rad[a], step_s
        )
        for a in (0, 1)
    )
    return x, y


def _still(after: MonitorState, limits: MonitorLimits) -> Fault | None:
    """An arm that stands still under volts that move it."""
    for a, one in enumerate(after.motions):
        if limits.motion is not None and is_overdue(one, limits.motion):
            up, down = limits.motion.sure_V[a]
            volt = up if one.up_rad > one.down_rad else -down
            words = f"servo {'xy'[a]} stands still under more than {volt:.1f} V: {BLOCKED}"
            return Fault("stall", words, False, a)
    return None


def _follows(
    state: MonitorState,
    limits: MonitorLimits,
    reading: Reading,
    told_rad: tuple[float, float],
    step_s: float,
) -> tuple[FollowWatch, FollowWatch]:
    follow, now = limits.follow, (reading.t_s, step_s)
    if follow is None:
        return state.follows
    x, y = (
        watch_following(state.follows[a], follow, told_rad[a], reading.theta_rad[a], *now)
        for a in (0, 1)
    )
    return x, y


def _left(after: MonitorState, limits: MonitorLimits) -> Fault | None:
    """A servo that is told an angle and stays where it is."""
    for a, one in enumerate(after.follows):
        if limits.follow is not None and after.t_s - one.since_s > limits.follow.patience_s:
            words = f"servo {'xy'[a]} stays at {one.theta_rad:.2f} rad, told elsewhere: {BLOCKED}"
            return Fault("stall", words, False, a)
    return None


def _lost(reading: Reading) -> Fault | None:
    return Fault("link lost", reading.lost) if reading.lost else None


def _seen(state: MonitorState, reading: Reading, balancing: bool) -> MonitorState:
    """A newer exposure came, or none is needed yet; an old one once more is nothing new."""
    if reading.ball is not None and reading.ball.exposed_s > state.exposed_s:
        return replace(state, exposed_s=reading.ball.exposed_s, seen_s=reading.t_s)
    return state if balancing and isfinite(state.seen_s) else replace(state, seen_s=reading.t_s)


def _camera(
    after: MonitorState, limits: MonitorLimits, reading: Reading, balancing: bool
) -> Fault | None:
    if not balancing:
        return None
    if reading.ball is not None and reading.t_s - reading.ball.exposed_s > limits.old_s:
        age_s = reading.t_s - reading.ball.exposed_s
        return Fault("camera stall", f"the camera's newest frame is {age_s:.2f} s old")
    unseen_s = reading.t_s - after.seen_s
    if unseen_s > limits.unseen_s:
        return Fault("camera stall", f"no new observation of the ball for {unseen_s:.2f} s")
    return None
