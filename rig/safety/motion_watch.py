"""A watch for an arm that volts must have moved and whose encoder shows no motion: pure functions.

A frozen encoder and a blocked arm look alike: the angle stays while volts push. STRONG_V move any
arm, with pauses, too; this law knows what homing measured, the volts at which each arm begins to
move, and sees weaker ones. (Strong volts without a pause are the monitor's stall, which is later.)

A servo is tau w' = K (V + d) - w, where d [V] is whatever holds it back: friction, an offset, the
ball's weight; upwards d >= -sure. Let v, tau v' = V - v, be the volts as its speed follows them.
By linearity w >= K (v - sure). As long as its arm is seen to move by less than `moved`, its motor,
which turns in the play of the gear, has gone by no more than play + moved, so that

    integral of K (v - sure) dt  <=  play + moved     from any moment on.

The largest of these sums is kept (a CUSUM: E. S. Page, Biometrika 41, 1954); in place of v stands
the smaller one of v and V, as a servo that is faster than the rig file's stops sooner. A servo of
half the gain goes half as far: beyond 2 (play + moved), play = 3 degrees, it is a fault.

What this promises is a way, not a time: an arm whose encoder is frozen goes by 2 (play + moved)
beyond what volts below `sure` move it (K (sure - f) T, f its true friction) and what it coasts.
"""

from dataclasses import dataclass
from math import exp, inf, nan, radians

from rig.parameters import GRAVITY_M_S2, Rig, Servo

Both = tuple[float, float]  # volts upwards and downwards
PLAY_RAD = radians(3.0)  # of a gear, full width: three times the usual
WEAKEST = 0.5  # share of the rig file's gain that a healthy servo has at least
WORSE = 2.0  # friction since homing, over what homing measured; offsets stay
LASTS_S = 0.02  # of a command to a board: for longer nobody knows that its volts were applied
MOVED_RAD = 0.012  # chosen: beyond seven counts of 4096, by which a plug that is half out flickers
MOVED_STEPS = 2.5  # at least: an arm at the edge of a count shows one step to and fro
STRONG_V = 2.0  # as the monitor's and the boards' stall: the most that any arm needs to move
UNKNOWN: tuple[Both, Both] = ((inf, inf), (inf, inf))


def sure_volts(rig: Rig, breakaway_V: tuple[Both, ...]) -> tuple[Both, Both]:
    """Volts (upwards, downwards) that surely move each arm (x, y); inf where homing has not told.

    breakaway_V: at which each began to move when it was homed, upwards and downwards, both positive
    or 0. Their mean is friction, their difference an offset; friction may be WORSE times as large
    since, and a ball at the plate's edge weighs on the arm.
    """
    if len(breakaway_V) != 2:
        return UNKNOWN
    weight_nm = rig.ball.mass_kg * GRAVITY_M_S2 * rig.linkage.ratio * 0.5 * rig.linkage.side_m
    load_V = weight_nm / rig.servo.torque_per_volt_nm
    more_V = [(WORSE - 1.0) * 0.5 * (up + down) + load_V for up, down in breakaway_V]
    x, y = ((up + m, down + m) for (up, down), m in zip(breakaway_V, more_V, strict=True))
    return x, y


def bounded(sure_V: tuple[Both, Both]) -> tuple[Both, Both]:
    """The volts that surely move each arm, STRONG_V at most."""
    x, y = ((min(up, STRONG_V), min(down, STRONG_V)) for up, down in sure_V)
    return x, y


def way_of(step_rad: float) -> tuple[float, float]:
    """moved_rad and way_rad of `MotionLimits` where an encoder's step is step_rad."""
    moved_rad = max(MOVED_RAD, MOVED_STEPS * step_rad)
    return moved_rad, (PLAY_RAD + moved_rad) / WEAKEST


@dataclass(frozen=True)
class MotionLimits:
    """What moves a healthy arm: gain_rad_s_V, time_constant_s of the servo; sure_V: by axis, of
    `bounded`; moved_rad: smallest angle that is a motion; way_rad: the most that volts beyond
    sure_V push before one.
    """

    gain_rad_s_V: float
    time_constant_s: float
    moved_rad: float
    way_rad: float
    sure_V: tuple[Both, Both] = ((STRONG_V, STRONG_V), (STRONG_V, STRONG_V))

    @classmethod
    def of_servo(cls, servo: Servo, sure_V: tuple[Both, Both] = UNKNOWN) -> "MotionLimits":
        """Return the limits of these servos; sure_V: of `sure_volts`."""
        ways = way_of(servo.encoder_step_rad)
        return cls(servo.gain_rad_s_V, servo.time_constant_s, *ways, bounded(sure_V))


@dataclass(frozen=True)
class MotionWatch:
    """One axis: lagged_V: the volts as the servo's speed follows them; up_rad, down_rad: how far
    they have surely pushed since it was seen to move, at theta_rad (NaN: not seen yet).
    """

    lagged_V: float = 0.0
    up_rad: float = 0.0
    down_rad: float = 0.0
    theta_rad: float = nan


def watch_motion(
    before: MotionWatch,
    limits: MotionLimits,
    sure_V: Both,
    volts: float,
    theta_rad: float,
    step_s: float,
) -> MotionWatch:
    """Return the next state of one axis; volts: of the step_s that end with this angle."""
    step_s = min(step_s, LASTS_S)
    share = exp(-step_s / limits.time_constant_s)
    lagged_V = volts + (before.lagged_V - volts) * share
    if not abs(theta_rad - before.theta_rad) < limits.moved_rad:
        return MotionWatch(lagged_V, 0.0, 0.0, theta_rad)
    way = limits.gain_rad_s_V * step_s
    up_rad = max(0.0, before.up_rad + way * (min(volts, lagged_V) - sure_V[0]))
    down_rad = max(0.0, before.down_rad - way * (max(volts, lagged_V) + sure_V[1]))
    return MotionWatch(lagged_V, up_rad, down_rad, before.theta_rad)


def is_overdue(watch: MotionWatch, limits: MotionLimits) -> bool:
    """Whether the arm should have been seen to move."""
    return max(watch.up_rad, watch.down_rad) > limits.way_rad
