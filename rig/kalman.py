"""The scalar Kalman update that both play observers share."""

from rig.compiled import inlined


@inlined
def scalar_update(mean, cov, row, innovation, variance):
    """Update mean (4,) and cov (4, 4) in place by one scalar z = row . mean + noise.

    row: a tuple of 4; innovation = z - row . mean; variance of the noise. Returns the innovation's
    variance.
    """
    column = _dot(cov[0], row), _dot(cov[1], row), _dot(cov[2], row), _dot(cov[3], row)
    total = variance
    for i in range(4):
        total += row[i] * column[i]
    for i in range(4):
        mean[i] += column[i] / total * innovation
    for i in range(4):
        for j in range(4):
            cov[i, j] -= column[i] * column[j] / total
    return total


@inlined
def _dot(line, row):
    return line[0] * row[0] + line[1] * row[1] + line[2] * row[2] + line[3] * row[3]
