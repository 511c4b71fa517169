"""Is the size of a name a constant, and is every parameter one where nothing has a name?

A physical size is the same in every part of the motion (Hansen, J. Policy Modeling 14, 1992; Lin
and Terasvirta, J. Econometrics 62, 1994). By time, place, speed, tilt and its rate (a servo: time,
angle, speed, volts), of whatever sign, and from one side of plate or servo to the other, g rises
from -1/2 where they are least to 1/2 at their quantile of FULL, and the size gets a second
parameter that is added times g:

    z = -(J d + J_size g delta) + e,   F = delta' cov^-1 delta/k

with cov by leaving out one second after the other (jackknife: MacKinnon and White, J. Econometrics
29, 1985), and as many of them as tell delta (Carter, Schnepel and Steigerwald, Rev. Econ. Stat. 99,
2017): a few seconds hold most of what is fast or far. A size is no constant where F is beyond its
quantile and |delta| > MAX_INCONSTANCY |size|. (Cut in two at the median instead, a spring that is
spent at large angles is the scale of an angle: most of the motion is small.)

Where there is no name, the same is asked of every parameter of the model, over time alone. With

    G = delta' (H^-1)^-1 delta/2

the fall of the cost by it, H^-1 the block of delta of the inverse normal matrix, the one with the
largest G changes where its F is beyond its quantile, and it and all whose G is less than
RIVAL_MARGIN behind differ by more than their tolerance, for certain (by SURE_Z of the jackknife's
deviation): nothing that a healthy table may have explains it.

A size that is a rate in time (TRENDS) is hardly shown to be one in a single run: whatever changes
slowly, 1/f noise or a slipping encoder, has a trend over one run (spurious regression: Granger and
Newbold, J. Econometrics 2, 1974). What is no drift is not straight: 1 in 100 random walks departs
from a line by less than MAX_UNEVENNESS of the line's own deviation, and hardly any 1/f noise.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import inf, sqrt

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy.signal import lfilter
from scipy.stats import f as f_distribution

from calibration.gap.decision_rule import (
    FAMILY_P,
    MAX_INCONSTANCY,
    MAX_UNEVENNESS,
    RIVAL_MARGIN,
    SURE_Z,
)
from calibration.gap.model.change import Change
from calibration.gap.model.cost import weights
from calibration.gap.model.fit import ParameterFit, differences
from calibration.gap.model.intervals import (
    RIDGE,
    block_sums,
    blocks_of,
    inverse_prior,
    jackknife,
)
from calibration.gap.model.parameters import (
    BALL,
    CALIBRATED,
    PERIODIC,
    SERVO,
    Model,
    Parameter,
)
from calibration.gap.model.state import State
from calibration.gap.name.stepwise import Accepted
from calibration.gap.prove import model_of
from rig.prediction.innovations import Signals

TRENDS = ("level_drift",)  # effects whose size is a rate in time
# Of polynomials beside a straight line; a random walk has a fifth of what lies beside it beyond.
TREND_ORDERS = 9
FULL = 0.99  # of the motion: beyond are its outliers; chosen


def inconstancy(state: State, one: Accepted, output: str) -> str:
    """On what the size of a name depends most, or why that cannot be said, in words; "" if it is
    constant on every axis on which it is told: of a size that a healthy table may have, any change
    is a large share."""
    slopes = _slopes(state, output)
    for axis in one.told_axes(state):
        parameters = state.nominal.of(one.name, axis)[: 2 if one.name in PERIODIC else 1]
        own = [k.name for k in parameters if k.name in state.bounds((output,))]
        size = np.array([state.fit.setting.get(n, 0.0) for n in own])
        size -= [0.0 if one.name in PERIODIC else k.nominal for k in parameters[: len(own)]]
        if not own or not np.all(np.isfinite(size)):
            continue
        for word, along in _ramps(state, output):
            beside = _beside(state, output, slopes, own, along[:, None])
            share = float(np.linalg.norm(beside.sizes) / max(np.linalg.norm(size), 1e-30))
            if beside.chance < FAMILY_P and share > MAX_INCONSTANCY:
                return f"its size on {axis} differs by {100 * share:.0f} % with the {word}"
    return ""


def changing(state: State) -> Change | None:
    """The parameter that changes by the module's test, of the first output on which one does; None
    where each is a constant."""
    runs = len(state.evidence.runs)
    for output in state.evidence.outputs:
        if not state.bounds((output,)):
            continue
        slopes = _slopes(state, output)
        _, time = next(_ramps(state, output))
        found = [(_beside(state, output, slopes, [k.name], time[:, None]), k) for k in slopes[0]]
        best, first = max(found, key=lambda pair: pair[0].gain)
        likely = [pair for pair in found if pair[0].gain > best.gain - RIVAL_MARGIN]
        if best.chance < FAMILY_P and all(_beyond_tolerance(state, *pair) for pair in likely):
            middle, half = state.fit.setting.get(first.name, first.nominal), best.sizes[0] / 2
            others = tuple(one for _, one in likely if one is not first)
            return Change(output, first, middle - half, middle + half, runs, others)
    return None


def _beyond_tolerance(state: State, found: "Beside", one: Parameter) -> bool:
    """Whether a parameter changes by more than its tolerance for certain. That of K and tau is a
    share of them: the model fits them whatever the rig file says."""
    value = state.fit.setting.get(one.name, one.nominal)
    tolerance = CALIBRATED[one.key] * abs(value) if one.key in CALIBRATED else one.tolerance
    return abs(found.sizes[0]) - tolerance > SURE_Z * sqrt(found.cov[0, 0])


def trend_of_one_run(state: State, one: Accepted) -> str:
    """Why a name whose size is a rate in time cannot be certain, in words; "" if it can, or has no
    such size."""
    if one.name not in TRENDS or len(state.evidence.runs) > 1:
        return ""
    share = max(_unevenness(state, axis) for axis in one.axes)
    if share <= MAX_UNEVENNESS:
        return ""
    return (
        "whatever changes slowly has a trend over one run, and it is not shown to rise as evenly "
        f"as a drift ({100 * share:.0f} % of the rise beside a straight line): record another"
    )


def _unevenness(state: State, axis: str) -> float:
    """How far the level of an axis may depart from a straight line in time over the one run, RMS,
    as a share of the line's own: by Legendre polynomials of higher order, which are orthogonal to
    it, with the power of their errors added."""
    level = f"level_offset.slope_rad.{axis}"
    if level not in state.bounds((BALL,)):
        return inf
    t = state.evidence.times(BALL)[0]
    begin, length = t[0], t[-1] - t[0]
    along = legvander(2.0 * (t - begin) / length - 1.0, TREND_ORDERS)[:, 2:]
    found = _beside(state, BALL, _slopes(state, BALL), [level], along)
    power = (found.sizes**2 + np.diag(found.cov)) / (2.0 * np.arange(2, TREND_ORDERS + 1) + 1.0)
    rise = state.fit.setting[f"level_drift.rate_rad_s.{axis}"] * length
    return float(np.sqrt(power.sum()) / max(abs(rise) / sqrt(12.0), 1e-30))


Slopes = tuple[list[Parameter], np.ndarray]


def _slopes(state: State, output: str) -> Slopes:
    """The parameters that are free on an output, and the derivatives (n, k) of its residuals by
    them, each over its step."""
    bounds = state.bounds((output,))
    parameters = [state.nominal.parameters[name] for name in bounds]
    only = ParameterFit(state.fit.setting, {output: state.fit.rolls[output]}, {})
    j = differences(state.evidence, state.nominal, only, parameters, bounds)[output]
    return parameters, j * np.array([k.step for k in parameters])


@dataclass(frozen=True)
class Beside:
    """What k parameters have beside themselves along m functions, function by function: `sizes`
    (m k,) in units of the parameters, their covariance `cov`, the fall of the cost `gain` by them,
    and the tail `chance` of F with as many degrees of freedom as blocks tell of them."""

    sizes: np.ndarray
    cov: np.ndarray
    gain: float
    chance: float


def _beside(state: State, output: str, slopes: Slopes, own: list[str], along: np.ndarray) -> Beside:
    """The module's regression for the parameters `own` along m functions, `along` (n, m)."""
    parameters, j = slopes
    places = [[one.name for one in parameters].index(name) for name in own]
    j = np.hstack([j, *(j[:, places] * g[:, None] for g in along.T)])
    z = state.fit.z(output)
    k = j.shape[1] - len(parameters)
    prior = np.append([inverse_prior(state, k) for k in parameters], np.zeros(k))
    block = blocks_of(state, (output,))
    a, g = block_sums(j, weights(z, state.evidence.masks[output]), z, block, int(block.max()) + 1)
    normal = a.sum(axis=0) + np.diag(prior + RIDGE)
    d = -np.linalg.solve(normal, g.sum(axis=0))
    cov, telling = jackknife(a, g + a @ d, prior)
    found, cov = d[-k:], cov[-k:, -k:]
    gain = found @ np.linalg.solve(np.linalg.inv(normal)[-k:, -k:], found) / 2.0
    wald = found @ np.linalg.pinv(cov) @ found / k
    chance = f_distribution.sf(wald, k, max(float(telling[-k:].min()) - 1.0, 2.0))
    units = np.tile([parameters[place].step for place in places], along.shape[1])
    return Beside(found * units, cov * np.outer(units, units), float(gain), float(chance))


def _ramps(state: State, output: str) -> Iterator[tuple[str, np.ndarray]]:
    """What the motion is ordered by, in words, and the module's g (n,) of the residuals."""
    used = state.evidence.masks[output] > 0
    for word, value in _covariates(state, output).items():
        least, most = float(value[used].min()), float(np.quantile(value[used], FULL))
        yield word, np.clip((value - least) / max(most - least, 1e-30), 0.0, 1.0) - 0.5


def _covariates(state: State, output: str) -> Mapping[str, np.ndarray]:
    """What the motion is cut by (n,): time, or the run where there are several; absolute values of
    place, speed, tilt and its rate (ball), of angle, speed and volts (servo), and place along x and
    y (ball) and angle (servo) with their sign, all as they were one sample earlier.

    The speed of a servo is the one that its volts give by its time constant: an innovation shares
    the noise of the angle, so that cut by measured speed it would choose its own half, and friction
    that is constant seems to fall with speed.
    """
    t, number = state.evidence.times(output)
    found: dict[str, list[np.ndarray]] = {}
    for run in state.evidence.runs:
        parts = _of_ball(run) if output == BALL else _of_servo(run, output, model_of(state))
        for word, value in parts.items():
            found.setdefault(word, []).append(np.concatenate([value[:1], value[:-1]]))
    repeated = 2 if output == BALL else 1
    motion = {word: np.repeat(np.concatenate(v), repeated) for word, v in found.items()}
    return {"time": number.astype(float) if len(state.evidence.runs) > 1 else t} | motion


def _of_ball(run: Signals) -> dict[str, np.ndarray]:
    t = run.exposed_s
    tilt = np.column_stack([np.interp(t, run.t_s, run.theta_rad[:, a]) for a in range(2)])
    values = {
        "ball's distance from the centre": run.ball_m,
        "ball's speed": _rate(run.ball_m, t),
        "tilt": tilt,
        "rate of the tilt": _rate(tilt, t),
    }
    found = {word: np.linalg.norm(value, axis=1) for word, value in values.items()}
    return found | {f"ball's place along {axis}": run.ball_m[:, a] for a, axis in enumerate("xy")}


def _of_servo(run: Signals, output: str, model: Model) -> dict[str, np.ndarray]:
    a = SERVO.index(output)
    volts, step_s = run.volts_V[:, a], float(np.median(np.diff(run.t_s)))
    decay = float(np.exp(-step_s / model.time_constant_s[a]))
    speed = lfilter([1.0 - decay], [1.0, -decay], volts)
    if run.commanded:  # a servo is the faster, the further its command is away
        values = {"servo's angle": run.theta_rad[:, a], "servo's speed": volts - speed}
    else:
        values = {"servo's angle": run.theta_rad[:, a], "servo's speed": speed, "volts": volts}
    found = {word: np.abs(value) for word, value in values.items()}
    return found | {"servo's side": run.theta_rad[:, a]}


def _rate(x: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Backward differences (n, 2) of x (n, 2) over t (n,)."""
    return np.diff(x, axis=0, prepend=x[:1]) / np.diff(t, prepend=t[:1] - 1.0)[:, None]
