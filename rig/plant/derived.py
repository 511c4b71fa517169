"""What follows from a table's own numbers: the plant's record completed, as one compiled function.

Numbers of the rig file and of its effects stand in the record as they are given; everything that
the step needs besides is computed from them here, so that a record whose numbers were changed, in
Python or in an exported model, is completed by the same equations.
"""

from math import exp

from rig.compiled import compiled
from rig.parameters import GEARS_INERTIA_HIGH_KG_M2, GRAVITY_M_S2
from rig.plant.position_servo import THREE_ARMS
from rig.plant.shaft import relaxation
from rig.three_arms import arm_angle


@compiled
def held_share(settling_s, step_s):
    """Share of its speed that a motor keeps over a step while dry friction stops it [1]; 0 where it
    stops at once (settling_s = 0)."""
    return exp(-step_s / settling_s) if settling_s > 0.0 else 0.0


@compiled
def derive(p):
    """Fill the derived fields of p (record PLANT) from those given, in place.

    Given: gain [rad/s/V] and time_constant [s] of the servo, torque_per_volt [N m/V], stiffness and
    damping of the shafts, plate_inertia [kg m2], frictions [N m], settling time [s], lengths [m],
    mass, play and its offset [rad], step_s. Derived: damping and inertias, the play's ends, what
    one step makes of a torque: speeds, not accelerations, so that no step divides.
    """
    h = p.step_s
    load = GEARS_INERTIA_HIGH_KG_M2 + p.plate_inertia
    p.arm_inertia = GEARS_INERTIA_HIGH_KG_M2
    p.arm_per_torque, p.plate_per_torque = h / p.arm_inertia, h / p.plate_inertia
    p.arm_stick = p.arm_friction * p.arm_per_torque
    p.plate_stick = p.joint_friction * p.plate_per_torque
    for a in range(2):
        p.motor_damping[a] = p.torque_per_volt[a] / p.gain  # B = A/K
        p.motor_inertia[a] = p.time_constant * p.motor_damping[a] - load  # J = tau B
        p.motor_per_torque[a] = h / p.motor_inertia[a]
        p.motor_per_volt[a] = p.torque_per_volt[a] * p.motor_per_torque[a]
        p.friction_held[a] = held_share(p.coulomb_friction_settling_s[a], h)
        half = p.gear_backlash_play_rad[a] / 2
        p.gear_1[a] = p.gear_backlash_offset_rad[a] + half
        p.gear_2[a] = p.gear_backlash_offset_rad[a] - half
        half = p.joint_backlash_play_rad[a] / 2
        p.joint_1[a] = p.joint_backlash_offset_rad[a] + half
        p.joint_2[a] = p.joint_backlash_offset_rad[a] - half
        p.gear_decay[a] = relaxation(p.gear_k[a], p.gear_c[a], h)
        p.joint_decay[a] = relaxation(p.joint_k[a], p.joint_c[a], h)
        p.half_side[a] = p.plate_side[a] / 2
        arms = p.linkage == THREE_ARMS  # their angle is the plate's own
        p.ratio[a] = 1.0 if arms else 2 * p.arm_radius[a] / p.plate_side[a]
        # torque at the servo per metre of the ball's offset
        p.weight[a] = p.felt_weight[a] = p.mass * GRAVITY_M_S2 * p.ratio[a]
    if p.linkage == THREE_ARMS:
        size = (p.base_radius, p.plate_radius, p.arm_length, p.rod_length)
        p.level_arm = arm_angle(0, 0.0, 0.0, p.height, size)
