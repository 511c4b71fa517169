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
