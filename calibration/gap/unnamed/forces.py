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
D(s) = s^2 + 2 zeta w s + w^2, so that its tilt differs from theirs by d = -s^2/D of it, and of what
is damped not in the elastic part but against the table by -2 zeta w s/D as well. A delay or lag has
-T s without that -s^2, so that only a short one looks like it. The ball, on its top, feels

    a = k g d - r d''

with k its rolling factor and r its radius: above sqrt(k g/r)/(2 pi), 3.7 Hz of a ball of 13 mm, the
second is the larger one. Where it is seen it is moved as by impulses at the exposures: with X of
X'' = a, of the size at which the mean speed from one to the next, (X_(i+1) - X_i)/h_i, changes.

**Pushes.** Hands or gusts give constant forces from one time to another. They are found one after
the other (matching pursuit: Mallat and Zhang, IEEE Trans. Signal Proc. 41, 1993): of residuals
z with weights w, a push whose answer is k and which begins at row i explains

    G = 1/2 sum over x, y of (sum w z k)^2/(sum w k^2)

which has to be more than it costs.
"""

from collections.abc import Iterator, Sequence
from itertools import accumulate, product

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
# Ratios of 1.05, half the width of a swing with the least damping but one. Beyond the last a swing
# is a delay; chosen.
SWINGS_HZ = tuple(np.geomspace(2.0, 10.0, 34).tolist())
SWING_DAMPINGS = (0.03, 0.06, 0.12, 0.25)  # zeta, to the most with which a plate swings; chosen
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


Swing = tuple[float, float]  # frequency [Hz] and damping (zeta)


def swinging_forces(state: State) -> Iterator[tuple[Swing, np.ndarray]]:
    """Of plates that swing, damped in the elastic part: each of SWING_DAMPINGS and SWINGS_HZ with
    its `swing_force` (n, 2) [m/s2] at the exposures of all runs."""
    p = state.nominal.model(state.fit.setting).record
    driven: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for run in state.evidence.runs:
        t, theta = run.angles(p)
        even = np.arange(t[0], t[-1] + SWING_STEP_S, SWING_STEP_S)
        at = np.column_stack([np.interp(even, t, theta[:, a]) for a in range(2)])
        driven.append((even, _sines(p, at), run.exposed_s))
    k_g, r = GRAVITY_M_S2 * float(p["factor"]), float(p["radius"])
    for damping, hz in product(SWING_DAMPINGS, SWINGS_HZ):
        swing = (hz, damping)
        yield swing, np.concatenate([swing_force(*one, swing, k_g, r) for one in driven])


def swing_force(
    t: np.ndarray, tilt: np.ndarray, at: np.ndarray, swing: Swing, k_g: float, radius_m: float
) -> np.ndarray:
    """The module's accelerations (m, 2) on a plate that swings, at exposures `at` (m,) [s]: beyond
    the sines `tilt` (n, 2) [1] that the servos ask for at times t (n,), SWING_STEP_S apart; at rest
    first. k_g: k g [m/s2]."""
    path = _filtered([radius_m, 0.0, -k_g], swing, tilt)
    found, step = np.zeros((len(at), 2)), np.diff(at)[:, None]
    moved = np.column_stack([np.interp(at, t, path[:, axis]) for axis in range(2)])
    if len(at) > 2:
        found[1:-1] = np.diff(np.diff(moved, axis=0) / step, axis=0) / np.median(step)
    return found


def swung(t: np.ndarray, theta: np.ndarray, swing: Swing, *, damped: bool) -> np.ndarray:
    """What a plate that swings adds to the angles theta (n,) [rad] of its servo at times t (n,)
    [s]: -s^2/D, or (damped) -2 zeta w s/D of them; at rest first."""
    hz, damping = swing
    even = np.arange(t[0], t[-1] + SWING_STEP_S, SWING_STEP_S)
    over = [0.0, -4.0 * np.pi * hz * damping, 0.0] if damped else [-1.0, 0.0, 0.0]
    return np.interp(t, even, _filtered(over, swing, np.interp(even, t, theta)))


def _filtered(over: Sequence[float], swing: Swing, values: np.ndarray) -> np.ndarray:
    """over/D of values (n, ...) SWING_STEP_S apart, at rest first."""
    hz, damping = swing
    w = 2.0 * np.pi * hz
    digital = bilinear(over, [1.0, 2.0 * damping * w, w * w], 1.0 / SWING_STEP_S)
    return np.asarray(lfilter(*digital, values - values[0], axis=0))


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
