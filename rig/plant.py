"""The whole table as one compiled function: volts in, two drives, plate and ball one tick on.

Per axis three inertias in a row: motor -(gear: stiffness, damping, play)- arm with the encoder
-(joint: the same)- plate; all angles at the servo's load shaft. Symplectic Euler at `step_s`
(0.1 ms): speeds from the torques at the old angles, angles from the new speeds; dry friction
implicitly. First order in the step, and energy stays bounded.
"""

from math import ceil, nan

import numpy as np

from rig import effect_equations as equations
from rig.ball import plate_rates, plate_sines, rolling, velocity
from rig.compiled import compiled
from rig.parameters import GRAVITY_M_S2
from rig.shaft import backlash_angle, shaft_torque
from rig.unknown import unknown_acceleration, unknown_volts

# Rows of the state, one column per axis.
MOTOR, MOTOR_RATE, ARM, ARM_RATE, PLATE, PLATE_RATE, GEAR_LOST, JOINT_LOST = range(8)
BALL, BALL_W, SPIN = range(8, 11)
STATE_ROWS = 11
# Columns of what the light saw: ball, sines of the plate's tilt, ball velocity, time.
SEEN_X, SEEN_Y, SEEN_SX, SEEN_SY, SEEN_VX, SEEN_VY, SEEN_T = range(7)


def rest(ball_xy_m: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """State (STATE_ROWS, 2) of a table at rest: servos at zero, ball where it was placed."""
    state = np.zeros((STATE_ROWS, 2))
    state[BALL] = ball_xy_m
    return state


@compiled
def effective_volts(p, a, volts_x, volts_y, theta, omega, t):
    """Volts that turn motor `a` after every servo-side effect but friction and delay [V]."""
    v = volts_x if a == 0 else volts_y
    v = equations.saturation(v, p.saturation_limit_V[a])
    v = equations.supply_sag(v, volts_x, volts_y, p.supply_sag_drop_1_V[a])
    v = equations.dead_zone(v, p.dead_zone_positive_V[a], p.dead_zone_negative_V[a])
    v = equations.gain_asymmetry(v, p.gain_asymmetry_fraction[a])
    v = equations.gain_drift(v, t, p.gain_drift_rate_1_s[a])
    v = equations.voltage_offset(v, p.voltage_offset_offset_V[a])
    if p.unknown.on:
        v += unknown_volts(p.unknown, a, theta, omega, t)
    return equations.cogging(
        v,
        theta,
        p.cogging_amplitude_V[a],
        p.cogging_phase_rad[a],
        p.cogging_periods_per_turn[a],
    )


@compiled
def felt_angle(p, a, theta):
    """theta_p: the servo angle that the plate feels behind the joint [rad]."""
    return (
        theta
        + equations.transmission_ripple(
            theta,
            p.transmission_ripple_amplitude_rad[a],
            p.transmission_ripple_phase_rad[a],
            p.transmission_ripple_periods_per_turn[a],
        )
        + equations.linkage_quadratic(theta, p.linkage_quadratic_coefficient_1_rad[a])
        + equations.linkage_cubic(theta, p.linkage_cubic_coefficient_1_rad2[a])
    )


@compiled
def felt_slope(p, a, theta):
    """d(theta_p)/d(theta) by a central difference: the plate's rate needs it [1]."""
    e = 1e-6
    if (
        p.transmission_ripple_amplitude_rad[a] == 0.0
        and p.linkage_quadratic_coefficient_1_rad[a] == 0.0
        and p.linkage_cubic_coefficient_1_rad2[a] == 0.0
    ):
        return 1.0
    return (felt_angle(p, a, theta + e) - felt_angle(p, a, theta - e)) / (2.0 * e)


@compiled
def drive_step(s, p, a, volts, ball_torque):
    """One axis of the drive, one step: motor, gear shaft, arm, joint shaft, plate. Changes `s`."""
    h = p.step_s
    gear = s[MOTOR, a] - s[ARM, a]
    joint = s[ARM, a] - s[PLATE, a]
    t_gear = shaft_torque(
        p.shaft_model, gear, s[MOTOR_RATE, a] - s[ARM_RATE, a], s[GEAR_LOST, a],
        p.gear_1[a], p.gear_2[a], p.gear_k[a], p.gear_c[a],
    )  # fmt: skip
    t_joint = shaft_torque(
        p.shaft_model, joint, s[ARM_RATE, a] - s[PLATE_RATE, a], s[JOINT_LOST, a],
        p.joint_1[a], p.joint_2[a], p.joint_k[a], p.joint_c[a],
    )  # fmt: skip
    dry = p.torque_per_volt[a] * equations.friction_volts(
        s[MOTOR_RATE, a],
        p.coulomb_friction_friction_V[a],
        p.stribeck_friction_extra_V[a],
        p.stribeck_friction_speed_rad_s[a],
    )
    torque = p.torque_per_volt[a] * volts - p.motor_damping[a] * s[MOTOR_RATE, a] - t_gear
    motor = s[MOTOR_RATE, a] + h * torque / p.motor_inertia[a]
    s[MOTOR_RATE, a] = equations.stick(motor, h * dry / p.motor_inertia[a])
    arm = s[ARM_RATE, a] + h * (t_gear - t_joint) / p.arm_inertia
    s[ARM_RATE, a] = equations.stick(arm, h * p.arm_friction / p.arm_inertia)
    plate = s[PLATE_RATE, a] + h * (t_joint + ball_torque) / p.plate_inertia
    s[PLATE_RATE, a] = equations.stick(plate, h * p.joint_friction / p.plate_inertia)
    for row in (MOTOR, ARM, PLATE):
        s[row, a] += h * s[row + 1, a]
    if abs(s[MOTOR, a]) > p.stop_rad:  # the end stop takes all the speed
        s[MOTOR, a] = min(max(s[MOTOR, a], -p.stop_rad), p.stop_rad)
        s[MOTOR_RATE, a] = 0.0
    s[GEAR_LOST, a] = backlash_angle(
        gear, s[MOTOR, a] - s[ARM, a], s[GEAR_LOST, a], p.gear_1[a], p.gear_2[a], p.gear_decay[a]
    )
    s[JOINT_LOST, a] = backlash_angle(
        joint, s[ARM, a] - s[PLATE, a], s[JOINT_LOST, a],
        p.joint_1[a], p.joint_2[a], p.joint_decay[a],
    )  # fmt: skip


@compiled
def plate_motion(s, p):
    """sin(phi_x), sin(phi_y), omega_1, omega_2 of the plate in its present state."""
    tx, ty = s[PLATE, 0], s[PLATE, 1]
    fx, fy = felt_angle(p, 0, tx), felt_angle(p, 1, ty)
    cross_x, cross_y = p.cross_coupling_fraction[0], p.cross_coupling_fraction[1]
    s_x, s_y = plate_sines(fx, fy, p.ratio, cross_x, cross_y)
    rate_x, rate_y = (
        felt_slope(p, 0, tx) * s[PLATE_RATE, 0],
        felt_slope(p, 1, ty) * s[PLATE_RATE, 1],
    )
    o1, o2 = plate_rates(fx, fy, rate_x, rate_y, p.ratio, cross_x, cross_y, s_x, s_y)
    return s_x, s_y, o1, o2


@compiled
def ball_step(s, p, t, push_x, push_y, held):
    """The ball, one step; a held ball keeps its place on the plate. Changes `s`."""
    s_x, s_y, o1, o2 = plate_motion(s, p)
    r, h = p.radius, p.step_s
    if held:
        s[BALL_W, 0], s[BALL_W, 1], s[SPIN, 0] = r * o2, -r * o1, 0.0
        return
    v_x, v_y = velocity(s[BALL_W, 0], s[BALL_W, 1], o1, o2, r)
    slope_x = s_x + p.level_offset_slope_rad[0] + p.level_drift_rate_rad_s[0] * t
    slope_y = s_y + p.level_offset_slope_rad[1] + p.level_drift_rate_rad_s[1] * t
    a_x, a_y, spin = rolling(
        s[BALL, 0], s[BALL, 1], v_x, v_y, s[SPIN, 0], slope_x, slope_y, o1, o2, p.factor, r
    )
    bowl, drag = p.plate_bowl_stiffness_1_s2[0], p.viscous_drag_rate_1_s[0]
    a_x += push_x + equations.plate_bowl(s[BALL, 0], bowl) + equations.viscous_drag(v_x, drag)
    a_y += push_y + equations.plate_bowl(s[BALL, 1], bowl) + equations.viscous_drag(v_y, drag)
    if p.unknown.on:
        x, y = s[BALL, 0] / p.half_side, s[BALL, 1] / p.half_side
        a_x += unknown_acceleration(p.unknown, 0, x, y, v_x, t)
        a_y += unknown_acceleration(p.unknown, 1, x, y, v_y, t)
    v_x, v_y = v_x + h * a_x, v_y + h * a_y
    kept = equations.rolling_resistance(v_x, v_y, p.rolling_resistance_deceleration_m_s2[0], h)
    v_x, v_y = v_x * kept, v_y * kept
    s[SPIN, 0] += h * spin
    s[BALL, 0] += h * v_x
    s[BALL, 1] += h * v_y
    if p.walls:
        reach = p.half_side - r
        for a in range(2):
            v = v_x if a == 0 else v_y
            if abs(s[BALL, a]) > reach and v * s[BALL, a] > 0.0:
                s[BALL, a] = reach if s[BALL, a] > 0.0 else -reach
                if a == 0:
                    v_x = -p.wall_restitution * v
                else:
                    v_y = -p.wall_restitution * v
    s[BALL_W, 0], s[BALL_W, 1] = v_x + r * o2, v_y - r * o1


@compiled
def off_plate(s, p):
    """True when the ball's contact point has left the plate: it falls and touches nothing more."""
    return not p.walls and (abs(s[BALL, 0]) > p.half_side or abs(s[BALL, 1]) > p.half_side)


@compiled
def advance(s, p, history, t, ticks_s, push_x, push_y, held, exposure_s, seen):
    """Move the plant from `t` over one control tick of `ticks_s` seconds; True when the ball falls.

    s (STATE_ROWS, 2) changes in place; history (n, 2) holds the volts applied (see `no_volts`), the
    present tick's first; `seen` (7,) is filled at the step in which `exposure_s` (the next one due,
    inf for none) has passed, else its time is NaN. The ball falls when its contact point leaves
    the plate.
    """
    h = p.step_s
    n = int(round(ticks_s / h))
    seen[SEEN_T] = nan
    weight = p.mass * GRAVITY_M_S2 * p.ratio
    fallen = off_plate(s, p)
    for i in range(n):
        now = t + i * h
        x, y = s[BALL, 0], s[BALL, 1]
        for a in range(2):
            late = p.input_delay_delay_s[a] - (i + 0.5) * h
            back = min(int(ceil(late / ticks_s)), history.shape[0] - 1) if late > 0.0 else 0
            volts = effective_volts(
                p, a, history[back, 0], history[back, 1], s[ARM, a], s[ARM_RATE, a], now
            )
            load = 0.0 if held or fallen else weight * s[BALL, a]
            drive_step(s, p, a, volts, load)
        if not fallen:
            ball_step(s, p, now, push_x, push_y, held)
            fallen = off_plate(s, p)
        if np.isnan(seen[SEEN_T]) and exposure_s <= now + h:
            part = min(max((exposure_s - now) / h, 0.0), 1.0)
            s_x, s_y, o1, o2 = plate_motion(s, p)
            seen[SEEN_X] = x + part * (s[BALL, 0] - x)
            seen[SEEN_Y] = y + part * (s[BALL, 1] - y)
            seen[SEEN_SX], seen[SEEN_SY] = s_x, s_y
            seen[SEEN_VX], seen[SEEN_VY] = velocity(s[BALL_W, 0], s[BALL_W, 1], o1, o2, p.radius)
            seen[SEEN_T] = exposure_s
    return fallen
