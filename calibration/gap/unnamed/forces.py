"""Forces on the ball that follow from its recorded motion and that no model of a table holds.

**Turning.** A ball that is heavier on a side is pushed by c (R e)_xy, with R its attitude along its
path and e the direction of the heavy side at the start of each run: linear in the vector c e.

**Slipping.** A ball rolls as long as friction at the contact supplies the force f_r = (1 - k) a,
with a the acceleration that it would have without friction (g sin of the tilt) and k its rolling
factor, 5/7 of a solid ball. Friction gives mu g at most. With s the contact's slip,

    s' = a - f/(1 - k),   f = -> f_r, at most mu g along what would end the slip

and the ball is pushed by f_r - f beyond what a rolling one is. (Routh, Dynamics of a System of
Rigid Bodies, part 2, 1905, chapter 5.) The motion of the plate itself is left out.

**Swaying.** A floor, or a machine beside the table, shakes each axis at a frequency of its own.

**Swinging.** A plate behind elastic rods or an elastic shaft follows its servos by w^2/D(s) with
D(s) = s^2 + 2 zeta w s + w^2, so that beyond what they ask for the ball feels -(s^2 + 2 zeta w s)/D
of it. Where w and the zeta of D are given, this is linear in two sizes, neither below 0: of the
same without damping, -s^2/D, and with the most that a swing has. A delay or lag has -T s
without that -s^2, so that only a short one looks like it.

**Pushes.** Hands or gusts give constant forces from one time to another. They are found one after
the other (matching pursuit: Mallat and Zhang, IEEE Trans. Signal Proc. 41, 1993): of residuals
z with weights w, a push whose answer is k and which begins at row i explains

    G = 1/2 sum over x, y of (sum w z k)^2/(sum w k^2)

which has to be more than it costs.
"""

from collections.abc import Sequence
from itertools import accumulate

import numpy as np
from scipy.signal import bilinear, correlate, lfilter
from scipy.spatial.transform import Rotation

from calibration.gap.model.state import State
from rig.compiled import compiled
from rig.parameters import GRAVITY_M_S2
from rig.plant.plant import felt_angle
from rig.plant.position_plant import felt_sines
from rig.prediction.innovations import Signals

# Largest friction over that which rolling needs, as quantiles of the need: the ball slips from half
# of the time to a hundredth of it; chosen.
SLIPS_BEYOND = (0.5, 0.65, 0.8, 0.9, 0.95, 0.99)
SWINGS_HZ = (2.0, 2.5, 3.2, 4.0, 5.0, 6.3, 8.0, 10.0)  # beyond, a swing is a delay; chosen
SWING_DAMPING, MOST_SWING_DAMPING = 0.1, 0.3  # zeta of D, and of a plate that still swings; chosen
SWING_STEP_S = 0.002  # of the filter: a fiftieth of the shortest period
MOST_PUSHES = 16  # that are looked for in the logs; chosen


def turning_forces(state: State) -> np.ndarray:
    """R_xy (n, 2, 3 runs) at the exposures of all runs, of a ball that rolls; 0 in other runs."""
    runs, radius_m = state.evidence.runs, state.nominal.rig.ball.radius_m
    found, begin = np.zeros((sum(len(r.exposed_s) for r in runs), 2, 3 * len(runs))), 0
    for i, run in enumerate(runs):
        end = begin + len(run.exposed_s)
        found[begin:end, :, 3 * i : 3 * i + 3] = attitude(run.ball_m, radius_m)[:, :2]
        begin = end
    return found


def attitude(path_m: np.ndarray, radius_m: float) -> np.ndarray:
    """Attitude (n, 3, 3) of a ball that rolls without slip along `path_m` (n, 2), first the
    identity: R_i = exp([(-dy, dx, 0)/r]x) R_(i-1)."""
    if not len(path_m):
        return np.zeros((0, 3, 3))
    dx, dy = np.diff(path_m, axis=0, prepend=path_m[:1]).T
    steps = Rotation.from_rotvec(np.column_stack([-dy, dx, np.zeros(len(dx))]) / radius_m)
    return np.array(list(accumulate(steps.as_matrix(), lambda done, step: step @ done)))


def swaying_forces(t_s: np.ndarray, hz: tuple[float, float]) -> np.ndarray:
    """sin and cos of 2 pi f t (n, 2, 4) at times t_s (n,), f of x and of y [Hz]."""
    found = np.zeros((len(t_s), 2, 4))
    for a, own_hz in enumerate(hz):
        found[:, a, 2 * a] = np.sin(2.0 * np.pi * own_hz * t_s)
        found[:, a, 2 * a + 1] = np.cos(2.0 * np.pi * own_hz * t_s)
    return found


def swinging_forces(state: State) -> list[np.ndarray]:
    """`swing_forces` (n, 2, 2) [m/s2] at the exposures of all runs, for each frequency of
    SWINGS_HZ."""
    p = state.nominal.model(state.fit.setting).record
    driven: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for run in state.evidence.runs:
        t, theta = run.angles(p)
        even = np.arange(t[0], t[-1] + SWING_STEP_S, SWING_STEP_S)
        at = np.column_stack([np.interp(even, t, theta[:, a]) for a in range(2)])
        driven.append((even, GRAVITY_M_S2 * _sines(p, at), run.exposed_s))
    return [np.concatenate([swing_forces(*one, hz) for one in driven]) for hz in SWINGS_HZ]


def swing_forces(t: np.ndarray, a: np.ndarray, at: np.ndarray, hz: float) -> np.ndarray:
    """The module's two forces (m, 2, 2) of a plate that swings at `hz` Hz, at times `at` (m,) [s]:
    what it adds to a (n, 2) [m/s2] of the servos at times t (n,), SWING_STEP_S apart; at rest
    first."""
    w = 2.0 * np.pi * hz
    below = [1.0, 2.0 * SWING_DAMPING * w, w * w]
    found = np.zeros((len(at), 2, 2))
    for k, damping in enumerate((0.0, MOST_SWING_DAMPING)):
        over, under = bilinear([-1.0, -2.0 * damping * w, 0.0], below, 1.0 / SWING_STEP_S)
        felt = np.asarray(lfilter(over, under, a - a[0], axis=0))
        for axis in range(2):
            found[:, axis, k] = np.interp(at, t, felt[:, axis])
    return found


def slipping_forces(state: State) -> list[np.ndarray]:
    """The module's f_r - f (n, 2) [m/s2] at the exposures of all runs, for each largest friction
    of SLIPS_BEYOND; of a ball that never needs any, none."""
    p, runs = state.nominal.model(state.fit.setting).record, state.evidence.runs
    factor = float(p["factor"])
    driven = [(_driven(p, run), run.exposed_s) for run in runs]
    need = np.concatenate([(1.0 - factor) * np.hypot(*a.T) for a, _ in driven])
    most = np.unique(np.quantile(need, SLIPS_BEYOND)) if len(need) else []
    return [
        np.concatenate([slip_force(t, a, factor, m) for a, t in driven]) for m in most if m > 0.0
    ]


def _driven(p: np.record, run: Signals) -> np.ndarray:
    """g sin of the tilt (n, 2) [m/s2] at the exposures of a run."""
    t, theta = run.angles(p)
    at = np.column_stack([np.interp(run.exposed_s, t, theta[:, a]) for a in range(2)])
    return GRAVITY_M_S2 * (_sines(p, at) + p["level_offset_slope_rad"])


@compiled
def _sines(p, theta):
    """Sines of the plate's tilt (n, 2) [1] at servo angles theta (n, 2) [rad]."""
    out = np.empty_like(theta)
    for i in range(len(theta)):
        out[i] = felt_sines(p, felt_angle(p, 0, theta[i, 0]), felt_angle(p, 1, theta[i, 1]))
    return out


@compiled
def slip_force(t, a, factor, most):
    """f_r - f (n, 2) [m/s2] by the module's equations, at times t (n,) [s], from a (n, 2) [m/s2],
    the rolling factor and the largest friction `most` = mu g [m/s2]; it rolls at first.

    Implicit steps: the friction of a step is what ends the slip, or the most there is.
    """
    out, s = np.zeros_like(a), np.zeros(2)
    for i in range(1, len(t)):
        h, mean = t[i] - t[i - 1], 0.5 * (a[i - 1] + a[i])
        if h <= 0.0:  # one exposure, told twice
            continue
        ends = (1.0 - factor) * (s / h + mean)
        size = np.sqrt(ends[0] ** 2 + ends[1] ** 2)
        f = ends * min(1.0, most / size) if size > 0.0 else ends
        s += h * (mean - f / (1.0 - factor))
        out[i] = (1.0 - factor) * mean - f
    return out


def pushes(
    z: np.ndarray, w: np.ndarray, run: np.ndarray, answers: Sequence[np.ndarray], cost: float
) -> list[tuple[int, int, np.ndarray]]:
    """Pushes that each explain more than `cost`: the rows at which they begin, the index of their
    answer and their sizes (2,).

    z, w (n, 2): residuals and weights of a ball; run (n,): the run of each row, which a push does
    not leave; answers: of the residuals to a push of each length, from its begin on.
    """
    found: list[tuple[int, int, np.ndarray]] = []
    left, n = z.copy(), len(z)
    ended = np.append(np.flatnonzero(np.diff(run)) + 1, n)
    end = ended[np.searchsorted(ended, np.arange(n), "right")]  # of each row's run
    inside = [np.arange(n) + len(k) <= end for k in answers]
    energy = [np.maximum(_sums(w, k**2), 1e-9) for k in answers]
    while len(found) < MOST_PUSHES:
        sums = [_sums(w * left, k) for k in answers]
        gains = [
            0.5 * np.sum(s**2 / e, axis=1) * fits
            for s, e, fits in zip(sums, energy, inside, strict=True)
        ]
        j = int(np.argmax([gain.max() for gain in gains]))
        i = int(np.argmax(gains[j]))
        if gains[j][i] <= cost:
            break
        size = sums[j][i] / energy[j][i]
        found.append((i, j, size))
        left[i : i + len(answers[j])] -= answers[j][:, None] * size
    return found


def as_one(
    found: Sequence[tuple[int, int, np.ndarray]], apart: int, run: np.ndarray
) -> list[tuple[int, int]]:
    """First and end rows of pushes (first, end, size), in order: those to the same side between
    which fewer than `apart` rows lie are one whose length was none of those tried."""
    merged: list[tuple[int, int, np.ndarray]] = []
    for first, end, size in sorted(found, key=lambda push: push[:2]):
        i, j, had = merged[-1] if merged else (0, -apart, size)
        if first - j < apart and run[first] == run[i] and size @ had > 0.0:
            merged[-1] = (i, max(j, end), had + size)
        else:
            merged.append((first, end, size))
    return [(first, end) for first, end, _ in merged]


def _sums(rows: np.ndarray, k: np.ndarray) -> np.ndarray:
    """sum_j rows[i + j] k[j] for each i, (n, 2)."""
    return correlate(rows, k[:, None])[len(k) - 1 :]
