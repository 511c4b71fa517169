"""A shaft with play between two masses: the paper's Fig. 1 and Eqs. 1 to 8.

Symbols: theta_d = twist between the ends [rad], omega_d its rate [rad/s], theta_b = the part of it
lost in the play [rad], beta_2 <= theta_b <= beta_1 (symmetric play: -alpha, +alpha; full width
beta_1 - beta_2 = 2 alpha), k stiffness [N m/rad], c damping [N m s/rad], T_s shaft torque [N m].
"""

from math import exp

from rig.compiled import compiled, inlined

EXACT, DEAD_ZONE, NONE = 0, 1, 2


@compiled
def relaxation(stiffness, damping, step_s):
    """Factor exp(-k h/c) [1] by which theta_d - theta_b decays in one step out of contact (Eq. 5).

    stiffness k [N m/rad], damping c [N m s/rad], step_s = h. The exponential, not an explicit step:
    with c -> 0 Eq. 4 is stiff, and the factor tends to 0.
    """
    return exp(-stiffness * step_s / damping) if damping > 0 else 0.0


@inlined
def dead_zone(theta_d, beta_1, beta_2):
    """D_alpha of Eq. 8: the part of the twist outside the play [rad]."""
    return max(theta_d - beta_1, 0.0) + min(theta_d - beta_2, 0.0)


@inlined
def shaft_torque(model, theta_d, omega_d, theta_b, beta_1, beta_2, k, c):
    """T_s [N m]: Eq. 1 with Eq. 2 in contact and 0 out of it, Eq. 7, or a shaft without play.

    model: EXACT, DEAD_ZONE or NONE; the other arguments as above. Contact at +alpha can only push
    (T_s > 0), at -alpha only pull, which is what max(0, .) and min(0, .) of Eq. 6 say. With beta_1
    = beta_2 both hold and the shaft is an ordinary one.
    """
    if model == DEAD_ZONE:
        return k * dead_zone(theta_d, beta_1, beta_2)
    if model == NONE:
        return k * theta_d + c * omega_d
    torque = k * (theta_d - theta_b) + c * omega_d
    up = 1.0 if theta_b >= beta_1 else 0.0
    down = 1.0 if theta_b <= beta_2 else 0.0
    return up * max(torque, 0.0) + down * min(torque, 0.0)


@inlined
def backlash_angle(theta_d_before, theta_d_after, theta_b, beta_1, beta_2, decay):
    """theta_b one step later [rad]: Eq. 6 by its exact solution, Eq. 5, held at the play's ends.

    Out of contact theta_d - theta_b shrinks by `decay` = `relaxation(k, c, h)` while theta_d moves
    from theta_d_before to theta_d_after.
    """
    free = theta_d_after - (theta_d_before - theta_b) * decay
    return min(max(free, beta_2), beta_1)


@inlined
def play_operator(theta_p, theta, beta_1, beta_2):
    """The play operator theta_p <- min(max(theta_p, theta - beta_1), theta - beta_2) [rad].

    It is the angle behind a backlash whose driven side friction holds where it was left
    (python-control's `friction_backlash_nonlinearity`). theta drives; theta_p follows at theta -
    beta_1 when pushed up, at theta - beta_2 when pulled down.
    """
    return min(max(theta_p, theta - beta_1), theta - beta_2)


@inlined
def loaded_play(theta_p, theta, beta_1, beta_2, load, friction):
    """The play operator behind which a load that exceeds the friction [both N m] lays the driven
    side over to the end to which it pushes: theta - beta_2 upwards, theta - beta_1 downwards.
    """
    if abs(load) > friction:
        return theta - (beta_2 if load > 0.0 else beta_1)
    return play_operator(theta_p, theta, beta_1, beta_2)
