"""The covariance behind the intervals: what leaving out each block of a linear problem gives."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.gap.model.intervals import Spread, interval, jackknife

Problem = tuple[np.ndarray, np.ndarray, np.ndarray]


def problem(seed: int, blocks: int = 7, k: int = 3) -> Problem:
    """J (blocks, rows, k) and y (blocks, rows) of a linear model, and prior weights (k,)."""
    rng = np.random.default_rng(seed)
    j = rng.normal(size=(blocks, 9, k)) * rng.lognormal(size=(blocks, 1, 1))
    return j, rng.normal(size=(blocks, 9)), rng.choice([0.0, 2.0], k)


def solved(j: np.ndarray, y: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """argmin |y - J p|^2 + p' diag(prior) p, over all blocks (k,)."""
    j, y = j.reshape(-1, j.shape[-1]), y.ravel()
    return np.linalg.solve(j.T @ j + np.diag(prior), j.T @ y)


def sums(j: np.ndarray, y: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A_b and g_b of the residuals J p - y."""
    return np.einsum("bri,brj->bij", j, j), np.einsum("bri,br->bi", j, j @ at - y)


@given(st.integers(0, 2**32))
def test_it_is_the_scatter_of_fits_without_each_block(seed: int):
    j, y, prior = problem(seed)
    whole = solved(j, y, prior)
    rest = [solved(np.delete(j, b, 0), np.delete(y, b, 0), prior) for b in range(len(j))]
    moved = np.array(rest) - whole
    inverse = np.linalg.inv(sums(j, y, whole)[0].sum(0) + np.diag(prior))
    expected = (len(j) - 1) / len(j) * moved.T @ moved + inverse @ np.diag(prior) @ inverse
    assert jackknife(*sums(j, y, whole), prior)[0] == pytest.approx(expected, rel=1e-4, abs=1e-6)


FEW, MORE = [4.0, 3.0, 3.0, *[0.5] * 9], [*[3.0] * 5, *[0.5] * 7]  # what tells of it, by block


@pytest.mark.parametrize("tell", [FEW, MORE, [1.0] * 12])
def test_intervals_hold_the_truth_though_few_blocks_tell_of_it(tell: list[float]):
    rng, held, telling = np.random.default_rng(5), [], np.empty(0)
    for _ in range(1500):
        j = np.ones((12, 5, 1)) * np.array(tell)[:, None, None]
        y = rng.normal(size=(12, 5)) + rng.normal(size=(12, 1))  # alike within a block
        at = solved(j, y, np.zeros(1))
        cov, telling = jackknife(*sums(j, y, at), np.zeros(1))
        one = interval(float(at[0]), Spread(float(np.sqrt(cov[0, 0])), 12, float(telling[0])))
        held.append(one.low <= 0.0 <= one.high)
    assert 0.92 < np.mean(held) < 0.995  # wide where three tell of it
    squares = np.square(tell)
    parts = squares / (squares.sum() - squares) ** 2
    assert telling[0] == pytest.approx(parts.sum() ** 2 / (parts**2).sum(), rel=1e-6)


def test_one_block_tells_nothing():
    j, y, prior = problem(1, blocks=1)
    assert np.isinf(np.diag(jackknife(*sums(j, y, solved(j, y, prior)), prior)[0])).all()
