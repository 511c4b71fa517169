"""The SRV02 in high gear, as its manual has it."""

from rig.parameters import (
    GEAR_RATIO_HIGH,
    GEARBOX_EFFICIENCY,
    GEARS_INERTIA_HIGH_KG_M2,
    torque_per_volt,
)

MOTOR_BACK_EMF_V_S = 7.68e-3


def nominal_servo(
    *, rotor_kg_m2: float = 3.90e-7, tachometer_kg_m2: float = 7.06e-8, viscous_nm_s: float = 0.015
) -> tuple[float, float]:
    """Gain K [rad/s/V] and time constant tau [s] of the SRV02 in high gear, from its manual.

    J_eq = eta_g K_g^2 J_m + J_gears; B = B_eq + (eta_g eta_m K_g^2 k_t k_m)/R_m; K = A/B and tau =
    J_eq/B with A = `torque_per_volt()`. rotor_kg_m2 + tachometer_kg_m2 = J_m at the motor's shaft;
    viscous_nm_s = B_eq at the load shaft.
    """
    per_volt = torque_per_volt()
    inertia = (
        GEARBOX_EFFICIENCY * GEAR_RATIO_HIGH**2 * (rotor_kg_m2 + tachometer_kg_m2)
        + GEARS_INERTIA_HIGH_KG_M2
    )
    damping = viscous_nm_s + per_volt * GEAR_RATIO_HIGH * MOTOR_BACK_EMF_V_S
    return per_volt / damping, inertia / damping
