"""How one signal follows others, of signals of all kinds."""

import numpy as np

from experiments.importing.relations import responses


def test_a_signal_that_rests_but_for_a_moment_follows_nothing():
    """All that varied was left out as outliers, and what was left was divided by its power, 0."""
    t_s = np.arange(400) * 0.01
    resting = np.where((t_s > 2.0) & (t_s < 2.05), 1.0, 0.0)
    moving = np.sin(3.0 * t_s)
    (found,) = responses(t_s, resting, [moving], order=2)
    assert found is None or not found.sure


def test_what_changes_with_every_row_is_followed_though_rows_are_closer_than_the_grid():
    """Volts of a fast inner loop were picked from every second row, at random; of a speed that
    follows them exactly a tenth of the gain was left, and their sign was asked for."""
    rng = np.random.default_rng(5)
    t_s = np.arange(8000) * 0.005
    volts = 0.1 * np.sin(0.8 * t_s) + rng.normal(0.0, 1.0, len(t_s))
    angle = np.concatenate(([0.0], np.cumsum(1.5 * volts[:-1] * 0.005)))
    (found,) = responses(t_s, angle, [volts], order=1)
    assert found is not None
    assert found.sure
    np.testing.assert_allclose(found.gain, 1.5, rtol=0.1)
