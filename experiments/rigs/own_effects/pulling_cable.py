"""A cable that is too short: beyond its slack it pulls back like a spring, on one side alone."""

from rig import Effect, Parameter

EFFECT = Effect(
    name="pulling_cable",
    side="servo",
    axes=("x", "y"),
    parameters=(
        Parameter("stiffness_V_rad", 0.0, "V/rad", 0.0, 20.0),
        Parameter("slack_rad", 0.0, "rad", -0.5, 0.5),
    ),
    tolerance=0.1,
    sentence="A cable pulls the servo back like a spring, beyond its slack on one side.",
)


def equation(theta_rad, omega_rad_s, t_s, stiffness_V_rad, slack_rad):
    """Volts added at the motor; the sign of slack_rad is the side on which the cable pulls."""
    beyond = theta_rad - slack_rad
    beyond = max(beyond, 0.0) if slack_rad >= 0.0 else min(beyond, 0.0)
    return -stiffness_V_rad * beyond
