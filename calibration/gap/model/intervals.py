"""95 % intervals of fitted parameters: the sandwich covariance, clustered by blocks of time.

    cov = (A + L)^-1 (B + L) (A + L)^-1,   A = J'WJ,   B = sum_blocks g_b g_b',   g_b = sum_b J'Wz

J (n, k) secants, W Huber's weights, z residuals, blocks of SANDWICH_BLOCK_S within a run (the
residuals are neither white nor Gaussian: Liang and Zeger, Biometrika 73, 1986). L is diagonal: the
inverse variances of the priors (`calibration.gap.model.fit`). The standard deviation of parameter
i is

    s_i = sqrt(INTERVAL_FACTOR^2 cov_ii + m_i^2)

with m_i a floor for errors of the model that no length of log removes. The interval is
value -+ t(0.975, blocks - 1) s_i. It is not corrected for the selection of the effect.
"""

from math import hypot, sqrt

import numpy as np

from calibration.gap.findings import Interval
from calibration.gap.model.cost import weights
from calibration.gap.model.fit import ParameterFit, differences, inverse_variance
from calibration.gap.model.parameters import COAST_KEY, FALL_KEY, Parameter
from calibration.gap.model.state import State, outputs_of
from calibration.statistics import student_quantile
from rig.effects import BY_NAME

SANDWICH_BLOCK_S = 1.0  # chosen
# Floors m_i, chosen on simulated tables: how friction sets in [V], a tenth of a tick (a lag looks
# like a delay), what a limit
# or a sagging supply leaves and, in encoder counts, where gear teeth meet as their shafts wind up.
MIN_DEVIATION = {
    "extra_V": 0.004, "friction_V": 0.004, "half_width_V": 0.002, "delay_s": 2e-4, "limit_V": 0.006,
    "drop_1_V": 5e-4, "lag_s": 2e-4,
}  # fmt: skip
INTERVAL_FACTOR = 1.45  # with it 95 % of intervals held the truth in simulated tuning trials
MIN_DEVIATION_COUNTS = {"play_rad": 0.5}
# The least interval of a joint's play in which the plate falls, as shares of the value. Chosen:
# bounces that cannot be followed make it look small, 0.5 to 1.02 of what it was in simulations.
FALLING_LOW, FALLING_HIGH = 0.9, 2.2
OWN_MIN_DEVIATION = 0.2  # of the tolerance, as that of a dead zone and hardly less than friction's
# As shares of the nominal value: where within a count a motor starts after a rest is not measured.
MIN_DEVIATION_SHARE = {"gain_rad_s_V": 0.0012, "time_constant_s": 0.006}


def covariance(state: State, outputs: tuple[str, ...]) -> tuple[list[str], np.ndarray, int]:
    """Names of the k free parameters that move some outputs, their sandwich covariance (k, k) by
    the module's equation [units of the parameters], and the number of blocks."""
    bounds = state.bounds(outputs)
    parameters = [state.nominal.parameters[name] for name in bounds]
    at = ParameterFit(state.fit.setting, {p: state.fit.rolls[p] for p in outputs}, {})
    columns = differences(state.evidence, state.nominal, at, parameters, bounds)
    scale = np.array([k.step for k in parameters])
    k = len(parameters)
    a, b, blocks = np.zeros((k, k)), np.zeros((k, k)), 0
    for output in outputs:
        z = state.fit.z(output)
        w = weights(z, state.evidence.masks[output])
        j = columns[output] * scale
        a += (j * w[:, None]).T @ j
        g = j * (w * z)[:, None]
        t, run = state.evidence.times(output)
        block = np.unique(
            np.column_stack([run, t // SANDWICH_BLOCK_S]), axis=0, return_inverse=True
        )[1]
        sums = np.zeros((block.max() + 1, k))
        np.add.at(sums, block.ravel(), g)
        b += sums.T @ sums
        blocks = max(blocks, len(sums))
    prior = np.array([inverse_prior(state, k) for k in parameters])
    inverse = np.linalg.inv(a + np.diag(prior + 1e-6))
    cov = inverse @ (b + np.diag(prior)) @ inverse
    return [k.name for k in parameters], cov * np.outer(scale, scale), blocks


def inverse_prior(state: State, parameter: Parameter) -> float:
    """Inverse variance of a parameter's prior, in units of its step; 0 for a free one."""
    if (parameter.effect, parameter.axis) in state.named:
        return 0.0
    return inverse_variance(parameter, parameter.box) * parameter.step**2


def deviations(state: State) -> dict[str, tuple[float, int]]:
    """Standard deviation s_i (the module's equation) of every free parameter, and the number of
    blocks behind it: parameter name -> (std, blocks)."""
    found: dict[str, tuple[float, int]] = {}
    groups = (
        [tuple(state.evidence.outputs)]
        if _coupled(state)
        else [(p,) for p in state.evidence.outputs]
    )
    for outputs in groups:
        names, cov, blocks = covariance(state, outputs)
        for name, variance in zip(names, np.diag(cov), strict=True):
            least = _min_deviation(state, state.nominal.parameters[name])
            found[name] = (
                float(np.sqrt(INTERVAL_FACTOR**2 * max(variance, 0.0) + least**2)),
                blocks,
            )
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


def interval(value: float, deviation: tuple[float, int]) -> Interval:
    """95 % interval value -+ t(0.975, blocks - 1) std, for `deviation` = (std, blocks); under 3
    blocks count as 3."""
    std, blocks = deviation
    reach = student_quantile(max(blocks - 1, 2)) * std
    return Interval(value, value - reach, value + reach)


def interval_of(state: State, parameter: Parameter, deviation: tuple[float, int]) -> Interval:
    """`interval` of a parameter of the state, and no narrower than FALLING_LOW and FALLING_HIGH
    say where it is the play of a joint in which the plate falls."""
    value = state.fit.setting[parameter.name]
    one = interval(value, deviation)
    if parameter.key == "play_rad" and state.fit.setting.get(parameter.beside(FALL_KEY)):
        low, high = min(one.low, FALLING_LOW * value), max(one.high, FALLING_HIGH * value)
        return Interval(value, low, high)
    return one
