"""The servo's part of the predictor: volts to the encoder's next count.

Per axis a first-order motor (K, tau) exactly over a tick, with every servo-side effect by the
simulator's own equation, and a Kalman filter over angle and speed. Inside a gap of the gears the
motor is alone and unseen.
"""

from math import exp, sqrt

from rig import effect_equations as equations
from rig.compiled import compiled
from rig.plant import effective_volts
from rig.shaft import play_operator


@compiled
def delayed_volts(volts, k, a, dt, delay_s):
    """Mean of the volts that reach motor `a` during tick k when they come `delay_s` late [V]."""
    whole = int(delay_s / dt)
    part = delay_s / dt - whole
    new, old = max(k - whole, 0), max(k - whole - 1, 0)
    return (1.0 - part) * volts[new, a] + part * volts[old, a] if part > 0.0 else volts[new, a]


@compiled
def servo_step(p, a, motor, speed, volts, gain, tau, dt, free_gap):
    """Motor angle and speed a tick later: first order exactly, then dry friction.

    In contact the motor also turns arm and plate and their friction; inside a gap it is alone.
    """
    if free_gap:
        tau *= p.motor_inertia[a] / (p.motor_inertia[a] + p.arm_inertia + p.plate_inertia)
    decay = exp(-dt / tau)
    load = 0.0 if free_gap else (p.arm_friction + p.joint_friction) / p.torque_per_volt[a]
    dry = load + equations.friction_volts(
        speed,
        p.coulomb_friction_friction_V[a],
        p.stribeck_friction_extra_V[a],
        p.stribeck_friction_speed_rad_s[a],
    )
    target = gain * volts
    free = target + (speed - target) * decay
    after = equations.stick(free, gain * dry * (1.0 - decay))
    # The mean speed over the tick: exact for the first-order motor, dry friction on both ends.
    mean = target + (speed - target) * tau * (1.0 - decay) / dt
    return motor + dt * (mean + 0.5 * (after - free)), after


@compiled
def predict_servo(p, levels, t, volts, theta, gain, tau, out, std):
    """Fill `out` and `std` (n, 2): the encoder's innovations [rad] and what the filter expects."""
    n = t.shape[0]
    r = levels.servo_measured**2
    for a in range(2):
        beta_1, beta_2 = p.gear_1[a], p.gear_2[a]
        arm, motor, speed = theta[0, a], theta[0, a], 0.0
        p00, p01, p11 = r, 0.0, 1.0
        for k in range(n - 1):
            dt = t[k + 1] - t[k]
            delay = p.input_delay_delay_s[a]
            v_x = delayed_volts(volts, k, 0, dt, delay)
            v_y = delayed_volts(volts, k, 1, dt, delay)
            v = effective_volts(p, a, v_x, v_y, arm, speed, t[k])
            free_gap = motor - beta_1 < arm < motor - beta_2
            motor, speed = servo_step(p, a, motor, speed, v, gain, tau, dt, free_gap)
            arm = play_operator(arm, motor, beta_1, beta_2)
            decay = exp(-dt / tau)
            reach = tau * (1.0 - decay)
            q = levels.servo_process**2 * dt
            p00 += 2.0 * reach * p01 + reach * reach * p11 + q * dt * dt / 3.0
            p01 = decay * (p01 + reach * p11) + 0.5 * q * dt
            p11 = decay * decay * p11 + q
            total = p00 + r
            miss = theta[k + 1, a] - arm
            out[k + 1, a], std[k + 1, a] = miss, sqrt(total)
            held = motor - beta_1 < arm < motor - beta_2
            g0, g1 = p00 / total, p01 / total
            arm += g0 * miss
            if held:  # inside the gap the encoder says nothing of the motor
                continue
            motor += g0 * miss
            speed += g1 * miss
            p11 -= g1 * p01
            p01 -= g0 * p01
            p00 -= g0 * p00
