"""A ball rolling without slip on a plate that tilts about both axes at once (Eqs. 10 to 15).

The linkages set the heights of the plate's edges, so with e_x, e_y the plate's own axes and z up:
sin(phi_x) = -e_x . z and sin(phi_y) = -e_y . z exactly, each as Eq. 14 gives it. The plate does not
turn about its normal (a universal joint would differ in a heading of second order, which neither
gravity nor the linkages feel). Its angular velocity in its own frame is then (omega_1, omega_2, 0)
with omega_1 = -d(sin phi_y)/dt / c and omega_2 = d(sin phi_x)/dt / c, c = sqrt(1 - s_x^2 - s_y^2).

Newton and Euler for the ball in the plate's frame (centre at (x, y, r), factor
k = m r^2/(m r^2 + J), spin sigma about the normal) give, the contact force eliminated,

    x'' + r omega_2' = k (g s_x + omega_2^2 x - omega_1 omega_2 y) + (1 - k) r sigma omega_1
    y'' - r omega_1' = k (g s_y + omega_1^2 y - omega_1 omega_2 x) + (1 - k) r sigma omega_2
    sigma'           = -(omega_1 x' + omega_2 y')/r

(with omega_2 = phi_x', omega_1 = -phi_y' the centrifugal, Euler and gyroscopic terms that Eq. 15
leaves out; Eq. 15 is the limit of small angles and a plate at rest). The state holds
w = (x' + r omega_2, y' - r omega_1) instead of the velocity: the plate's angular acceleration,
which rings in the shafts, is then never needed.
"""

from math import sin, sqrt

import numpy as np

from rig.compiled import inlined
from rig.parameters import GRAVITY_M_S2
from rig.plant.elementary_functions import cosine, sine


@inlined
def plate_sines(theta_x, theta_y, ratio, cross_x, cross_y):
    """sin(phi_x), sin(phi_y) by Eq. 14 for both axes [1], from the plate's felt angles [rad].

    theta_x, theta_y: of `felt_angle`; ratio = 2 R_d/L of both axes; cross_x: share of sin(theta_y)
    that also enters phi_x, cross_y the reverse [1].
    """
    a, b = sine(theta_x), sine(theta_y)
    return ratio[0] * (a + cross_x * b), ratio[1] * (b + cross_y * a)


@inlined
def plate_rates(theta_x, theta_y, omega_x, omega_y, ratio, cross_x, cross_y, s_x, s_y):
    """omega_1, omega_2: the plate's angular velocity in its own frame [rad/s].

    theta [rad] and omega [rad/s]: felt angles and their rates by axis; ratio = 2 R_d/L of both;
    cross: shares as in `plate_sines`; s_x, s_y: the sines that it returned.
    """
    a, b = cosine(theta_x) * omega_x, cosine(theta_y) * omega_y
    c = sqrt(1.0 - s_x * s_x - s_y * s_y)
    return -(b + cross_y * a) * (ratio[1] / c), (a + cross_x * b) * (ratio[0] / c)


@inlined
def velocity(w_x, w_y, omega_1, omega_2, radius):
    """x', y' of the ball's centre in the plate's frame [m/s] from the state w = (w_x, w_y) [m/s].

    omega_1, omega_2 [rad/s]: of `plate_rates`; radius [m]: of the ball.
    """
    return w_x - radius * omega_2, w_y + radius * omega_1


@inlined
def rolling(x, y, v_x, v_y, spin, slope_x, slope_y, omega_1, omega_2, factor, radius):
    """d(w_x)/dt, d(w_y)/dt [m/s2] and d(sigma)/dt [rad/s2]: the equations of motion above.

    x, y [m], v_x, v_y [m/s]: the ball's centre in the plate's frame; spin = sigma [rad/s]; slope_x,
    slope_y = sin(phi) of each axis plus any level error [1]; omega_1, omega_2 [rad/s]: of
    `plate_rates`; factor = k = m r^2/(m r^2 + J) [1]; radius [m].
    """
    g = GRAVITY_M_S2
    cross = omega_1 * omega_2
    gyro = (1.0 - factor) * radius * spin
    a_x = factor * (g * slope_x + omega_2 * omega_2 * x - cross * y) + gyro * omega_1
    a_y = factor * (g * slope_y + omega_1 * omega_1 * y - cross * x) + gyro * omega_2
    return a_x, a_y, -(omega_1 * v_x + omega_2 * v_y) / radius


def tilt_sines(
    theta_rad: tuple[float, float], ratio: float | tuple[float, float]
) -> tuple[float, float]:
    """sin(phi_x), sin(phi_y) by Eq. 14 [1] from the servo angles; `ratio` = 2 R_d/L, or that of
    each axis.
    """
    x, y = ratio if isinstance(ratio, tuple) else (ratio, ratio)
    return x * sin(theta_rad[0]), y * sin(theta_rad[1])


def plate_rotation(sines: tuple[float, float]) -> np.ndarray:
    """World from plate (3, 3): the shortest turn with sines = (sin phi_x, sin phi_y).

    Positive sines lower the +x and +y sides. Columns are the plate's axes in the world; the third
    row is (-sin phi_x, -sin phi_y, c).
    """
    s_x, s_y = sines
    c = sqrt(1.0 - s_x * s_x - s_y * s_y)
    cross = -s_x * s_y / (1.0 + c)
    return np.array(
        [
            [1.0 - s_x * s_x / (1.0 + c), cross, s_x],
            [cross, 1.0 - s_y * s_y / (1.0 + c), s_y],
            [-s_x, -s_y, c],
        ]
    )
