"""Smooth feedforward inverse: the play's inverse without its jump.

The exact inverse of a play of half width alpha jumps by 2 alpha where the wanted motion turns. The
smooth one (Zhou, Zhang and Wen, IEEE Trans. Automatic Control 52(3), 2007) weighs both sides,

    BI(u) = u + alpha chi_r(u') - alpha chi_l(u'),   chi_r,l = e^(+-k u')/(e^(k u') + e^(-k u')),

which is u + alpha tanh(k u'). *Joint play*: BI shifts the servo's reference. *Gear play*: the shift
belongs to the motor, which has no position loop of its own; its rate over the motor's gain K is
fed forward in volts. Nothing is fed back: how the play really lies is not looked at.
"""

from math import tanh

import numpy as np

from rig.compiled import compiled

WIDTH_RAD_S = 0.1  # 1/k: wanted rates below it move the shift little; above the rate's noise
LAG_S = 0.04  # of the filtered derivative

SMOOTH_STATE = np.dtype(
    [("ticks", np.int64, (2,)), ("slow", np.float64, (2,)), ("motor", np.float64, (2,))]
)


@compiled
def shift(half, rate):
    """alpha tanh(k u') [rad]; half: half width alpha [rad], rate: u' [rad/s]."""
    return half * tanh(rate / WIDTH_RAD_S)


@compiled
def filtered_rate(slow, a, wanted, tick_s, first):
    """s/(lag s + 1) of the wanted angle on axis `a` [rad/s].

    slow (2,): the filter's state [rad], changed in place; wanted [rad]; tick_s: period [s]; first:
    the filter starts at this tick.
    """
    if first:
        slow[a] = wanted
    rate = (wanted - slow[a]) / LAG_S
    slow[a] += tick_s * rate
    return rate


@compiled
def smooth_inverse(s, a, wanted, joint, gear, motor_gain, tick_s):
    """Servo reference [rad] and extra volts [V] on axis `a`; joint, gear: full widths [rad].

    s: record SMOOTH_STATE, changed in place; wanted: wanted plate angle [rad]; motor_gain: K
    [rad/s/V]; tick_s: period [s].
    """
    first = s.ticks[a] == 0
    rate = filtered_rate(s.slow, a, wanted, tick_s, first)
    motor = shift(0.5 * gear, rate)
    if first:
        s.motor[a] = motor
    volts = (motor - s.motor[a]) / (tick_s * motor_gain)
    s.motor[a] = motor
    s.ticks[a] += 1
    return wanted + shift(0.5 * joint, rate), volts
