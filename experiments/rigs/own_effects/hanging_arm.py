"""A weight hangs on the servo's arm: gravity pulls with the sine of the angle."""

from math import sin

from rig import Effect, Parameter

EFFECT = Effect(
    name="hanging_arm",
    side="servo",
    axes=("x", "y"),
    parameters=(  # key, null value, unit, range
        Parameter("weight_V", 0.0, "V", -2.0, 2.0),
        Parameter("angle_rad", 0.0, "rad", -1.5, 1.5),
    ),
    tolerance=0.02,  # of weight_V: what a healthy table may have
    sentence="A weight hangs on the servo: it pulls with the sine of the angle.",
)


def equation(theta_rad, omega_rad_s, t_s, weight_V, angle_rad):
    """Volts added at the motor; the weight hangs straight down at -angle_rad."""
    return -weight_V * sin(theta_rad + angle_rad)
