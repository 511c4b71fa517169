"""One step of the plant: pure functions from state to state, the same for one run and for many.

`p` is the plant's record or its `Constants`; `a` the axis. An axis's state is the tuple (motor,
motor_rate, arm, arm_rate, plate, plate_rate, gear_lost, joint_lost), the ball's (x, y, w_x, w_y,
spin), in the units of `plant.py`'s rows. No loop, no store, no call into a library: the compiler
turns a loop over runs into vector instructions.
"""

from rig.compiled import inlined
from rig.discrepancy import servo_discrepancy
from rig.plant import effect_equations as equations
from rig.plant.ball import plate_rates, plate_sines, rolling, velocity
from rig.plant.own_equations import SERVO, with_own
from rig.plant.shaft import backlash_angle, shaft_torque


@inlined
def commanded(p, a, volts_x, volts_y):
    """Volts that the amplifier of motor `a` gives for the volts asked of both motors [V].

    Saturation, supply sag, dead zone and gain asymmetry, in this order.
    """
    v = volts_x if a == 0 else volts_y
    v = equations.saturation(v, p.saturation_limit_V[a])
    v = equations.supply_sag(v, volts_x, volts_y, p.supply_sag_drop_1_V[a])
    v = equations.dead_zone(v, p.dead_zone_positive_V[a], p.dead_zone_negative_V[a])
    return equations.gain_asymmetry(v, p.gain_asymmetry_fraction[a])


@inlined
def delivered(p, a, volts, t):
    """Volts after gain drift and voltage offset at the run's time t [V]."""
    v = equations.gain_drift(volts, t, p.gain_drift_rate_1_s[a])
    return equations.voltage_offset(v, p.voltage_offset_offset_V[a])


@inlined
def cogged(p, a, volts, theta):
    """Volts plus the pull of the motor's poles at the angle theta, expressed in volts [V]."""
    return equations.cogging(
        volts,
        theta,
        p.cogging_amplitude_V[a],
        p.cogging_phase_rad[a],
        p.cogging_periods_per_turn[a],
    )


@inlined
def effective_volts(p, a, volts_x, volts_y, theta, omega, t):
    """Volts that turn motor `a` after every servo-side effect but friction and delay [V].

    volts_x, volts_y: asked of both motors [V]; theta [rad] and omega [rad/s]: angle at which the
    poles pull and speed of motor `a`; t: the run's time [s].
    """
    v = delivered(p, a, commanded(p, a, volts_x, volts_y), t)
    if p.unknown.on:
        v += servo_discrepancy(p.unknown, a, theta, omega, t)
    if p.own.servo:
        v = with_own(p.own, SERVO, a, v, theta, omega, t)
    return cogged(p, a, v, theta)


@inlined
def felt_angle(p, a, theta):
    """theta_p: the servo angle that the plate feels, from the angle theta behind the joint [rad].

    Transmission ripple and the linkage's quadratic and cubic terms are added to theta.
    """
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


@inlined
def felt_slope(p, a, theta):
    """d(theta_p)/d(theta), the derivative of `felt_angle` [1], for the plate's rate."""
    return (
        1.0
        + equations.transmission_ripple_slope(
            theta,
            p.transmission_ripple_amplitude_rad[a],
            p.transmission_ripple_phase_rad[a],
            p.transmission_ripple_periods_per_turn[a],
        )
        + equations.linkage_quadratic_slope(theta, p.linkage_quadratic_coefficient_1_rad[a])
        + equations.linkage_cubic_slope(theta, p.linkage_cubic_coefficient_1_rad2[a])
    )


@inlined
def joint_torque(p, a, twist, twist_rate, lost):
    """Torque of the joint's shaft between arm and plate on axis `a` [N m], of `shaft_torque`."""
    return shaft_torque(
        p.shaft_model,
        twist,
        twist_rate,
        lost,
        p.joint_1[a],
        p.joint_2[a],
        p.joint_k[a],
        p.joint_c[a],
    )


@inlined
def joint_play(p, a, twist_before, twist, lost):
    """What is lost in the joint's play on axis `a` after a step [rad], of `backlash_angle`."""
    return backlash_angle(twist_before, twist, lost, p.joint_1[a], p.joint_2[a], p.joint_decay[a])


@inlined
def plate_speed(p, rate, torque):
    """Rate of the plate about an axis [rad/s] after a step under `torque` and dry friction [N m],
    at the servo.
    """
    return equations.stick(rate + torque * p.plate_per_torque, p.plate_stick)


@inlined
def drive_step(p, a, volts, ball_torque, axis):
    """State of axis `a` (8 numbers) after one step of motor, gear, arm, joint and plate.

    volts: of `cogged` [V]; ball_torque: of the ball's weight on the plate, at the servo [N m];
    axis: the state before. Speeds come from the torques at the old angles, angles from the new
    speeds (symplectic Euler).
    """
    motor, motor_rate, arm, arm_rate, plate, plate_rate, gear_lost, joint_lost = axis
    h, gear, joint = p.step_s, motor - arm, arm - plate
    t_gear = shaft_torque(
        p.shaft_model,
        gear,
        motor_rate - arm_rate,
        gear_lost,
        p.gear_1[a],
        p.gear_2[a],
        p.gear_k[a],
        p.gear_c[a],
    )
    t_joint = joint_torque(p, a, joint, arm_rate - plate_rate, joint_lost)
    dry = equations.friction_volts(
        motor_rate,
        p.coulomb_friction_friction_V[a],
        p.stribeck_friction_extra_V[a],
        p.stribeck_friction_speed_rad_s[a],
    )
    braked = equations.braked_speed(motor_rate, p.viscous_asymmetry_fraction_1[a])
    torque = p.torque_per_volt[a] * volts - p.motor_damping[a] * braked - t_gear
    free = motor_rate + torque * p.motor_per_torque[a]
    motor_rate = equations.dry_friction(
        free,
        motor_rate,
        dry * p.motor_per_volt[a],
        p.friction_held[a],
        p.coulomb_friction_softness_rad_s[a],
    )
    arm_rate = equations.stick(arm_rate + (t_gear - t_joint) * p.arm_per_torque, p.arm_stick)
    plate_rate = plate_speed(p, plate_rate, t_joint + ball_torque)
    motor, arm, plate = motor + h * motor_rate, arm + h * arm_rate, plate + h * plate_rate
    motor_rate = 0.0 if abs(motor) > p.stop_rad else motor_rate  # the stop takes all the speed
    motor = min(max(motor, -p.stop_rad), p.stop_rad)
    gear_lost = backlash_angle(
        gear, motor - arm, gear_lost, p.gear_1[a], p.gear_2[a], p.gear_decay[a]
    )
    joint_lost = joint_play(p, a, joint, arm - plate, joint_lost)
    return motor, motor_rate, arm, arm_rate, plate, plate_rate, gear_lost, joint_lost


@inlined
def tilt(p, plate_x, rate_x, plate_y, rate_y):
    """sin(phi_x), sin(phi_y) [1], omega_1, omega_2 [rad/s] of the plate.

    plate_x, plate_y [rad] and rate_x, rate_y [rad/s]: angles and rates of the plate's side of the
    joints, at the servo.
    """
    fx, fy = felt_angle(p, 0, plate_x), felt_angle(p, 1, plate_y)
    cross_x, cross_y = p.cross_coupling_fraction[0], p.cross_coupling_fraction[1]
    s_x, s_y = plate_sines(fx, fy, p.ratio, cross_x, cross_y)
    rate_x, rate_y = felt_slope(p, 0, plate_x) * rate_x, felt_slope(p, 1, plate_y) * rate_y
    o1, o2 = plate_rates(fx, fy, rate_x, rate_y, p.ratio, cross_x, cross_y, s_x, s_y)
    return s_x, s_y, o1, o2


@inlined
def ball_step(p, t, push_x, push_y, motion, ball):
    """State of the ball (5 numbers) after one step on a plate in this motion.

    t: the run's time [s]; push_x, push_y: acceleration by the operator and the discrepancy [m/s2];
    motion: of `tilt`; ball: the state before. Symplectic Euler.
    """
    s_x, s_y, o1, o2 = motion
    x, y, w_x, w_y, spin = ball
    r, h = p.radius, p.step_s
    v_x, v_y = velocity(w_x, w_y, o1, o2, r)
    slope_x = s_x + p.level_offset_slope_rad[0] + p.level_drift_rate_rad_s[0] * t
    slope_y = s_y + p.level_offset_slope_rad[1] + p.level_drift_rate_rad_s[1] * t
    a_x, a_y, turn = rolling(x, y, v_x, v_y, spin, slope_x, slope_y, o1, o2, p.factor, r)
    bowl, drag = p.plate_bowl_stiffness_1_s2[0], p.viscous_drag_rate_1_s[0]
    a_x += push_x + equations.plate_bowl(x, bowl) + equations.viscous_drag(v_x, drag)
    a_y += push_y + equations.plate_bowl(y, bowl) + equations.viscous_drag(v_y, drag)
    v_x, v_y = v_x + h * a_x, v_y + h * a_y
    kept = equations.rolling_resistance(v_x, v_y, p.rolling_resistance_deceleration_m_s2[0], h)
    v_x, v_y = v_x * kept, v_y * kept
    x, y = x + h * v_x, y + h * v_y
    if p.walls:
        x, v_x = bounce(x, v_x, p.half_side[0] - r, p.wall_restitution)
        y, v_y = bounce(y, v_y, p.half_side[1] - r, p.wall_restitution)
    return x, y, v_x + r * o2, v_y - r * o1, spin + h * turn


@inlined
def bounce(x, v, reach, restitution):
    """Position [m] and speed [m/s] on one axis after a wall at +-`reach` [m].

    A ball beyond the wall that moves outwards is set onto it and turned back, its speed times
    -restitution.
    """
    out = abs(x) > reach and v * x > 0.0
    return min(max(x, -reach), reach) if out else x, -restitution * v if out else v


@inlined
def held_ball(p, motion, ball):
    """State of a held ball (5 numbers): it keeps its place on the plate and moves with it."""
    x, y, _, _, _ = ball
    _, _, o1, o2 = motion
    return x, y, p.radius * o2, -p.radius * o1, 0.0


@inlined
def off_plate(p, ball):
    """Whether the ball's contact point has left the plate; never, where there are walls."""
    return not p.walls and (abs(ball[0]) > p.half_side[0] or abs(ball[1]) > p.half_side[1])
