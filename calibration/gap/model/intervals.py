"""95 % intervals of fitted parameters: what each stretch of time moves them by when it is left out.

    d_b = (A + L - A_b)^-1 g_b,   A_b = sum_b J'WJ,   A = sum_b A_b,   g_b = sum_b J'Wz
    cov = (n - 1)/n sum_b d_b d_b' + (A + L)^-1 L (A + L)^-1

J (n, k) secants, W Huber's weights, z residuals, b the n blocks of BLOCK_S within the runs (the
residuals are neither white nor Gaussian). L is diagonal: the inverse variances of the priors
(`calibration.gap.model.fit`). This is the jackknife over clusters, or CR3 (Bell and McCaffrey,
Survey Methodology 28, 2002): unlike the sandwich of the residuals at the fit, it is not too small
where few blocks tell of a parameter. How many those are is their effective number

    n_i = (sum_b l_b)^2 / sum_b l_b^2,   l_b = [(A + L - A_b)^-1 A_b (A + L - A_b)^-1]_ii,

what each adds to the variance where the noise is white (Carter, Schnepel and Steigerwald, Rev.
Econ. Stat. 99, 2017). The standard deviation of parameter i is s_i = sqrt(cov_ii + m_i^2) with m_i
a floor for errors of the model that no length of log removes, and the interval
value -+ t(0.975, n_i - 1) s_i. It is not corrected for the selection of the effect.
"""

from collections.abc import Sequence
from math import hypot, inf, sqrt
from typing import NamedTuple

import numpy as np

from calibration.gap.findings import Interval
from calibration.gap.model.cost import weights
from calibration.gap.model.fit import ParameterFit, differences, inverse_variance
from calibration.gap.model.parameters import COAST_KEY, FALL_KEY, Parameter
from calibration.gap.model.state import State, outputs_of
from calibration.statistics import student_quantile
from rig.effects import BY_NAME

BLOCK_S = 1.0  # chosen
# Floors m_i, chosen on simulated tables: how friction sets in [V], a tenth of a tick (a lag looks
# like a delay), what a limit
# or a sagging supply leaves and, in encoder counts, where gear teeth meet as their shafts wind up.
MIN_DEVIATION = {
    "extra_V": 0.004, "friction_V": 0.004, "half_width_V": 0.002, "delay_s": 2e-4, "limit_V": 0.006,
    "drop_1_V": 5e-4, "lag_s": 2e-4,
}  # fmt: skip
MIN_DEVIATION_COUNTS = {"play_rad": 0.5}
# The least interval of a joint's play in which the plate falls, as shares of the value. Chosen:
# bounces that cannot be followed make it look small, 0.5 to 1.02 of what it was in simulations.
FALLING_LOW, FALLING_HIGH = 0.9, 2.2
RIDGE = 1e-6  # of the normal matrix, in steps^-2: a parameter on which no data depend
OWN_MIN_DEVIATION = 0.2  # of the tolerance, as that of a dead zone and hardly less than friction's
# As shares of the nominal value: where within a count a motor starts after a rest is not measured.
MIN_DEVIATION_SHARE = {"gain_rad_s_V": 0.0012, "time_constant_s": 0.006}


class Spread(NamedTuple):
    """The standard deviation s_i of a parameter (the module's equation), the number n of blocks,
    and the effective number n_i of those that tell of it."""

    std: float
    blocks: int
    telling: float


UNKNOWN, FIXED = Spread(inf, 2, 2.0), Spread(0.0, 2, 2.0)


def covariance(
    state: State, outputs: tuple[str, ...]
) -> tuple[list[str], np.ndarray, np.ndarray, int]:
    """Names of the k free parameters that move some outputs, their covariance (k, k) by the
    module's equation [units of the parameters], the effective numbers of blocks (k,), and n."""
    bounds = state.bounds(outputs)
    parameters = [state.nominal.parameters[name] for name in bounds]
    scale = np.array([k.step for k in parameters])
    a, g = _blocks(state, outputs, parameters, scale)
    cov, telling = jackknife(a, g, np.array([inverse_prior(state, k) for k in parameters]))
    return [k.name for k in parameters], cov * np.outer(scale, scale), telling, len(a)


def jackknife(a: np.ndarray, g: np.ndarray, prior: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The covariance (k, k) of the module's equation from A_b (n, k, k), g_b (n, k) and the
    diagonal (k,) of L, infinite for one block, of which none can be left out; and n_i (k,)."""
    n, k = g.shape
    if n < 2:
        return np.diag(np.full(k, np.inf)), np.ones(k)
    whole = a.sum(axis=0) + np.diag(prior + RIDGE)
    inverse, left = np.linalg.inv(whole), np.linalg.inv(whole - a)
    moved = np.einsum("bij,bj->bi", left, g)
    cov = (n - 1) / n * moved.T @ moved + (inverse * prior) @ inverse
    share = np.einsum("bij,bji->bi", left @ a, left)
    return cov, share.sum(axis=0) ** 2 / np.maximum((share * share).sum(axis=0), 1e-300)


def _blocks(
    state: State, outputs: tuple[str, ...], parameters: Sequence[Parameter], scale: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """A_b (n, k, k) and g_b (n, k) of every block of time, over all outputs; `scale` (k,): units of
    the parameters."""
    at = ParameterFit(state.fit.setting, {p: state.fit.rolls[p] for p in outputs}, {})
    columns = differences(state.evidence, state.nominal, at, parameters, state.bounds(outputs))
    of_row = blocks_of(state, outputs)
    a, g, begin = 0.0, 0.0, 0
    for output in outputs:
        z, mask = state.fit.z(output), state.evidence.masks[output]
        own = of_row[begin : begin + len(z)], int(of_row.max()) + 1
        begin += len(z)
        of_output = block_sums(columns[output] * scale, weights(z, mask), z, *own)
        a, g = a + of_output[0], g + of_output[1]
    return np.asarray(a), np.asarray(g)


def blocks_of(state: State, outputs: Sequence[str]) -> np.ndarray:
    """The number of the block of BLOCK_S in which each residual (n,) of the outputs lies, one
    output after the other."""
    times = [state.evidence.times(output) for output in outputs]
    labels = np.concatenate([np.column_stack([run, t // BLOCK_S]) for t, run in times])
    return np.unique(labels, axis=0, return_inverse=True)[1].ravel()


def block_sums(
    j: np.ndarray, w: np.ndarray, z: np.ndarray, block: np.ndarray, n: int
) -> tuple[np.ndarray, np.ndarray]:
    """A_b (n, k, k) and g_b (n, k) of J (m, k), weights and residuals (m,), and each row's block
    (m,)."""
    k = j.shape[1]
    a, g = np.zeros((n, k, k)), np.zeros((n, k))
    for b in np.unique(block):
        own = block == b
        weighted = j[own] * w[own, None]
        a[b], g[b] = weighted.T @ j[own], weighted.T @ z[own]
    return a, g


def inverse_prior(state: State, parameter: Parameter) -> float:
    """Inverse variance of a parameter's prior, in units of its step; 0 for a free one."""
    if (parameter.effect, parameter.axis) in state.named:
        return 0.0
    return inverse_variance(parameter, parameter.box) * parameter.step**2


def deviations(state: State) -> dict[str, Spread]:
    """The `Spread` of every free parameter, by its name."""
    found: dict[str, Spread] = {}
    groups = (
        [tuple(state.evidence.outputs)]
        if _coupled(state)
        else [(p,) for p in state.evidence.outputs]
    )
    for outputs in groups:
        names, cov, telling, blocks = covariance(state, outputs)
        for name, variance, number in zip(names, np.diag(cov), telling, strict=True):
            least = _min_deviation(state, state.nominal.parameters[name])
            std = float(np.sqrt(max(variance, 0.0) + least**2))
            found[name] = Spread(std, blocks, float(number))
    return found


def _min_deviation_of_own(state: State, parameter: Parameter) -> float:
    """The floor of a lab's own effect: OWN_MIN_DEVIATION of the tolerance of its size. What shapes
    it trades with what a healthy table may have (an angle with an offset): as large a share of half
    its range as the tolerance's deviation, t/sqrt(3), is of the size."""
    effect = state.nominal.catalogue[parameter.effect]
    first = state.nominal.of(parameter.effect, parameter.axis)[0]
    if parameter == first:
        return OWN_MIN_DEVIATION * effect.tolerance
    size = abs(state.fit.setting.get(first.name, first.nominal) - effect.parameters[0].null)
    share = effect.tolerance / sqrt(3.0) / max(size, effect.tolerance)
    return 0.5 * (parameter.upper - parameter.lower) * share


def _min_deviation(state: State, parameter: Parameter) -> float:
    if state.nominal.is_own(parameter.effect):
        return _min_deviation_of_own(state, parameter)
    count = state.nominal.rig.servo.encoder_step_rad
    least = MIN_DEVIATION.get(parameter.key, MIN_DEVIATION_COUNTS.get(parameter.key, 0.0) * count)
    if parameter.key in MIN_DEVIATION_SHARE:  # a limit's nominal value is infinite
        least += MIN_DEVIATION_SHARE[parameter.key] * abs(parameter.nominal)
    if parameter.key == "play_rad" and state.fit.setting.get(
        f"gear_backlash.{COAST_KEY}.{parameter.axis}"
    ):
        joint = BY_NAME["joint_backlash"].tolerance  # the plate lags by it as it coasts
        least = hypot(least, joint / sqrt(3.0))
    return least


def _coupled(state: State) -> bool:
    """True if one parameter moves several outputs, so that they share one covariance."""
    return (
        any(
            len(outputs_of(state.nominal.catalogue[name], (axis,))) > 1
            for name, axis in state.named
        )
        or state.nominal.load_friction
    )


def interval(value: float, spread: Spread) -> Interval:
    """95 % interval of a value by the module's equation; under 3 telling blocks count as 3."""
    reach = student_quantile(max(spread.telling - 1.0, 2.0)) * spread.std
    return Interval(value, value - reach, value + reach)


def interval_of(state: State, parameter: Parameter, spread: Spread) -> Interval:
    """`interval` of a parameter of the state, and no narrower than FALLING_LOW and FALLING_HIGH
    say where it is the play of a joint in which the plate falls."""
    value = state.fit.setting[parameter.name]
    one = interval(value, spread)
    if parameter.key == "play_rad" and state.fit.setting.get(parameter.beside(FALL_KEY)):
        low, high = min(one.low, FALLING_LOW * value), max(one.high, FALLING_HIGH * value)
        return Interval(value, low, high)
    return one
