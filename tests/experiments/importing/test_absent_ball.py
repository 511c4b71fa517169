"""Which values mean `no ball`: a code that lasts, one of single rows, and none."""

import numpy as np
import pytest

from experiments.importing.absent_ball import absent_codes


def path(rng: np.random.Generator, rows: int = 1500) -> np.ndarray:
    """A ball that is steered about (140, 140) mm, read to 0.1 mm (rows, 2)."""
    t = np.arange(rows) / 50.0
    swing = 45.0 * np.sin(np.outer(t, rng.uniform(0.8, 1.6, 2)) + rng.uniform(0.0, 6.0, 2))
    return np.round(140.0 + swing + rng.normal(0.0, 0.3, (rows, 2)), 1)


@pytest.mark.parametrize("seed", range(5))
def test_a_detector_that_misses_single_rows(seed: int):
    rng = np.random.default_rng(seed)
    seen = path(rng)
    seen[rng.random(len(seen)) < 0.03] = -1.0
    assert absent_codes(list(seen.T)) == ((-1.0, -1.0), True)


@pytest.mark.parametrize("seed", range(5))
def test_a_ball_that_is_always_seen_has_no_code(seed: int):
    rng = np.random.default_rng(seed)
    assert absent_codes(list(path(rng).T)) == ((), True)
    assert absent_codes(list(np.round(path(rng)).T)) == ((), True)  # in whole mm
