"""The one limiter between commanded volts and the motor: a pure function; and that of an angle.

What it returns is what is applied and recorded. It is 0 V where the command, the angle, the rate or
the last volts are no finite numbers, or the estimate behind the command is stale. It makes a
command larger, or turns its sign, for one purpose: to brake an arm that would pass its angle limit.
"""

from typing import NamedTuple

from rig.compiled import compiled, inlined
from rig.parameters import Servo

SLEW_V_S = 1500.0  # 0 to 3 V within a tick of 2 ms: faster than any loop here means to be
STALE_S = 0.05  # an estimate that was not brought up to date for so long is worth nothing
TAPER_RAD = 0.04  # chosen, because a steeper law swings about the limit: see test_limits
CATCH_TAUS = 5  # so long an arm that would pass its limit is braked; e^-5 of its speed is left
LATE_TICKS = 1.5  # a rate is half a tick old, and volts act from this tick to the next
LATE_KEPT = 0.97  # of a tick's lateness, in each that follows; chosen: forgotten after some thirty
SLOW_TICKS = LATE_TICKS + 1.0  # of late ticks: the next one may come as late again


class Braking(NamedTuple):
    """What the limiter knows of how an arm stops.

    delay_s: age of the rate when volts act; time_constant_s: of the servo; top_speed_rad_s: of the
    arm at the voltage limit.
    """

    delay_s: float
    time_constant_s: float
    top_speed_rad_s: float


def braking(servo: Servo, period_s: float, filter_s: float = 0.0) -> Braking:
    """How the arms of a servo stop; period_s: of the tick, filter_s: time constant of the rate."""
    top_speed_rad_s = servo.gain_rad_s_V * servo.voltage_limit_V
    return Braking(filter_s + LATE_TICKS * period_s, servo.time_constant_s, top_speed_rad_s)


def lateness(before_s: float, late_s: float, period_s: float) -> float:
    """Lateness to reckon with from this tick on [s].

    before_s: of the tick before; late_s: how late this one is; less than half a period is none.
    """
    now_s = min(late_s, STALE_S) if late_s > 0.5 * period_s else 0.0
    return max(now_s, LATE_KEPT * before_s)


def delayed(stops: Braking, slow_s: float) -> Braking:
    """How arms stop where ticks come late by slow_s [s]: the rate is older, and volts last longer.

    Of a constant lateness the tick is longer by as much, and the next one may be late again.
    """
    return stops._replace(delay_s=stops.delay_s + SLOW_TICKS * slow_s)


@compiled
def free_rate(before_rad_s, applied_V, gain_rad_s_V, kept):
    """Rate after a tick of a motor that volts alone drive, as in the play of its gears [rad/s].

    tau w' = K V - w. before_rad_s: a tick ago; applied_V: since then; gain_rad_s_V: K; kept:
    exp(-tick / tau).
    """
    return kept * before_rad_s + (1.0 - kept) * gain_rad_s_V * applied_V


@inlined
def _stops_after(rate_rad_s, braking):
    """Way to rest of a braked arm [rad]: s of `limit`, and what it goes before that."""
    share = rate_rad_s / (2.0 * braking.top_speed_rad_s + rate_rad_s)
    return rate_rad_s * (braking.delay_s + braking.time_constant_s * share)


@compiled
def limit(
    commanded_V,
    theta_rad,
    rate_rad_s,
    last_V,
    voltage_limit_V,
    angle_limit_rad,
    slew_V,
    braking,
    age_s=0.0,
    free_rad_s=0.0,
):
    """Volts that may be applied to one axis [V].

    commanded_V: what the controller asks; theta_rad, rate_rad_s: the encoder's angle and its rate;
    last_V: what was applied before; braking: a `Braking`; age_s: how old the estimate behind the
    command is; free_rad_s: of `free_rate`. |V| <= voltage_limit_V; |V| grows by at most slew_V in a
    tick; 0 V where an argument is not finite or age_s is above STALE_S.

    Towards the angle limit volts are bounded by the room that is left when the arm is braked. A
    servo, tau w' = K V - w, that goes at w and gets -V_max stops after the distance

        s = tau (w - W ln(1 + w / W)) <= tau w^2 / (2 W + w),    W = K V_max its top speed,

    as ln(1 + u) >= 2 u / (2 + u). It has gone w delay before that, so that
    room = angle_limit - theta - w delay - tau w^2 / (2 W + w). With more than TAPER_RAD of it the
    command passes; from there the bound falls in proportion, through 0 V at no room, to -V_max.

    In the play of its gears the motor turns and the encoder does not show it, until a tooth strikes
    and the arm goes at the motor's rate. That is at most free_rad_s, whatever the play: w is the
    larger of the two rates towards a limit.
    """
    unclear = (commanded_V - commanded_V) + (theta_rad - theta_rad) + (rate_rad_s - rate_rad_s)
    if not (unclear == 0.0 and last_V - last_V == 0.0 and age_s <= STALE_S):
        return 0.0
    allowed = min(max(commanded_V, -voltage_limit_V), voltage_limit_V)
    up = theta_rad + _stops_after(max(rate_rad_s, free_rad_s, 0.0), braking)
    down = theta_rad - _stops_after(max(-rate_rad_s, -free_rad_s, 0.0), braking)
    allowed = min(allowed, max((angle_limit_rad - up) / TAPER_RAD, -1.0) * voltage_limit_V)
    allowed = max(allowed, -max((angle_limit_rad + down) / TAPER_RAD, -1.0) * voltage_limit_V)
    return min(max(allowed, min(last_V, 0.0) - slew_V), max(last_V, 0.0) + slew_V)


@compiled
def limit_angle(commanded_rad, last_rad, angle_limit_rad, age_s=0.0):
    """Angle that may be told to a servo that takes one [rad], within +-angle_limit_rad.

    The servo holds what it is told: where commanded_rad is not finite or age_s is above STALE_S it
    stays told last_rad, and is levelled where that is not finite either.
    """
    held = last_rad if last_rad - last_rad == 0.0 else 0.0
    clear = commanded_rad - commanded_rad == 0.0 and age_s <= STALE_S
    told = commanded_rad if clear else held
    return min(max(told, -angle_limit_rad), angle_limit_rad)
