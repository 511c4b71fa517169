"""The one limiter between commanded volts and the motor: a pure function.

What it returns is what is applied and recorded. It is 0 V where the command, the angle, the rate or
the last volts are no finite numbers, or the estimate behind the command is stale. It never changes
the sign of a command and never makes it larger; volts may always fall to zero at once.
"""

from rig.compiled import compiled

SLEW_V_S = 1500.0  # 0 to 3 V within a tick of 2 ms: faster than any loop here means to be
LOOK_AHEAD_S = 0.03  # a servo at full speed cannot be stopped at the limit: it is met earlier
STALE_S = 0.05  # an estimate that was not brought up to date for so long is worth nothing


@compiled
def limit(
    commanded_V, theta_rad, rate_rad_s, last_V, voltage_limit_V, angle_limit_rad, slew_V, age_s=0.0
):
    """Volts that may be applied to one axis [V].

    commanded_V: what the controller asks; theta_rad, rate_rad_s: the encoder's angle and its rate;
    last_V: what was applied before; age_s: how old the estimate behind the command is. |V| <=
    voltage_limit_V; |V| grows by at most slew_V in a tick; where the arm is beyond angle_limit_rad,
    or would be after LOOK_AHEAD_S, only volts that lead back pass. 0 V where an argument is not
    finite or age_s is above STALE_S.
    """
    unclear = (commanded_V - commanded_V) + (theta_rad - theta_rad) + (rate_rad_s - rate_rad_s)
    if not (unclear == 0.0 and last_V - last_V == 0.0 and age_s <= STALE_S):
        return 0.0
    allowed = min(max(commanded_V, -voltage_limit_V), voltage_limit_V)
    allowed = min(max(allowed, min(last_V, 0.0) - slew_V), max(last_V, 0.0) + slew_V)
    ahead = theta_rad + LOOK_AHEAD_S * rate_rad_s
    if allowed > 0.0 and max(theta_rad, ahead) > angle_limit_rad:
        return 0.0
    if allowed < 0.0 and min(theta_rad, ahead) < -angle_limit_rad:
        return 0.0
    return allowed
