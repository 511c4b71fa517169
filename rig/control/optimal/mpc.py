"""Linear model predictive control of one axis, with volts and angle bounded.

Every PERIOD_S the volts of the next MOVES periods are found from the state that the Kalman filter
of `lqg` has, as deviations x = (p - target, p', theta - theta_d, omega), U = V + w from what holds
the ball against d and w,

    min  sum_i x_i'Qx_i + R u_i^2 + x_N'P x_N,   x_{i+1} = A x_i + B u_i
    subject to  |u_i - w| <= V_max,   |theta_i| <= angle limit

P of the Riccati equation, so that without active bounds the first move is that of the regulator of
`design` (Rawlings and Mayne, Model Predictive Control, 2009). The states are eliminated:
min U'HU/2 + (F x_0)'U with l <= (U, s(G U + L x_0)) <= u, s scaling radians to volts. ITERATIONS
steps of the operator splitting of OSQP (Stellato et al., Math. Program. Comput. 12, 2020), warm
from the last solution shifted by a period, with the matrix inverted beforehand:

    U = (H + SIGMA I + rho A'A)^-1 (SIGMA U - F x_0 + A'(rho z - y)),   A = (I; sG)
    z+ = clip(a AU + (1 - a) z + y/rho),   y += rho (a AU + (1 - a) z - z+),   a = RELAXED

The first move is clipped to its bounds, which fixed iterations reach only nearly.
"""

import numpy as np

from rig.compiled import compiled
from rig.control.optimal import design
from rig.control.optimal.lqg import hold_angle
from rig.parameters import Rig

PERIOD_S = 0.02  # of a move: half of a servo's time constant as measured on real units; chosen
MOVES = 25  # half a second: a servo crosses its range in it; the rest is in P; chosen
ITERATIONS = 60  # measured: the first move is then within 2 % of V_max of the exact one (a test)
SIGMA, RELAXED = 1e-6, 1.6  # of OSQP
SOLVER = np.dtype(
    [
        ("moves", np.float64, (MOVES,)),
        ("split", np.float64, (2, MOVES)),
        ("dual", np.float64, (2, MOVES)),
        ("wait", np.int64),  # ticks until the next move
        ("volts", np.float64),
    ]
)
MPC_STATE = np.dtype([("axes", SOLVER, (2,))])
MPC_SETTINGS = np.dtype(
    [
        ("inverse", np.float64, (MOVES, MOVES)),
        ("linear", np.float64, (MOVES, 4)),
        ("angles", np.float64, (MOVES, MOVES)),  # s G
        ("free", np.float64, (MOVES, 4)),  # s L
        ("scale", np.float64),
        ("rho", np.float64),
        ("ticks", np.int64),
        ("voltage_limit", np.float64),
        ("angle_limit", np.float64),
    ]
)


def problem(
    rig: Rig, weights: design.Weights
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """H (n, n), F (n, 4), G (n, n) and L (n, 4) of the module's equation, n = MOVES."""
    a, b = design.axis_step(rig, PERIOD_S)
    q, r = weights.cost()
    _, p = design.regulator(rig, PERIOD_S, weights)
    n = MOVES
    free, forced = np.zeros((n, 4, 4)), np.zeros((n, 4, n))
    power = np.eye(4)
    for i in range(n):
        forced[i] = a @ forced[i - 1] if i else 0.0
        forced[i, :, i] += b[:, 0]
        power = a @ power
        free[i] = power
    weight = [q * PERIOD_S] * (n - 1) + [p]
    h = 2.0 * (
        sum(f.T @ w @ f for f, w in zip(forced, weight, strict=True)) + r * PERIOD_S * np.eye(n)
    )
    linear = 2.0 * sum(f.T @ w @ x for f, w, x in zip(forced, weight, free, strict=True))
    return h, np.asarray(linear), forced[:, 2, :], free[:, 2, :]


def settings(rig: Rig, weights: design.Weights) -> np.record:
    """The settings (dtype MPC_SETTINGS) from what a controller may know of the rig."""
    q = np.zeros(1, MPC_SETTINGS)[0]
    h, linear, angles, free = problem(rig, weights)
    scale = rig.servo.voltage_limit_V / rig.servo.angle_limit_rad
    both = np.vstack([np.eye(MOVES), scale * angles])
    rho = float(np.sqrt(np.trace(h) / np.trace(both.T @ both) * np.linalg.eigvalsh(h)[0]))
    q["inverse"] = np.linalg.inv(h + SIGMA * np.eye(MOVES) + rho * both.T @ both)
    q["linear"], q["angles"], q["free"] = linear, scale * angles, scale * free
    q["scale"], q["rho"] = scale, rho
    q["ticks"] = max(1, round(PERIOD_S * rig.control_rate_hz))
    q["voltage_limit"], q["angle_limit"] = rig.servo.voltage_limit_V, rig.servo.angle_limit_rad
    return q


@compiled
def forget(s):
    """Begin anew with no moves planned, as while the ball is held; s: record MPC_STATE."""
    for a in range(2):
        s.axes[a].wait = 0
        for i in range(MOVES):
            s.axes[a].moves[i] = 0.0
            for k in range(2):
                s.axes[a].split[k, i] = s.axes[a].dual[k, i] = 0.0


@compiled
def solve(x, q, start, low, high, least, most):
    """The moves U (MOVES,) into x.moves from the warm start that x, record SOLVER, holds.

    q: record MPC_SETTINGS; start (4,): x_0; low, high: bounds of u [V]; least, most: of
    theta - theta_d [rad].
    """
    offset, drift, right = np.empty(MOVES), np.empty(MOVES), np.empty(MOVES)
    for i in range(MOVES):
        offset[i] = drift[i] = 0.0
        for k in range(4):
            offset[i] += q.linear[i, k] * start[k]
            drift[i] += q.free[i, k] * start[k]
    for _ in range(ITERATIONS):
        for i in range(MOVES):
            right[i] = SIGMA * x.moves[i] - offset[i] + q.rho * x.split[0, i] - x.dual[0, i]
        for k in range(MOVES):  # A' of the angles: G is lower triangular
            pull = q.rho * x.split[1, k] - x.dual[1, k]
            for i in range(k + 1):
                right[i] += q.angles[k, i] * pull
        for i in range(MOVES):
            x.moves[i] = 0.0
            for k in range(MOVES):
                x.moves[i] += q.inverse[i, k] * right[k]
        for i in range(MOVES):
            turned = 0.0
            for k in range(i + 1):
                turned += q.angles[i, k] * x.moves[k]
            _split(x, q, 0, i, x.moves[i], low, high)
            _split(x, q, 1, i, turned, q.scale * least - drift[i], q.scale * most - drift[i])


@compiled
def _split(x, q, row, i, value, low, high):
    """One step of z and y of the module's equation."""
    mixed = RELAXED * value + (1.0 - RELAXED) * x.split[row, i]
    z = min(max(mixed + x.dual[row, i] / q.rho, low), high)
    x.dual[row, i] += q.rho * (mixed - z)
    x.split[row, i] = z


@compiled
def mpc_volts(s, filters, q, c, g, a, target):
    """Volts of axis `a` that lead the ball to `target` [m].

    s: record MPC_STATE, changed in place; filters: record LQG_STATE at this tick; q: record
    MPC_SETTINGS; c: record CONTROL, into which the planned angle is written; g: CONTROL_SETTINGS.
    """
    x, known = s.axes[a], filters.axes[a]
    if x.wait > 0:
        x.wait -= 1
        known.volts = x.volts
        return x.volts
    x.wait = q.ticks - 1
    rest, w = hold_angle(known, g), known.servo[2]
    start = np.empty(4)
    start[0], start[1] = known.ball[0] - target, known.ball[1]
    start[2], start[3] = known.servo[0] - rest, known.servo[1]
    for i in range(MOVES - 1):
        x.moves[i] = x.moves[i + 1]
        for k in range(2):
            x.split[k, i], x.dual[k, i] = x.split[k, i + 1], x.dual[k, i + 1]
    low, high = w - q.voltage_limit, w + q.voltage_limit
    solve(x, q, start, low, high, -q.angle_limit - rest, q.angle_limit - rest)
    ahead = 0.0
    for k in range(4):
        ahead += q.free[MOVES - 1, k] * start[k]
    for k in range(MOVES):
        ahead += q.angles[MOVES - 1, k] * x.moves[k]
    wanted = rest + ahead / q.scale
    c.wanted_theta[a] = c.reference[a] = min(max(wanted, -g.angle_limit), g.angle_limit)
    x.volts = min(max(x.moves[0] - w, -q.voltage_limit), q.voltage_limit)
    known.volts = x.volts
    return x.volts
