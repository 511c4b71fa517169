"""Disturbance-observer control: the paper's Eq. 9 in the loop, and nothing else.

T_e = (T_m - J_m s omega_m)/(tau s + 1) holds all that acts on the motor besides its own torque:
friction, and the load through the shaft. Its observed value Omega = K/(tau s + 1) T_e is turned
into volts and given back (Ohnishi's disturbance observer; IEE Japan 1987):

    V = V_servo + share Omega/A,   A = torque per volt.

A constant disturbance d moves a motor so driven as (1 - share K) d would; where the motor sticks
the same loop raises the volts by 1/(1 - share K). share K = 1 would be an integrator around dry
friction, which hunts. Play is not known to it.
"""

from rig.compiled import compiled

SHARE = 0.7


@compiled
def disturbance_volts(observed, torque_per_volt):
    """Volts share Omega/A against the observed torque Omega [N m]; torque_per_volt: A [N m/V]."""
    return SHARE * observed / torque_per_volt
