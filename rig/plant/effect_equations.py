"""The catalogue's equations, one compiled function each.

Elsewhere: gear and joint backlash in `shaft.py`, cross coupling in `ball.py`, level offset and
drift in `step.ball_step`, the delay of the volts in `plant.late_row`, that of the camera in
`rig.simulation.statistical_camera`.

theta servo angle [rad], omega its rate [rad/s], V motor volts, t the run's time [s].
"""

from math import sqrt

from rig.compiled import compiled, inlined
from rig.plant.elementary_functions import cosine, decaying, sine, sine_cosine

# --- servo side: what becomes of the volts ---------------------------------------------------


@inlined
def dead_zone(volts, positive_V, negative_V):
    """V less the dead zone, sgn(V) max(|V| - w, 0), with a width w of its own on each side [V]."""
    return max(volts - positive_V, 0.0) + min(volts + negative_V, 0.0)


@inlined
def gain_asymmetry(volts, fraction):
    """V (1 + fraction) for V > 0, V (1 - fraction) for V <= 0 [V]."""
    return volts * (1.0 + fraction) if volts > 0.0 else volts * (1.0 - fraction)


@inlined
def voltage_offset(volts, offset_V):
    """V + offset [V]."""
    return volts + offset_V


@inlined
def saturation(volts, limit_V):
    """clip(V, -limit, limit) [V]."""
    return min(max(volts, -limit_V), limit_V)


@inlined
def cogging(volts, theta, amplitude_V, phase_rad, periods_per_turn):
    """V + A sin(n theta + phase) [V]."""
    if amplitude_V == 0.0:  # saves one run the sine; of many, the compiler takes both and selects
        return volts
    return volts + amplitude_V * sine(periods_per_turn * theta + phase_rad)


@inlined
def gain_drift(volts, t, rate_1_s):
    """V (1 - rate t), t the run's time [V]."""
    return volts * (1.0 - rate_1_s * t)


@inlined
def supply_sag(volts, volts_x, volts_y, drop_1_V):
    """V (1 - drop (|V_x| + |V_y|)): the supply drops with the volts of both motors [V]."""
    return volts * (1.0 - drop_1_V * (abs(volts_x) + abs(volts_y)))


@inlined
def friction_volts(omega, friction_V, extra_V, speed_rad_s):
    """Size of dry friction: Coulomb friction plus the Stribeck excess extra
    exp(-(omega/speed)^2) [V].
    """
    if extra_V == 0.0:
        return friction_V
    return friction_V + extra_V * decaying((omega / speed_rad_s) ** 2)


@inlined
def stick(speed, largest_change):
    """Speed after dry friction that changes it by at most `largest_change` and never reverses it.

    The implicit form of -F sgn(omega): at rest it holds as long as the drive stays below F. Any
    unit of speed, alike for both arguments.
    """
    return max(speed - largest_change, 0.0) + min(speed + largest_change, 0.0)


@inlined
def softened(speed, softness_rad_s):
    """tanh(|omega|/s)/|omega| [s/rad]: the share of dry friction per speed that sets in softly
    over the speed s > 0.

    Regularised Coulomb friction F tanh(omega/s), as in E. Pennestri et al., "Review and comparison
    of dry friction force models", Nonlinear Dynamics 83 (2016).
    """
    x = max(abs(speed) / softness_rad_s, 1e-6)  # its limit at rest is 1/s, to 1e-12
    e = decaying(2.0 * x)
    return (1.0 - e) / ((1.0 + e) * x * softness_rad_s)


@inlined
def dry_friction(free, speed, largest_change, held, softness_rad_s):
    """Speed after dry friction, of a motor that had `speed` and would have `free` without it.

    It changes the speed by at most `largest_change` and never reverses it. Where it can hold the
    motor, `held` times its speed is left: 0, or after a step h exp(-h/T) if the motor settles with
    the time constant T (as under MuJoCo's `frictionloss`). With a softness s > 0 it is -F
    tanh(omega/s) instead, semi-implicitly, under which a loaded motor creeps.
    """
    if softness_rad_s > 0.0:
        return free / (1.0 + largest_change * softened(speed, softness_rad_s))
    return free - min(max(free - held * speed, -largest_change), largest_change)


@inlined
def braked_speed(omega, fraction):
    """omega + fraction |omega|: the speed that viscous friction feels where it differs by
    direction [rad/s]."""
    return omega + fraction * abs(omega)


# --- ball side: the angle that the plate feels, and forces on the ball ------------------------


@inlined
def transmission_ripple(theta, amplitude_rad, phase_rad, periods_per_turn):
    """Kinematic error A (sin(n theta + phase) - sin(phase)) [rad], as of a harmonic drive."""
    if amplitude_rad == 0.0:
        return 0.0
    return amplitude_rad * (sine(periods_per_turn * theta + phase_rad) - sine(phase_rad))


@inlined
def transmission_ripple_slope(theta, amplitude_rad, phase_rad, periods_per_turn):
    """Derivative of `transmission_ripple` by theta, A n cos(n theta + phase) [1]."""
    if amplitude_rad == 0.0:
        return 0.0
    return amplitude_rad * periods_per_turn * cosine(periods_per_turn * theta + phase_rad)


@inlined
def linkage_quadratic(theta, coefficient_1_rad):
    """Angle added by the bent linkage, q theta^2 [rad]."""
    return coefficient_1_rad * theta * theta


@inlined
def linkage_quadratic_slope(theta, coefficient_1_rad):
    """Derivative of `linkage_quadratic` by theta, 2 q theta [1]."""
    return 2.0 * coefficient_1_rad * theta


@inlined
def linkage_cubic(theta, coefficient_1_rad2):
    """Angle added by the linkage's cubic term, c theta^3 [rad]."""
    return coefficient_1_rad2 * theta * theta * theta


@inlined
def linkage_cubic_slope(theta, coefficient_1_rad2):
    """Derivative of `linkage_cubic` by theta, 3 c theta^2 [1]."""
    return 3.0 * coefficient_1_rad2 * theta * theta


@inlined
def plate_bowl(position_m, stiffness_1_s2):
    """Acceleration -stiffness position of the ball on one axis [m/s2]."""
    return -stiffness_1_s2 * position_m


@inlined
def viscous_drag(speed_m_s, rate_1_s):
    """Acceleration -rate v of the ball on one axis [m/s2]."""
    return -rate_1_s * speed_m_s


@inlined
def rolling_resistance(speed_x, speed_y, deceleration_m_s2, step_s):
    """Factor [1] on the ball's velocity after a step of constant deceleration along it; 0 when
    it sticks.
    """
    if deceleration_m_s2 <= 0.0:
        return 1.0
    lost = deceleration_m_s2 * step_s
    speed = sqrt(speed_x * speed_x + speed_y * speed_y)
    return 0.0 if speed <= lost else 1.0 - lost / speed


# --- camera side: what is measured of a true position -----------------------------------------


@compiled
def camera_map(x, y, scale_fraction, yaw_rad, k1_1_m2):
    """Measured position R(yaw) (1 + s)(1 + k1 r^2) (x, y) [m]; yaw is counter-clockwise [rad].

    x, y: true position in the plate's frame [m]; scale_fraction = s; r^2 = x^2 + y^2.
    """
    factor = (1.0 + scale_fraction) * (1.0 + k1_1_m2 * (x * x + y * y))
    s, c = sine_cosine(yaw_rad)
    return factor * (c * x - s * y), factor * (s * x + c * y)


@compiled
def camera_unmap(x, y, scale_fraction, yaw_rad, k1_1_m2):
    """True position (x, y) of a measured one [m]: the inverse of `camera_map`.

    The lens is inverted by eight fixed-point iterations.
    """
    if scale_fraction == 0.0 and yaw_rad == 0.0 and k1_1_m2 == 0.0:
        return x, y
    s, c = sine_cosine(yaw_rad)
    u, v = (c * x + s * y) / (1.0 + scale_fraction), (c * y - s * x) / (1.0 + scale_fraction)
    a, b = u, v
    for _ in range(8):
        factor = 1.0 + k1_1_m2 * (a * a + b * b)
        a, b = u / factor, v / factor
    return a, b
