"""The scalar Kalman update that both play observers share."""

import numpy as np

from rig.compiled import compiled


@compiled
def scalar_update(mean, cov, row, innovation, variance):
    """Update mean (n,) and cov (n, n) in place by one scalar z = row . mean + noise.

    row (n,); innovation = z - row . mean; variance of the noise. Returns the innovation's variance.
    """
    n = mean.shape[0]
    column = np.empty(n)
    total = variance
    for i in range(n):
        column[i] = 0.0
        for j in range(n):
            column[i] += cov[i, j] * row[j]
        total += row[i] * column[i]
    for i in range(n):
        mean[i] += column[i] / total * innovation
    for i in range(n):
        for j in range(n):
            cov[i, j] -= column[i] * column[j] / total
    return total
