"""What homing does with the motors: nudge, seek a stop, hold, look. Each is a generator that is
sent what is seen in a tick and answers with the volts of the motor channels."""

from collections.abc import Generator
from dataclasses import dataclass, replace
from math import expm1, radians, sin, sqrt

from rig.parameters import Servo

Pair = tuple[float, float]
Channels = tuple[float, ...]  # a number for each channel of the board

MOST_V = 1.5  # what a stop can take, and below what a board allows before homing
RAMP_V_S = 1.5
STEADY_S = 0.4  # at full volts without motion: it does not move
MOVED_RAD = 0.08  # beyond what an idle arm sways inside the play of its joint
COUPLED_RAD = 0.05
CRUISE_V = 0.5  # above what made it move
STALL_S, STALL_RAD = 0.25, 0.005
SEEK_S = 12.0
FARTHEST_RAD = 2.2  # from where it began, or between the stops: there is none
HOLD_V_RAD = 14.0
ARRIVED_RAD, ARRIVE_S, SETTLE_S = 0.04, 4.0, 0.5
LOOK_S, LOOK_LONGEST_S = 0.4, 3.0  # the longer where pictures come, but slowly
SWING_RAD = 0.2
FEWEST_LOOKS = 5
LEVEL_SINE = sin(radians(1.0))
SPEED_RAD_S = 0.3  # a tachometer that shows this: the motor turns
SLOW_RAMP_V_S = 0.5  # chosen: of MOVED_RAD it needs 0.2 V, which a tenth of the gain makes 0.01


class HomingRefused(ValueError):  # noqa: N818 - the state, not the slip
    """Homing found what must not be driven.

    name: one of a few words, for programs; text: what was seen, and at its end what to check.
    """

    def __init__(self, name: str, text: str) -> None:
        super().__init__(f"homing: {name}: {text}")
        self.name = name


@dataclass(frozen=True)
class Sight:
    """One tick as a homing plan is sent it, by channel.

    t_s: the reading's time; theta_rad: encoder angles; speed_rad_s: motor speeds, None without
    tachometers; tilt: (sin phi_x, sin phi_y) of a new picture of the plate, else None.
    """

    t_s: float
    theta_rad: Channels
    speed_rad_s: Pair | None = None
    tilt: Pair | None = None


@dataclass(frozen=True)
class Arm:
    """An arm that homing has found, by channel.

    motor, encoder: its channels; sign: 1 where positive volts raise its counts, else -1; moving_V:
    volts at which it first moved; low, high: encoder angles at its stops [rad].
    """

    motor: int
    encoder: int
    sign: int
    moving_V: float
    low: float = 0.0
    high: float = 0.0

    @property
    def middle(self) -> float:
        """Encoder angle in the middle between the stops [rad]."""
        return 0.5 * (self.low + self.high)

    def towards(self, target: float, sight: Sight) -> float:
        """Volts of its motor that hold it at the encoder angle `target` [rad], within +-MOST_V."""
        commanded = self.sign * HOLD_V_RAD * (target - sight.theta_rad[self.encoder])
        return max(-MOST_V, min(MOST_V, commanded))


Steps = Generator[Channels, Sight, Sight]


def _volts(motor: int, volts: float) -> Pair:
    return (volts, 0.0) if motor == 0 else (0.0, volts)


def rest(sight: Sight) -> Steps:
    """Give 0 V until what hangs loose has settled; returns the last sight."""
    begin_s = sight.t_s
    while sight.t_s - begin_s < SETTLE_S:
        sight = yield 0.0, 0.0
    return sight


def nudge(motor: int, sight: Sight) -> Generator[Channels, Sight, tuple[Arm, Sight]]:
    """Raise the volts of a motor until an arm moves; return that arm and the last sight.

    First one way, then the other, as the arm may lie at a stop. HomingRefused: "coupled", both
    encoders follow this motor; "missing encoder", it turns but no encoder counts; "stuck", nothing
    moves.
    """
    turned = False
    for way in (1, -1):
        begin, first = sight, None
        while sight.t_s - begin.t_s < MOST_V / RAMP_V_S + STEADY_S:
            volts = min(RAMP_V_S * (sight.t_s - begin.t_s), MOST_V)
            sight = yield _volts(motor, way * volts)
            first = first or sight.tilt
            moved = [sight.theta_rad[e] - begin.theta_rad[e] for e in (0, 1)]
            far = max((0, 1), key=lambda e: abs(moved[e]))
            if abs(moved[far]) > MOVED_RAD:
                if abs(moved[1 - far]) > COUPLED_RAD:
                    raise HomingRefused(
                        "coupled", f"both encoders follow motor channel {motor}: check the cables"
                    )
                sight = yield 0.0, 0.0
                sign = 1 if moved[far] * way > 0 else -1
                return Arm(motor, far, sign, volts), sight
            turned = turned or _turns(motor, first, sight)
    if turned:
        raise HomingRefused(
            "missing encoder",
            f"motor channel {motor} turns, but no encoder counts: is its cable in?",
        )
    raise HomingRefused(
        "stuck",
        f"no encoder moves at {MOST_V:g} V on motor channel {motor}, either way: is the motor's "
        "power on, the arm free, the encoder's cable in?",
    )


def _turns(motor: int, first: Pair | None, sight: Sight) -> bool:
    """Whether tachometer or markers say that something moves."""
    if sight.speed_rad_s is not None and abs(sight.speed_rad_s[motor]) > SPEED_RAD_S:
        return True
    if first is None or sight.tilt is None:
        return False
    return max(abs(a - b) for a, b in zip(first, sight.tilt, strict=True)) > LEVEL_SINE


def find_stops(
    arm: Arm, held: list[Arm], sight: Sight
) -> Generator[Channels, Sight, tuple[Arm, Sight]]:
    """Drive an arm to both of its stops; return it with low and high, and the last sight.

    held: arms that are held in their middle meanwhile. HomingRefused: "no stop" within FARTHEST_RAD
    or SEEK_S.
    """
    sight = yield from _seek(arm, 1, held, sight)
    high = sight.theta_rad[arm.encoder]
    sight = yield from _seek(arm, -1, held, sight)
    return replace(arm, low=sight.theta_rad[arm.encoder], high=high), sight


def ramp_volts(servo: Servo) -> float:
    """Volts [V] by which SLOW_RAMP_V_S has risen while an arm without friction goes MOVED_RAD.

    tau w' = K r t - w from rest: its angle is K r (t^2/2 - tau t + tau^2 (1 - e^(-t/tau))), between
    that of a servo without tau, sqrt(2 MOVED_RAD/(K r)) before it has gone the way, and tau later.
    """
    tau, rate = servo.time_constant_s, servo.gain_rad_s_V * SLOW_RAMP_V_S
    low_s = sqrt(2 * MOVED_RAD / rate)
    high_s = low_s + tau
    for _ in range(40):
        t = 0.5 * (low_s + high_s)
        gone = rate * (0.5 * t * t - tau * t - tau * tau * expm1(-t / tau))
        low_s, high_s = (t, high_s) if gone < MOVED_RAD else (low_s, t)
    return SLOW_RAMP_V_S * low_s


def breakaway(
    arm: Arm, servo: Servo, sight: Sight
) -> Generator[Channels, Sight, tuple[Pair, Sight]]:
    """Volts at which an arm begins to move so that its counts rise, and fall; and the last sight.

    Each way a slow ramp moves it by MOVED_RAD, which takes up the play of its joint, then another
    one, whose volts count, less those of that way. HomingRefused: "stuck".
    """
    found: list[float] = []
    for way in (1, 1, -1, -1):
        sight = yield from rest(sight)
        begin, volts = sight, 0.0
        while way * (sight.theta_rad[arm.encoder] - begin.theta_rad[arm.encoder]) <= MOVED_RAD:
            passed_s = sight.t_s - begin.t_s
            if passed_s > MOST_V / SLOW_RAMP_V_S + STEADY_S:
                raise HomingRefused(
                    "stuck",
                    f"the arm of motor channel {arm.motor} does not move from its middle at "
                    f"{MOST_V:g} V: is it stiff?",
                )
            volts = min(SLOW_RAMP_V_S * passed_s, MOST_V)
            sight = yield _volts(arm.motor, way * arm.sign * volts)
        found.append(max(volts - ramp_volts(servo), 0.0))
    return (found[1], found[3]), sight


def _seek(arm: Arm, way: int, held: list[Arm], sight: Sight) -> Steps:
    """Drive until the encoder stalls at full homing volts."""
    begin_s, begin = sight.t_s, sight.theta_rad[arm.encoder]
    since_s, since = sight.t_s, begin
    volts = min(arm.moving_V + CRUISE_V, MOST_V)
    while True:
        sight = yield _with_held(arm, way * arm.sign * volts, held, sight)
        here = sight.theta_rad[arm.encoder]
        if abs(here - begin) > FARTHEST_RAD:
            raise HomingRefused(
                "no stop",
                f"motor channel {arm.motor} turned {abs(here - begin):.1f} rad and met no stop: is "
                "the arm's linkage on?",
            )
        if sight.t_s - begin_s > SEEK_S:
            raise HomingRefused("no stop", f"no stop within {SEEK_S:g} s; is a joint stiff?")
        if way * (here - since) > STALL_RAD:
            since_s, since = sight.t_s, here
        elif sight.t_s - since_s > STALL_S:
            if volts >= MOST_V:
                return sight
            volts, since_s = MOST_V, sight.t_s  # dry friction, perhaps


def _with_held(arm: Arm, volts: float, held: list[Arm], sight: Sight) -> Pair:
    out = list(_volts(arm.motor, volts))
    for other in held:
        out[other.motor] = other.towards(other.middle, sight)
    return out[0], out[1]


def hold(arms: list[Arm], targets: list[float], sight: Sight) -> Steps:
    """Bring arms to encoder angles `targets` [rad] and let them settle; return the last sight.

    HomingRefused: "stuck", an arm does not arrive.
    """
    begin_s, there_s = sight.t_s, sight.t_s
    while sight.t_s - there_s < SETTLE_S:
        out = [0.0] * len(sight.theta_rad)
        for arm, target in zip(arms, targets, strict=True):
            out[arm.motor] = arm.towards(target, sight)
        sight = yield tuple(out)
        off = [abs(sight.theta_rad[a.encoder] - t) for a, t in zip(arms, targets, strict=True)]
        if max(off) > ARRIVED_RAD:
            there_s = sight.t_s
        if sight.t_s - begin_s > ARRIVE_S + SETTLE_S:
            raise HomingRefused(
                "stuck", f"an arm stays {max(off):.2f} rad from where it was sent: is it stiff?"
            )
    return sight


Looked = tuple[Pair | None, list[float], Sight]


def look(arms: list[Arm], targets: list[float], sight: Sight) -> Generator[Channels, Sight, Looked]:
    """Return the plate's mean sines and the arms' mean angles at `targets`, and the last sight.

    The sines are (sin phi_x, sin phi_y), None where too few pictures show the markers; angles [rad]
    are those of the encoders. HomingRefused: as `hold`.
    """
    sight = yield from hold(arms, targets, sight)
    begin_s, seen = sight.t_s, []
    angles = [0.0] * len(arms)
    count = 0
    while (passed_s := sight.t_s - begin_s) < LOOK_S or (
        0 < len(seen) < FEWEST_LOOKS and passed_s < LOOK_LONGEST_S
    ):
        out = [0.0] * len(sight.theta_rad)
        for i, (arm, target) in enumerate(zip(arms, targets, strict=True)):
            out[arm.motor] = arm.towards(target, sight)
            angles[i] += sight.theta_rad[arm.encoder]
        count += 1
        sight = yield tuple(out)
        if sight.tilt is not None:
            seen.append(sight.tilt)
    angles = [a / count for a in angles]
    if len(seen) < FEWEST_LOOKS:
        return None, angles, sight
    mean = tuple(sum(s[k] for s in seen) / len(seen) for k in (0, 1))
    return (mean[0], mean[1]), angles, sight
