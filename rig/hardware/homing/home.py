"""Homing: incremental encoders learn where level is, and every cable is checked, at low volts.

A plan is a generator: it is sent what is seen in each tick and answers with the volts of the two
motor channels. A nudge shows which encoder follows which motor and which way; both stops are found
by the stall that the encoder shows; the middle is zero; where the plate's markers are seen they say
which arm tilts which axis, in which direction, and whether the middle is level.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from math import hypot, inf

from rig.hardware.homing.homing_moves import (
    FARTHEST_RAD,
    LEVEL_SINE,
    MOST_V,
    SWING_RAD,
    Arm,
    Channels,
    HomingRefused,
    Pair,
    Sight,
    breakaway,
    find_stops,
    hold,
    look,
    nudge,
    rest,
)
from rig.hardware.wiring import Wiring, file_wiring
from rig.linkage import Linkage
from rig.parameters import Rig
from rig.safety.monitor import MonitorLimits, check_step
from rig.table import Reading, Table

# Of the tilt that is expected; chosen: joints with play take up a part of the swing, and a servo of
# 270 degrees that is told pulses for 180 goes 1.5 times as far.
LEAST_TILT, MOST_TILT = 0.4, 1.33


@dataclass(frozen=True)
class Homing:
    """What homing found, by servo of the linkage (x, y, or the arms).

    travel_rad: between the stops; moving_V: volts that moved the arm, 0 where angles did;
    breakaway_V: at which it begins to move up and down, none where angles move it; level:
    (sin phi_x, sin phi_y) in the middle between the stops as the markers see them, None where they
    were not seen. Which axis is which, and which way is down, is then what the rig file says.
    """

    wiring: Wiring
    travel_rad: Channels
    moving_V: Channels
    level: Pair | None = None
    breakaway_V: tuple[Pair, ...] = ()

    @property
    def confirmed(self) -> bool:
        """Whether the markers saw the plate move."""
        return self.level is not None


Plan = Generator[Channels, Sight, Homing]


def plan(rig: Rig) -> Plan:
    """Yield the volts of both motor channels, tick by tick, and return the homing at the end.

    It is sent a `Sight` after every tick; the table is opened with raw wiring. HomingRefused: what
    was seen does not allow a homing; the message names it and the cure.
    """
    sight = yield 0.0, 0.0
    arms: list[Arm] = []
    for motor in (0, 1):
        sight = yield from rest(sight)
        arm, sight = yield from nudge(motor, sight)
        arms.append(arm)
    _check_pairs(arms)
    done: list[Arm] = []
    for arm in arms:
        found, sight = yield from find_stops(arm, done, sight)
        _check_travel(found, rig)
        done.append(found)
        sight = yield from hold(done, [a.middle for a in done], sight)
    ways: list[Pair] = []
    for arm in done:
        way, sight = yield from breakaway(arm, rig.servo, sight)
        ways.append(way)
        sight = yield from hold(done, [a.middle for a in done], sight)
    columns, level, sight = yield from swing(done, sight)
    found = unconfirmed(done, rig) if level is None else confirmed(done, columns, level, rig)
    return replace(found, breakaway_V=_by_servo(done, ways, found.wiring))


def _by_servo(arms: list[Arm], ways: list[Pair], wiring: Wiring) -> tuple[Pair, ...]:
    """Volts up and down of counts, by arm, as up and down of the servos' angles, by servo."""
    found = {}
    for arm, (rise, fall) in zip(arms, ways, strict=True):
        rises = wiring.sign_angle[arm.encoder] > 0
        found[wiring.order[arm.encoder]] = (rise, fall) if rises else (fall, rise)
    return tuple(found[servo] for servo in sorted(found))


def _check_pairs(arms: list[Arm]) -> None:
    """Each encoder must follow one motor."""
    if arms[0].encoder == arms[1].encoder:
        raise HomingRefused(
            "missing encoder",
            f"encoder {arms[0].encoder} follows both motors and encoder {1 - arms[0].encoder} "
            "none: check the cables",
        )


def _check_travel(arm: Arm, rig: Rig) -> None:
    travel, least = arm.high - arm.low, 2 * rig.servo.angle_limit_rad
    if travel < least:
        raise HomingRefused(
            "short way",
            f"the arm of motor channel {arm.motor} moves {travel:.2f} rad between its stops, "
            f"servo.angle_limit_rad needs {least:.2f}: something blocks it, or lower that limit",
        )
    if travel > FARTHEST_RAD:
        raise HomingRefused(
            "no stop",
            f"the arm of motor channel {arm.motor} moves {travel:.2f} rad between its stops: is "
            "its linkage on?",
        )


Swung = tuple[list[Pair], Pair | None, Sight]


def swing(
    arms: list[Arm], sight: Sight, swing_rad: float = SWING_RAD
) -> Generator[Channels, Sight, Swung]:
    """Each arm by swing_rad to both sides of its middle: sines per radian of each, and the sines in
    the middle.

    Ends in the middle. Where the markers are not seen nothing is swung.
    """
    middles = [arm.middle for arm in arms]
    level, _, sight = yield from look(arms, middles, sight)
    columns: list[Pair] = []
    for i in range(len(arms)) if level is not None else ():
        ends = []
        for way in (1, -1):
            targets = [m + way * swing_rad * (k == i) for k, m in enumerate(middles)]
            tilt, angles, sight = yield from look(arms, targets, sight)
            if tilt is None:
                raise HomingRefused("no markers", "the markers were lost while the plate moved")
            ends.append((tilt, angles[i]))
        (high, a), (low, b) = ends
        columns.append(((high[0] - low[0]) / (a - b), (high[1] - low[1]) / (a - b)))
    sight = yield from hold(arms, middles, sight)
    return columns, level, sight


def confirmed(arms: list[Arm], columns: list[Pair], level: Pair, rig: Rig) -> Homing:
    """The wiring as the markers saw it. HomingRefused: they saw what cannot be."""
    found = [
        _recognised(arm, column, rig.linkage) for arm, column in zip(arms, columns, strict=True)
    ]
    servos, signs = [servo for servo, _ in found], [sign for _, sign in found]
    if len({*servos}) < len(servos):
        raise HomingRefused("plate does not follow", "two arms tilt the plate about one axis")
    if max(map(abs, level)) > LEVEL_SINE:
        worst = max(level, key=abs)
        raise HomingRefused(
            "not level",
            f"in the middle between the stops the plate leans by {57.3 * abs(worst):.1f} degrees: "
            "set the arms on their shafts anew, or run rig calibrate table with a level plate",
        )
    return _homing(arms, servos, signs, rig, level)


def _recognised(arm: Arm, column: Pair, linkage: Linkage) -> tuple[int, int]:
    """The servo of the linkage that an arm is, and 1 where its counts rise with its angle, else -1;
    column: what the plate's sines changed per radian of it."""
    found = []
    for servo, expected in enumerate(linkage.tilt_per_servo):
        most = hypot(*expected)
        along = (column[0] * expected[0] + column[1] * expected[1]) / most
        across = abs(column[0] * expected[1] - column[1] * expected[0]) / most
        found.append((abs(along), servo, 1 if along > 0 else -1, across, most))
    seen, servo, sign, across, most = max(found)
    if not LEAST_TILT * most <= seen <= MOST_TILT * most:
        raise HomingRefused(
            "plate does not follow",
            f"the arm of motor channel {arm.motor} tilts the plate by {seen:.3f} rad a rad, "
            f"{most:.3f} are expected: is the linkage on, are [linkage] and, of servos on pulses, "
            "pulse_us_per_rad right?",
        )
    if across > 0.5 * seen:
        raise HomingRefused(
            "camera turned",
            f"motor channel {arm.motor} tilts the plate across its axes: markers and "
            "calibration do not belong together; run rig calibrate table again",
        )
    return servo, sign


def unconfirmed(arms: list[Arm], rig: Rig) -> Homing:
    """The wiring as far as the encoders tell; order and directions are the rig file's."""
    signs = rig.table.by_channel("sign_angle", rig.linkage.servos)
    order = file_wiring(rig).order
    servos = [order[arm.encoder] for arm in arms]
    return _homing(arms, servos, [signs[arm.encoder] for arm in arms], rig, None)


def _homing(
    arms: list[Arm], servos: list[int], signs: list[int], rig: Rig, level: Pair | None
) -> Homing:
    """The wiring and the numbers by servo; `servos`, `signs`: of each arm, 1 where its counts rise
    with the angle."""
    raw = Wiring(counts_per_rev=rig.servo.encoder_counts_per_rev)
    order, volts, angle, zeros = ([0] * len(arms) for _ in range(4))  # by channel
    for arm, servo, sign in zip(arms, servos, signs, strict=True):
        order[arm.encoder] = servo
        volts[arm.motor] = sign * arm.sign
        angle[arm.encoder] = sign
        zeros[arm.encoder] = round(arm.middle / raw.step_rad)
    wiring = Wiring(
        tuple(order),
        tuple(volts),
        tuple(angle),
        tuple(zeros),
        raw.counts_per_rev,
        crossed=any(arm.encoder != arm.motor for arm in arms),
    )
    own = [arms[servos.index(servo)] for servo in range(len(arms))]
    travel = tuple(arm.high - arm.low for arm in own)
    return Homing(wiring, travel, tuple(arm.moving_V for arm in own), level)


def _limits(rig: Rig) -> MonitorLimits:
    """What no reading goes beyond while an arm is homed: its stops are not known, and it turns at
    most at four times its no-load speed at MOST_V, as the rig file may be far off.
    """
    limits = MonitorLimits.of_rig(rig)
    slower = min(1.0, 2.0 * MOST_V / rig.servo.voltage_limit_V)
    return replace(limits, angle_rad=inf, rate_rad_s=slower * limits.rate_rad_s)


def _check_reading(before: Reading | None, limits: MonitorLimits, reading: Reading) -> None:
    """HomingRefused: no arm can have made this reading. Angles that are told, or not measured, are
    not looked at.
    """
    if not limits.measured or limits.stall_V == inf:
        return
    fault = check_step(before, limits, reading)
    if fault is not None:
        which = "" if fault.axis is None else f"encoder channel {fault.axis}: "
        raise HomingRefused(fault.name, f"{which}{fault.reason}")


def home(
    table: Table,
    rig: Rig,
    tilt: Callable[[float], Pair | None] = lambda t_s: None,
    steps: Plan | None = None,
) -> Homing:
    """Home an armed table that was opened with raw wiring; it ends in the middle, at 0 V.

    tilt: called at every tick with the reading's time [s]; gives (sin phi_x, sin phi_y) when a new
    picture of the plate was taken, else None; steps: default `plan`. HomingRefused: as the plan,
    or a reading that no arm can have made, after which no zero would be right; OSError: the table
    is lost.
    """
    limits, before = _limits(rig), None
    steps = steps or plan(rig)
    volts = next(steps)
    try:
        while True:
            table.drive(volts)  # pyright: ignore[reportArgumentType] - by channel
            reading = table.read()
            _check_reading(before, limits, reading)
            before = reading
            sight = Sight(
                reading.t_s, reading.theta_rad, reading.motor_speed_rad_s, tilt(reading.t_s)
            )
            try:
                volts = steps.send(sight)
            except StopIteration as done:
                return done.value
    finally:
        table.drive(tuple(0.0 for _ in volts))  # pyright: ignore[reportArgumentType]
