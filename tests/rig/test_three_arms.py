"""Derivatives of the plate's joints in closed form, against differences of the joints."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.three_arms import ARMS, joint, joint_slopes

STEP = 1e-6
sine = st.floats(-0.6, 0.6)


@pytest.mark.parametrize("arm", range(ARMS))
@given(s_x=sine, s_y=sine, height=st.floats(0.02, 0.2))
def test_they_are_what_differences_give(arm: int, s_x: float, s_y: float, height: float):
    pose = np.array([s_x, s_y, height])
    ends = [
        np.subtract(joint(arm, *(pose + by), 0.1), joint(arm, *(pose - by), 0.1)) / (2.0 * STEP)
        for by in STEP * np.eye(3)
    ]
    slopes = np.array(joint_slopes(arm, s_x, s_y, 0.1)).T
    np.testing.assert_allclose(slopes, np.array(ends), atol=1e-8)
