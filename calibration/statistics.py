"""Standard deviations and 95 % intervals of fitted numbers, once for every calibration.

Interval: estimate -+ t(0.975, freedom) * standard deviation, t the quantile of Student's
distribution. The standard deviation comes from one of

* independent repetitions (`mean_with_half_width`),
* the jackknife over groups of the data (`jackknife_std`; Efron, Ann. Stat. 7, 1979),
* the scatter between clusters of residuals (`clustered_covariance`; Liang and Zeger,
  Biometrika 73, 1986), where residuals of one cluster are correlated.
"""

import numpy as np
from scipy.stats import t as student

LEVEL = 0.95


def student_quantile(freedom: float, beyond: float = 1.0 - LEVEL) -> float:
    """Half width in standard deviations of a two-sided interval beyond which a share `beyond` of
    Student's t distribution lies: 0.975 quantile. Under 1 degree of freedom counts as 1."""
    return float(student.isf(beyond / 2, max(freedom, 1.0)))


def mean_with_half_width(values: np.ndarray | list[float]) -> tuple[float, float]:
    """Mean of independent `values` (n,) and half the width of its 95 % interval, both in the
    values' unit.

        half width = t(0.975, n - 1) s / sqrt(n),   s the sample standard deviation

    `ValueError`: under 2 values, whose scatter is unknown.
    """
    values = np.asarray(values, float)
    if len(values) < 2:
        raise ValueError(f"{len(values)} values: an interval needs at least 2")
    std = float(np.std(values, ddof=1)) / np.sqrt(len(values))
    return float(np.mean(values)), student_quantile(len(values) - 1) * float(std)


def jackknife_std(estimates: np.ndarray) -> np.ndarray:
    """Standard deviations (k,) of k parameters by the jackknife (Efron, Ann. Stat. 7, 1979).

        s^2 = (g - 1)/g sum_i (p_i - mean)^2

    `estimates` (g, k): each row fitted without one of g groups of the data. The interval has g - 1
    degrees of freedom.
    """
    estimates = np.asarray(estimates, float)
    g = len(estimates)
    return np.sqrt((g - 1) / g * np.sum((estimates - estimates.mean(axis=0)) ** 2, axis=0))


def clustered_covariance(
    jacobian: np.ndarray, residual: np.ndarray, clusters: np.ndarray
) -> np.ndarray:
    """Covariance (p, p) of a least-squares fit whose residuals are correlated within clusters
    (Liang and Zeger, Biometrika 73, 1986).

        n/(n - p) (J'J)^+ (sum_c g_c g_c') (J'J)^+,   g_c = J_c' r_c

    `jacobian` J (m, p) and `residual` r (m,) at the solution; `clusters` (m,): the label of each
    row's cluster; n: number of clusters (n - p counts as 1 if it is smaller).
    """
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    names = np.unique(clusters)
    meat = np.zeros_like(inverse)
    for name in names:
        g = jacobian[clusters == name].T @ residual[clusters == name]
        meat += np.outer(g, g)
    n = len(names)
    return inverse @ meat @ inverse * n / max(n - jacobian.shape[1], 1)
