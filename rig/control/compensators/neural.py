"""Neural dynamic-inversion compensation (Selmic and Lewis).

With tau the output of what has the play, here the believed plate angle, and tau~ = wanted - tau,
the play's dynamics are inverted by u' = K_b tau~ + (filtered derivative of wanted) - y, and a small
network learns what that leaves over (Selmic and Lewis, IEEE CDC 2000; US patent 6611823):

    y = W' sigma(V' x),   W' = -S sigma tau~ - k S |tau~| W       (their eqs. for the second layer)

so that |W| <= |sigma|/k whatever comes. The first layer V is fixed and drawn once, a basis as good
as any (Igelnik and Pao, IEEE Trans. Neural Networks 6, 1995). u' is the motor's speed: volts are
u'/K, and K_b/K is the proportional gain that all compensators have.
"""

from math import exp

import numpy as np

from rig.compiled import compiled
from rig.control.compensators.smooth import filtered_rate
from rig.plant.shaft import play_operator

HIDDEN, INPUTS = 8, 5
LEARNING, FORGETTING = 200.0, 0.5  # S [1/s2], k [s/rad]
LIKELY = np.array([1.0, 10.0, 4.0, 60.0, 10.0])  # makes the inputs about one in size
FIRST_LAYER = np.random.default_rng(6611823).uniform(-1.0, 1.0, (HIDDEN, INPUTS)) * LIKELY

NEURAL_STATE = np.dtype(
    [
        ("ticks", np.int64, (2,)),
        ("slow", np.float64, (2,)),
        ("plate", np.float64, (2,)),
        ("weights", np.float64, (2, HIDDEN)),
        ("sigma", np.float64, (2, HIDDEN)),
    ]
)


@compiled
def answer(s, a, wanted, rate, missing):
    """y = W' sigma(V' x) on axis `a` [rad/s]; writes sigma into s, a record NEURAL_STATE.

    x = (1, wanted [rad], its rate [rad/s], missing = wanted minus plate [rad], the believed plate
    angle [rad]); sigma is the logistic function minus 1/2.
    """
    y = 0.0
    for i in range(HIDDEN):
        v = FIRST_LAYER[i]
        z = v[0] + v[1] * wanted + v[2] * rate + v[3] * missing + v[4] * s.plate[a]
        s.sigma[a, i] = 1.0 / (1.0 + exp(-min(max(z, -30.0), 30.0))) - 0.5
        y += s.weights[a, i] * s.sigma[a, i]
    return y


@compiled
def learn(s, a, missing, tick_s):
    """Advance the weights W of axis `a` by one tick of the tuning law.

    s: record NEURAL_STATE, changed in place; missing: tau~ [rad]; tick_s: period [s].
    """
    for i in range(HIDDEN):
        s.weights[a, i] -= (
            tick_s
            * LEARNING
            * (s.sigma[a, i] * missing + FORGETTING * abs(missing) * s.weights[a, i])
        )


@compiled
def neural_volts(s, a, wanted, theta, joint, gain, motor_gain, tick_s):
    """Volts of the neural compensator on axis `a` [V], before the servo's rate feedback.

    s: record NEURAL_STATE, changed in place; wanted, theta: wanted plate angle and encoder angle
    [rad]; joint: full width [rad], 0 where it is not known; gain: K_s [V/rad]; motor_gain: K
    [rad/s/V]; tick_s: period [s].
    """
    half = 0.5 * joint
    if s.ticks[a] == 0:
        s.plate[a] = theta
    s.plate[a] = play_operator(s.plate[a], theta, half, -half)
    rate = filtered_rate(s.slow, a, wanted, tick_s, s.ticks[a] == 0)
    missing = wanted - s.plate[a]
    y = answer(s, a, wanted, rate, missing)
    learn(s, a, missing, tick_s)
    s.ticks[a] += 1
    return gain * missing + (rate - y) / motor_gain
