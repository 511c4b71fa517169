"""A ball on slow circles in a bowl: the plate tilts against its acceleration."""

import numpy as np
import pytest

from experiments.importing.import_map import stated
from experiments.importing.proposal import propose
from experiments.importing.recording import Stream

T = np.arange(0.0, 40.0, 0.02)
GAIN_M_S2 = 1.1  # of the ball for each radian of the servo


def circles(bowl_1_s2: float) -> Stream:
    """A ball that is led on circles with a step now and then, as measured to 0.1 mm."""
    rng, columns = np.random.default_rng(4), {"time [s]": T}
    for axis, period_s in (("x", 5.3), ("y", 4.7)):
        rates = 2 * np.pi / np.array([[period_s], [1.3]])
        swings = np.array([[0.06], [0.001]]) * np.sin(rates * T)
        tilt = ((bowl_1_s2 - rates**2) * swings).sum(axis=0) / GAIN_M_S2
        columns[f"{axis} [m]"] = swings.sum(axis=0) + 1e-4 * rng.standard_normal(len(T))
        columns[f"motor angle {axis} [rad]"] = tilt
    return Stream(columns)


@pytest.mark.parametrize("bowl_1_s2", [0.0, 4.0])
def test_a_sign_that_a_bowl_turns_round_is_asked(bowl_1_s2: float):
    found = propose(circles(bowl_1_s2), stated(("angle.kind=measured",)))
    asked = [doubt.option for doubt in found.doubts]
    signs = [found.draft["signals"][f"theta_{axis}_rad"].get("sign", 1) for axis in "xy"]
    assert signs == [1, 1]
    assert any("theta_x_rad.sign" in one for one in asked) == (bowl_1_s2 > 0.0)
