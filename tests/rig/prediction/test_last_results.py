"""Results of a prediction that are asked for again."""

import numpy as np

from rig.prediction.last_results import KEPT, LastResults

T_S, ANGLES = np.arange(5.0), np.ones((5, 2))


def test_a_result_is_kept_by_what_it_follows_from():
    kept, made = LastResults(), []

    def compute() -> tuple[np.ndarray, np.ndarray]:
        made.append(1)
        return np.zeros(3), np.zeros(3)

    first = kept.of(b"a", (T_S, ANGLES), compute)
    assert kept.of(b"a", (T_S[:], ANGLES[:]), compute) is first  # another view of the same memory
    for key, inputs in (
        (b"b", (T_S, ANGLES)),
        (b"a", (T_S[:4], ANGLES)),
        (b"a", (T_S.copy(), ANGLES)),
        (b"a", (T_S, ANGLES.T)),
    ):
        assert kept.of(key, inputs, compute) is not first
    assert len(made) == KEPT + 1  # the first one has been forgotten
    assert kept.of(b"a", (T_S, ANGLES), compute) is not first
