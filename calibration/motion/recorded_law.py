"""The law of a controller whose commands were recorded: a PID on the ball with a filter and limits.

With e = r - x the error of the ball x from its target r, per axis,

    u = K_p e + I + D,   I' = K_i e,   T D' + D = K_d (w r - x)',   c = u within a limit and a rate

w = 1: the derivative is of the error, 0: of the ball alone.
"""

import numpy as np

from rig.compiled import compiled

# A law (7,): K_p [rad/m], K_i [rad/m/s], K_d [rad s/m], T [s], w [1], rate [rad/s], limit [rad].
(KP, KI, KD, FILTER, OF_TARGET, RATE, LIMIT) = range(7)
# Its state (4,): I and D [rad], w r - x before [m], the last command [rad].
(INTEGRAL, SLOPE, BEFORE, TOLD) = range(4)


def started(integral_rad: float, told_rad: float) -> np.ndarray:
    """The state (4,) of a law before its first tick, from I and the last command."""
    return np.array([integral_rad, 0.0, np.nan, told_rad])


@compiled
def command(law, state, target, ball, dt):
    """The command [rad] of one tick; law (7,), state (4,) is advanced; target, ball [m]."""
    seen = law[OF_TARGET] * target - ball
    if np.isnan(state[BEFORE]):
        state[BEFORE] = seen
    keep = np.exp(-dt / law[FILTER])
    state[SLOPE] = keep * state[SLOPE] + (1.0 - keep) * law[KD] * (seen - state[BEFORE]) / dt
    state[BEFORE] = seen
    state[INTEGRAL] += law[KI] * (target - ball) * dt
    wanted = law[KP] * (target - ball) + state[INTEGRAL] + state[SLOPE]
    wanted = min(max(wanted, -law[LIMIT]), law[LIMIT])
    most = law[RATE] * dt
    state[TOLD] += min(max(wanted - state[TOLD], -most), most)
    return state[TOLD]


@compiled
def follow(law, state, targets, ball, dt, out):
    """Fill out (n,) [rad] with the commands for targets and ball (n,) [m]."""
    for k in range(out.shape[0]):
        out[k] = command(law, state, targets[k], ball[k], dt)
