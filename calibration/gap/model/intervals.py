"""95 % intervals of fitted knobs that hold what they promise: the sandwich, by blocks of time.

cov = (A + L)^-1 (B + L) (A + L)^-1 with A = J'WJ, B the sum over blocks of a second of g g' with
g = sum J'Wz (what is left is neither white nor Gaussian), and L the inverse variances of the
knobs that stay in their box (half width t: 3/t^2), which the data may not know better.
"""

from math import hypot, sqrt

import numpy as np
from scipy.stats import t as student

from calibration.gap.findings import Interval
from calibration.gap.fit import Fit, differences, weights
from calibration.gap.knobs import COAST, Knob
from calibration.gap.state import State
from rig.effects import BY_NAME

BLOCK_S = 1.0
# What no log knows better, for the model is only nearly right: how friction sets in [V], a tenth of
# a tick, what a limit or a sagging supply leaves and, in encoder counts, where a play's teeth meet
# while its shafts wind up.
LEAST_DEVIATION = {
    "extra_V": 0.004, "friction_V": 0.004, "half_width_V": 0.002, "delay_s": 2e-4, "limit_V": 0.006,
    "drop_1_V": 5e-4,
}  # fmt: skip
WIDER = 1.45  # than the sandwich: with it 95 % held, in blind trials other than the README's
LEAST_COUNTS = {"play_rad": 0.5}
# Shares of the nominal: from where in its count a motor leaves after a rest, no log tells.
LEAST_SHARES = {"gain_rad_s_V": 0.0012, "time_constant_s": 0.006}


def covariance(state: State, parts: tuple[str, ...]) -> tuple[list[str], np.ndarray, int]:
    """Names of the free knobs of some parts, their covariance (k, k), and the blocks behind it."""
    bounds = state.bounds(parts)
    knobs = [state.believed.knobs[name] for name in bounds]
    at = Fit(state.fit.setting, {p: state.fit.rolls[p] for p in parts}, {})
    columns = differences(state.evidence, state.believed, at, knobs, bounds)
    scale = np.array([k.step for k in knobs])
    k = len(knobs)
    a, b, blocks = np.zeros((k, k)), np.zeros((k, k)), 0
    for part in parts:
        z = state.fit.z(part)
        w = weights(z, state.evidence.masks[part])
        j = columns[part] * scale
        a += (j * w[:, None]).T @ j
        g = j * (w * z)[:, None]
        t, run = state.evidence.times(part)
        block = np.unique(np.column_stack([run, t // BLOCK_S]), axis=0, return_inverse=True)[1]
        sums = np.zeros((block.max() + 1, k))
        np.add.at(sums, block.ravel(), g)
        b += sums.T @ sums
        blocks = max(blocks, len(sums))
    prior = np.array([_prior(state, k.effect, k.axis, k.tolerance, k.step) for k in knobs])
    inverse = np.linalg.inv(a + np.diag(prior + 1e-6))
    cov = inverse @ (b + np.diag(prior)) @ inverse
    return [k.name for k in knobs], cov * np.outer(scale, scale), blocks


def _prior(state: State, effect: str, axis: str, tolerance: float, step: float) -> float:
    """Inverse variance of a knob in its box, in units of its step; 0 for a free one."""
    if (effect, axis) in state.named or not np.isfinite(tolerance) or tolerance <= 0:
        return 0.0
    return 3.0 * (step / tolerance) ** 2


def deviations(state: State) -> dict[str, tuple[float, int]]:
    """Standard deviation of every free knob, and the blocks behind it."""
    found: dict[str, tuple[float, int]] = {}
    groups = (
        [tuple(state.evidence.parts)] if _coupled(state) else [(p,) for p in state.evidence.parts]
    )
    for parts in groups:
        names, cov, blocks = covariance(state, parts)
        for name, variance in zip(names, np.diag(cov), strict=True):
            least = _least(state, state.believed.knobs[name])
            found[name] = (float(np.sqrt(WIDER**2 * max(variance, 0.0) + least**2)), blocks)
    return found


def _least(state: State, knob: Knob) -> float:
    count = state.believed.rig.servo.encoder_step_rad
    least = LEAST_DEVIATION.get(knob.key, LEAST_COUNTS.get(knob.key, 0.0) * count)
    least += LEAST_SHARES.get(knob.key, 0.0) * abs(knob.believed)
    if knob.key == "play_rad" and state.fit.setting.get(f"gear_backlash.{COAST}.{knob.axis}"):
        joint = BY_NAME["joint_backlash"].tolerance  # through which the plate lags as it coasts
        least = hypot(least, joint / sqrt(3.0))
    return least


def _coupled(state: State) -> bool:
    """Does a knob feel more than one part?"""
    return (
        any(
            BY_NAME[name].axes == ("xy",) and BY_NAME[name].side == "servo"
            for name, _ in state.named
        )
        or state.believed.load_friction
    )


def interval(value: float, deviation: tuple[float, int]) -> Interval:
    """95 % interval of a knob by Student's t."""
    std, blocks = deviation
    reach = float(student.ppf(0.975, max(blocks - 1, 2))) * std
    return Interval(value, value - reach, value + reach)
