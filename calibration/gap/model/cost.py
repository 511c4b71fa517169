"""The cost C of a prediction: minus its log-likelihood, with outliers bounded.

With e_i the innovations of an output, s_i the standard deviations that the filter expects of them,
and m_i the weights of the samples (`Evidence.masks`):

    C = sum_i m_i (rho(e_i/s_i) + log s_i),   rho(z) = z^2/2        for |z| <= h
                                                       h (|z| - h/2) beyond,  h = HUBER_Z

For Gaussian innovations C is minus the log-likelihood but for a constant (Schweppe, IEEE Trans.
Inf. Theory 11, 1965), so a difference of C is a log-likelihood ratio; Huber's rho (Ann. Math. Stat.
35, 1964) bounds the influence of outliers.
"""

import numpy as np

from calibration.gap.model.data import Roll

HUBER_Z = 3.0  # 0.27 % of Gaussian samples lie beyond


def loss(roll: Roll, mask: np.ndarray) -> float:
    """Cost C of one output (the module's equation) for the prediction `roll` and the weights `mask`
    (n,); infinite where all residuals are 0, which no prediction of a measurement gives."""
    return float(np.sum(losses(roll, mask))) if roll.z.any() else float("inf")


def losses(roll: Roll, mask: np.ndarray) -> np.ndarray:
    """The terms (n,) of `loss`."""
    return mask * (huber(roll.z) + roll.log_std)


def huber(z: np.ndarray) -> np.ndarray:
    """Huber's loss rho (n,) of residuals (n,) in expected standard deviations."""
    size = np.abs(z)
    return np.where(size <= HUBER_Z, 0.5 * size * size, HUBER_Z * (size - 0.5 * HUBER_Z))


def weights(z: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Huber's weights (n,) times `mask`: 1 for residuals |z| <= HUBER_Z, HUBER_Z/|z| beyond."""
    return mask * np.minimum(1.0, HUBER_Z / np.maximum(np.abs(z), 1e-300))
