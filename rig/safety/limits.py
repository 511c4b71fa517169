"""The one clamp between a controller's wish and the motor: a pure function.

What it returns is what is applied and recorded. Volts stop when anything is unclear: where wish,
angle, rate or the last volts are no numbers, or the estimate behind the wish is stale, it is 0 V.
It never turns the sign of a wish and never makes it larger; volts may always fall to zero at once.
"""

from rig.compiled import compiled

SLEW_V_S = 1500.0  # 0 to 3 V within a tick of 2 ms: faster than any loop here means to be
LOOK_AHEAD_S = 0.03  # a servo at full speed cannot be stopped at the limit: it is met earlier
STALE_S = 0.05  # an estimate that was not brought up to date for so long is worth nothing


@compiled
def limit(
    wish_V, theta_rad, rate_rad_s, last_V, voltage_limit_V, angle_limit_rad, slew_V, age_s=0.0
):
    """Volts that may be applied to one axis [V].

    wish_V what the controller asks; theta_rad the encoder's angle and rate_rad_s its rate; last_V
    what was applied before; age_s how old the estimate behind the wish is. |V| <= voltage_limit_V;
    |V| grows by at most slew_V in a tick; where the arm is beyond angle_limit_rad, or would be in
    LOOK_AHEAD_S, only volts that lead back pass.
    """
    unclear = (wish_V - wish_V) + (theta_rad - theta_rad) + (rate_rad_s - rate_rad_s)
    if not (unclear == 0.0 and last_V - last_V == 0.0 and age_s <= STALE_S):
        return 0.0
    allowed = min(max(wish_V, -voltage_limit_V), voltage_limit_V)
    allowed = min(max(allowed, min(last_V, 0.0) - slew_V), max(last_V, 0.0) + slew_V)
    ahead = theta_rad + LOOK_AHEAD_S * rate_rad_s
    if allowed > 0.0 and max(theta_rad, ahead) > angle_limit_rad:
        return 0.0
    if allowed < 0.0 and min(theta_rad, ahead) < -angle_limit_rad:
        return 0.0
    return allowed
