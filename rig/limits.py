"""The one clamp between a controller's wish and the motor: a pure function.

What it returns is what is applied and recorded. Volts stop when anything is unclear: a wish that
is not finite is 0 V, and beyond the angle limit only volts that lead back are let through.
"""

from rig.compiled import compiled


@compiled
def limit(wish_V, theta_rad, voltage_limit_V, angle_limit_rad):
    """Volts that may be applied to one axis [V].

    wish_V what the controller asks; theta_rad the encoder's angle (NaN: unknown -> 0 V);
    0 < voltage_limit_V; beyond |theta| = angle_limit_rad only volts towards level pass.
    """
    if not (wish_V - wish_V == 0.0) or not (theta_rad - theta_rad == 0.0):
        return 0.0
    allowed = min(max(wish_V, -voltage_limit_V), voltage_limit_V)
    if abs(theta_rad) > angle_limit_rad and (allowed > 0.0) == (theta_rad > 0.0):
        return 0.0
    return allowed
