"""The servo's part of the predictor: volts to the encoder's next count.

Per axis a first-order motor (K, tau) exactly over a tick, with every servo-side effect by the
simulator's own equation, and a Kalman filter over angle and speed. Inside a gap of the gears the
motor is alone and unseen.
"""

from math import ceil, exp, log, sqrt

from rig.compiled import compiled, inlined
from rig.plant import effect_equations as equations
from rig.plant.derived import held_share
from rig.plant.plant import effective_volts
from rig.plant.shaft import EXACT, dead_zone, play_operator, shaft_torque

LONGEST_STEP_S = 0.0025  # dry friction is one decision a step: at a slow tick take several
WINDING_STEP_S = 0.001  # a shaft that winds up against friction swings
LANDING_STEP_S = 6.7e-4  # and a motor lands on it at speed where the gear has play
MEETING_STEP_S = 2.5e-4  # teeth that meet part again after 6 ms
MEETING_UNSURE = 10.0  # times the process noise: when and how hard the teeth meet
TOUCH_RAD = 1e-4  # ends of the gap closer than this are touching
FIRST_SPEED_RAD_S = 1.0  # deviation of a speed that nothing is known of yet; chosen
HELD_GAIN = 1.0 / 3.0  # by which a motor that friction holds follows its encoder, at least


@compiled
def delayed_volts(volts, k, a, dt, delay_s):
    """Mean of the volts that reach motor `a` during tick k when they come `delay_s` late [V].

    volts (n, 2); dt: length of the tick [s].
    """
    if delay_s == 0.0:
        return volts[k, a]
    whole = int(delay_s / dt)
    part = delay_s / dt - whole
    new, old = max(k - whole, 0), max(k - whole - 1, 0)
    return (1.0 - part) * volts[new, a] + part * volts[old, a] if part > 0.0 else volts[new, a]


@compiled
def servo_step(p, a, motor, speed, variance, volts, gain, decay, share, free_gap, dt):
    """Motor angle [rad] and speed [rad/s] of axis `a` after dt.

    p: record PLANT; variance: of the speed, as the filter knows it [rad2/s2]; gain: K [rad/s/V];
    decay, share: what is left of a speed after dt and of its mean over dt [1] (`_decays`);
    free_gap: the motor turns alone inside the gear's gap, without the arm's friction. First order
    exactly, then dry friction; soft friction is viscous friction. Both it and the Stribeck excess
    are those of the speed in the step's middle. A speed known to +-s feels the mean of the Stribeck
    excess over N(omega, s^2): the bell of width v becomes sqrt(v^2 + 2 s^2) wide and lower by the
    ratio of both.
    """
    bell = p.stribeck_friction_speed_rad_s[a]
    extra = p.stribeck_friction_extra_V[a]
    if extra != 0.0:
        wide = sqrt(bell * bell + 2.0 * variance)
        extra, bell = extra * bell / wide, wide
    dry = equations.friction_volts(speed, p.coulomb_friction_friction_V[a], extra, bell)
    fraction, soft = p.viscous_asymmetry_fraction_1[a], p.coulomb_friction_softness_rad_s[a]
    more = 0.0
    if fraction != 0.0:
        more = fraction if speed > 0.0 or (speed == 0.0 and volts > 0.0) else -fraction
    if soft > 0.0:  # a viscous friction that depends on the speed: on that in the step's middle
        slower, left, _ = _braked(gain, decay, more + gain * dry * equations.softened(speed, soft))
        middle = slower * volts + (speed - slower * volts) * sqrt(left)
        more += gain * dry * equations.softened(middle, soft)
        dry = 0.0
    if more != 0.0:
        gain, decay, share = _braked(gain, decay, more)
    dry += 0.0 if free_gap else p.arm_friction / p.torque_per_volt[a]
    target = gain * volts
    free = target + (speed - target) * decay
    held = held_share(p.coulomb_friction_settling_s[a], dt)
    after = equations.dry_friction(free, speed, gain * dry * (1.0 - decay), held, 0.0)
    if extra != 0.0 and soft == 0.0:
        dry -= equations.friction_volts(speed, 0.0, extra, bell)
        dry += equations.friction_volts(0.5 * (speed + after), 0.0, extra, bell)
        after = equations.dry_friction(free, speed, gain * dry * (1.0 - decay), held, 0.0)
    # The mean speed over the tick: exact for the first-order motor, dry friction on both ends.
    mean = target + (speed - target) * share
    return motor + dt * (mean + 0.5 * (after - free)), after


@compiled
def _braked(gain, decay, more):
    """K, decay and share (as of `_decays`) of a motor whose viscous friction is 1 + more times its
    own."""
    rate = -log(decay) * (1.0 + more)
    decay = exp(-rate)
    return gain / (1.0 + more), decay, (1.0 - decay) / rate


@compiled
def _decays(tau, dt):
    """Shares of a speed and of its mean that are left after and over dt."""
    decay = exp(-dt / tau)
    return decay, tau * (1.0 - decay) / dt


@compiled
def _winding(p, a):
    """Both shafts between motor and plate as one: stiffness [N m/rad] and ends of the play; and the
    twist at which the joint's friction lets go [rad]."""
    k = p.gear_k[a] * p.joint_k[a] / (p.gear_k[a] + p.joint_k[a])
    half = 0.5 * p.joint_backlash_play_rad[a]
    up = p.gear_1[a] + p.joint_backlash_offset_rad[a] + half
    down = p.gear_2[a] + p.joint_backlash_offset_rad[a] - half
    return k, up, down, p.joint_friction / k


@compiled
def plate_torque(winding, motor, anchor):
    """Torque with which a sticking plate loads the motor [N m], and where it sticks [rad].

    winding: of `_winding`; motor: its angle [rad]; anchor: angle of the plate before. Between plate
    and motor lie both shafts with their play; they wind up until the joint's friction lets go.
    """
    k, up, down, twist = winding
    if twist == 0.0:
        return 0.0, motor
    anchor = play_operator(anchor, motor, up + twist, down - twist)
    return k * dead_zone(motor - anchor, up, down), anchor


@compiled
def held_arm(p, a, arm, anchor, torque):
    """Angle of the arm in the gear's gap [rad], which a plate that sticks at `anchor` holds.

    p: record PLANT; arm: its angle before [rad]. The joint's shaft is unwound there. torque: of the
    gear's shaft [N m]; where it is not 0, or the joint has no friction, `arm` is returned
    unchanged.
    """
    if p.joint_friction == 0.0 or torque != 0.0:
        return arm
    middle, half = p.joint_backlash_offset_rad[a], 0.5 * p.joint_backlash_play_rad[a]
    return min(max(arm, anchor + middle - half), anchor + middle + half)


@compiled
def light_arm(p, a, arm, arm_speed, motor, speed, beta_1, beta_2, h):
    """Torque of the gear's shaft [N m], angle [rad] and speed [rad/s] of the arm after h [s].

    p: record PLANT; arm, arm_speed, motor, speed: angles [rad] and speeds [rad/s] of arm and motor
    before. For a joint without friction: arm and plate are one body that light friction brakes; it
    coasts through the gap from beta_2 to beta_1 [rad] and bounces at its ends.
    """
    twist = motor - arm
    lost = min(max(twist, beta_2), beta_1)
    torque = shaft_torque(
        EXACT, twist, speed - arm_speed, lost, beta_1, beta_2, p.gear_k[a], p.gear_c[a]
    )
    pushed = arm_speed + h * torque / (p.arm_inertia + p.plate_inertia)
    arm_speed = equations.stick(pushed, h / p.gear_coast[a])
    return torque, arm + h * arm_speed, arm_speed


@compiled
def _depth(motor, arm, beta_1, beta_2):
    """How far inside the gap the arm is, from the nearer end [rad]; 0 in contact."""
    return max(min(arm - motor + beta_1, motor - beta_2 - arm), 0.0)


@inlined
def _longest_step(p, has_backlash, coasts):
    """Longest part of a tick that still resolves what happens in the gear [s]."""
    if coasts:
        return MEETING_STEP_S
    if p.joint_friction > 0.0:
        return LANDING_STEP_S if has_backlash else WINDING_STEP_S
    return LONGEST_STEP_S


@inlined
def _corrected(miss, depth, r, states, cov):
    """The Kalman update by an encoder reading that is `miss` beside the arm [rad].

    r: variance of the reading [rad2]; states: motor, speed, arm, arm's speed, anchor; cov: of motor
    and speed (p00, p01, p11), of the arm (still, s01, s11). Returns the innovation's standard
    deviation, the states and the covariances after the update.
    """
    motor, speed, arm, arm_speed, anchor = states
    p00, p01, p11, still, s01, s11 = cov
    # Inside the gap the arm says nothing of the motor; at its ends the two are one. `c` is how
    # surely they touch, as far as the motor's place is known.
    c = exp(-0.5 * depth * depth / (p00 + TOUCH_RAD**2)) if depth > 0.0 else 1.0
    spread = c * c * p00 + (1.0 - c) * (1.0 - c) * still
    total = spread + r
    arm += spread / total * miss
    arm_speed += (c * p01 + (1.0 - c) * s01) / total * miss
    still = spread * r / total
    g0, g1 = c * p00 / total, c * p01 / total
    # A motor that friction holds gives the same count again and again: its rounding does not
    # average out, and a filter that believes so takes friction for something that misleads it.
    if speed == 0.0:
        g0 = max(g0, HELD_GAIN)
    motor += g0 * miss
    anchor += g0 * miss  # the twist is known from the motion, better than from the encoder
    speed += g1 * miss
    p11 -= g1 * c * p01
    p01 -= c * p00 / total * c * p01
    p00 -= c * p00 / total * c * p00
    s11 = c * p11 + (1.0 - c) * max(s11 - s01 * s01 / total, 0.0)
    s01 = c * p01 + (1.0 - c) * s01 * r / total
    return sqrt(total), (motor, speed, arm, arm_speed, anchor), (p00, p01, p11, still, s01, s11)


@inlined
def _known_once(r, off):
    """The covariances `cov` of `_corrected` at a first reading of variance r [rad2], the speed off
    by about `off` [rad/s]."""
    return r, 0.0, FIRST_SPEED_RAD_S**2 + off * off, r, 0.0, 0.0


@compiled
def predict_axis(p, levels, a, t, volts, theta, ball, corrected, resumed, gain, tau, out, std):
    """Fill column `a` of `out` and `std` (n, 2) [rad]: encoder innovations and their deviations.

    p: record PLANT; levels: record NOISE; t (n,) [s], volts (n, 2) [V], theta (n, 2) [rad]; ball
    (n, 2): its place [m], which turns the motor by p.felt_weight [N m/m] but in the gear's gap;
    gain: K [rad/s/V]; tau: time constant [s]; corrected (n,): rows whose angle corrects the filter;
    resumed (n,): those after a hole, where all is moved to what the encoder says, at a speed known
    no better than at first. The first row, these and those that correct nothing stay as they were.
    """
    r = levels.servo_measured[a] ** 2
    beta_1, beta_2 = p.gear_1[a], p.gear_2[a]
    arm, motor, speed = theta[0, a], theta[0, a], 0.0
    p00, p01, p11, still, s01, s11 = _known_once(r, 0.0)
    delay, torque, arm_speed, anchor = p.input_delay_delay_s[a], 0.0, 0.0, motor
    coasts = p.gear_coast[a] > 0.0 and beta_1 > beta_2
    longest, winding = _longest_step(p, beta_1 > beta_2, coasts), _winding(p, a)
    alone = tau * p.motor_inertia[a] / (p.motor_inertia[a] + p.arm_inertia + p.plate_inertia)
    h, decay, share, free_decay, free_share = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(t.shape[0] - 1):
        dt = t[k + 1] - t[k]
        parts = int(ceil(dt / longest - 1e-9))
        if abs(dt / parts - h) > 1e-12:  # a clock that ticks evenly decays evenly
            h = dt / parts
            (decay, share), (free_decay, free_share) = _decays(tau, h), _decays(alone, h)
        q, reach = levels.servo_process[a] ** 2 * h, h * share
        v_x, v_y = delayed_volts(volts, k, 0, dt, delay), delayed_volts(volts, k, 1, dt, delay)
        for i in range(parts):
            v = effective_volts(p, a, v_x, v_y, arm, speed, t[k] + i * h)
            gap = _depth(motor, arm, beta_1, beta_2)
            free_gap = gap > TOUCH_RAD and gap > TOUCH_RAD + sqrt(p00)
            p00 += max(2.0 * reach * p01 + reach * reach * p11, -0.5 * p00) + q * h * h / 3.0
            p01 = decay * (p01 + reach * p11) + 0.5 * q * h
            p11 = decay * decay * p11 + q
            if coasts:
                torque, arm, arm_speed = light_arm(
                    p, a, arm, arm_speed, motor, speed, beta_1, beta_2, h
                )
                still += max(2.0 * h * s01 + h * h * s11, -0.5 * still) + q * h * h / 3.0
                s01, s11 = s01 + h * s11 + 0.5 * q * h, s11 + MEETING_UNSURE * q
            else:
                torque, anchor = plate_torque(winding, motor, anchor)
            free = free_gap or coasts
            v -= (torque - (not free) * p.felt_weight[a] * ball[k, a]) / p.torque_per_volt[a]
            left, mean = (free_decay, free_share) if free else (decay, share)
            motor, speed = servo_step(p, a, motor, speed, p11, v, gain, left, mean, free, h)
            if not coasts:
                arm = play_operator(arm, motor - torque / p.gear_k[a], beta_1, beta_2)
                arm = held_arm(p, a, arm, anchor, torque)
        miss = theta[k + 1, a] - arm
        if resumed[k + 1]:
            motor, arm, anchor = motor + miss, arm + miss, anchor + miss
            p00, p01, p11, still, s01, s11 = _known_once(r, miss / dt)
            continue
        if not corrected[k + 1]:
            continue
        states, cov = (motor, speed, arm, arm_speed, anchor), (p00, p01, p11, still, s01, s11)
        depth, out[k + 1, a] = _depth(motor, arm, beta_1, beta_2), miss
        std[k + 1, a], states, cov = _corrected(miss, depth, r, states, cov)
        motor, speed, arm, arm_speed, anchor = states
        p00, p01, p11, still, s01, s11 = cov
