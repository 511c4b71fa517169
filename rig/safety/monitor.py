"""A watch over a run's readings: a pure function from tick to tick that names what went wrong.

`check` takes the monitor's state and the newest reading; it gives the next state and, where the run
must end, a `Fault`. Where the encoders cannot be trusted any more, levelling by them would be a
second accident: such a fault asks for 0 V at once (`level` False).
"""

from dataclasses import dataclass, replace
from math import copysign, inf, isfinite, log1p, sqrt

from rig.parameters import ANGLE_MARGIN_RAD, Rig, Servo
from rig.table import Reading

MISSED = 0.9  # of a period late: a tick was missed


@dataclass(frozen=True)
class MonitorLimits:
    """What a healthy table never does; a reading beyond these limits is a fault.

    period_s: of the tick. Between two readings no arm turns faster than rate_rad_s, but for
    noise_rad; beyond angle_rad it runs away; under volts of one sign above stall_V it moves their
    way by stall_rad within stall_s. unseen_s: longest time without a newer exposure while the ball
    is balanced; old_s: largest age of an observation; late_s: latest tick; late_ticks: number of
    missed ticks that is a fault, of which each tick in time makes good late_share; measured: the
    angles are, else they are no numbers.
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

    @classmethod
    def of_rig(cls, rig: Rig) -> "MonitorLimits":
        """Return the limits of a rig's table."""
        return cls.of_servo(rig.servo, 1 / rig.control_rate_hz)

    @classmethod
    def of_servo(cls, servo: Servo, period_s: float) -> "MonitorLimits":
        """Return the limits of a table with these servos, period_s: of its tick.

        Its servos turn at most at twice their no-load speed at the voltage limit, or at twice the
        rate limit of servos that take an angle, which no volts can stall; its angles lie within the
        angle limit plus ANGLE_MARGIN_RAD, beyond which the simulated loop ends a run as well.
        Under stall_V such a servo, tau w' = K V - w, has turned round from its top speed K V_max
        after tau ln(1 + V_max / stall_V), and gone stall_rad sqrt(2 tau stall_rad / (K stall_V))
        later at most: stall_s is as long, and 80 ms for servos that are faster (tau below 50 ms).
        """
        fastest = servo.gain_rad_s_V * servo.voltage_limit_V
        if servo.takes_angle:
            fastest = max(servo.pair("rate_limit_rad_s"))
        tau_s, weak_rad_s = servo.time_constant_s, servo.gain_rad_s_V * cls.stall_V
        round_s = tau_s * log1p(servo.voltage_limit_V / cls.stall_V)
        return cls(
            period_s=period_s,
            rate_rad_s=2 * fastest,
            noise_rad=4 * servo.encoder_step_rad,
            angle_rad=servo.angle_limit_rad + ANGLE_MARGIN_RAD,
            stall_V=inf if servo.takes_angle else cls.stall_V,
            stall_s=max(cls.stall_s, round_s + sqrt(2 * tau_s * cls.stall_rad / weak_rad_s)),
            measured=servo.has_angle,
        )


@dataclass(frozen=True)
class Fault:
    """Why a run must end: its outcome `name` and a `reason` for a person.

    level: whether the plate may be levelled by its encoders; where not, 0 V at once.
    """

    name: str
    reason: str
    level: bool = True


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

    t_s, theta_rad: of the last reading (-inf before the first); pushes: by axis; exposed_s: newest
    exposure; seen_s: time of the reading that brought it; missed: missed ticks, less late_share for
    each tick in time; late_s: lateness of the last tick.
    """

    t_s: float = -inf
    theta_rad: tuple[float, float] = (0.0, 0.0)
    pushes: tuple[StallWatch, StallWatch] = (StallWatch(), StallWatch())
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

    volts: applied from the last reading to this one; balancing: the ball is needed; late_s: how
    late the loop came to this tick by the wall clock, where the readings' times do not tell.
    """
    first = state.t_s == -inf
    step_s = limits.period_s if first else reading.t_s - state.t_s
    late_s = max(late_s, step_s - limits.period_s)
    fault = _no_number(reading, limits) or _time(state, limits, step_s, late_s)
    fault = fault or _angles(
        reading.theta_rad if first else state.theta_rad, limits, reading, step_s
    )
    if fault is not None:
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
        missed=state.missed + 1.0 if missed else max(0.0, state.missed - limits.late_share),
        late_s=late_s,
    )
    return after, _stall(after, limits, volts) or _camera(after, limits, reading, balancing)


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
    if limits.measured and not all(map(isfinite, reading.theta_rad)):
        return Fault("no number", f"the encoders gave {reading.theta_rad}", level=False)
    ball = reading.ball
    if ball is not None and not all(map(isfinite, (*ball.xy_m, *ball.cov_m2, ball.exposed_s))):
        return Fault("no number", f"the camera gave {ball.xy_m} m at {ball.exposed_s} s")
    return None


def _time(state: MonitorState, limits: MonitorLimits, step_s: float, late_s: float) -> Fault | None:
    if step_s <= 0.0:
        return Fault("link silent", f"the table's time stands still at {state.t_s:.3f} s", False)
    if late_s > limits.late_s:
        ms = 1e3 * late_s
        return Fault("late loop", f"a tick came {ms:.0f} ms late (limit {1e3 * limits.late_s:g})")
    if state.missed >= limits.late_ticks:
        share = 100 * limits.late_share
        return Fault(
            "late loop", f"more than {share:g} % of the ticks are missed: free the machine"
        )
    return None


def _angles(
    before: tuple[float, float], limits: MonitorLimits, reading: Reading, step_s: float
) -> Fault | None:
    most = limits.rate_rad_s * step_s + limits.noise_rad
    for axis, old, new in zip("xy", before, reading.theta_rad, strict=True):
        if abs(new - old) > most:
            moved = f"servo {axis} from {old:.3f} to {new:.3f} rad in {1e3 * step_s:.1f} ms"
            return Fault("encoder jump", f"{moved}: home again, check the cable", level=False)
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
    for axis, one, volt in zip("xy", after.pushes, volts, strict=True):
        if one.sign != 0.0 and after.t_s - one.since_s > limits.stall_s:
            words = (
                f"servo {axis} does not follow {volt:.1f} V: is it blocked, unplugged, reversed?"
            )
            return Fault("stall", words, level=False)
    return None


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
