"""What a prediction is worth: how it differs from another, and one that failed."""

import numpy as np
import pytest

from calibration.gap.model import data
from calibration.gap.model.data import DIVERGED_Z, Evidence, Roll
from calibration.gap.model.fit import loss
from calibration.gap.model.parameters import NominalModel
from tests.support.gap.tables import RIG, evidence_of, foreign, without_columns


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    return evidence_of(without_columns(foreign("steps", seed=5, duration_s=5.0), "ball", "target"))


def test_a_prediction_that_only_expects_larger_deviations_explains_nothing():
    rng = np.random.default_rng(1)
    base = Roll(rng.normal(size=100), rng.normal(size=100))
    assert Roll(base.z / 3.0, base.log_std + np.log(3.0)).change(base) == pytest.approx(0.0)
    moved = Roll(base.z + 1.0, base.log_std)
    assert moved.change(base) == pytest.approx(1.0)
    assert np.isfinite(Roll(base.z, base.log_std + 1e3).change(base)).all()


@pytest.mark.parametrize("lost", ["deviation", "angle"])
def test_a_prediction_that_failed_anywhere_costs_more_than_any_other(
    evidence: Evidence, lost: str, monkeypatch: pytest.MonkeyPatch
):
    model = NominalModel(RIG, load_friction=False).model({})
    good, predicted = evidence.roll(model, "servo_x"), data.servo_innovations

    def failed(*args):
        out, std = predicted(*args)
        (std if lost == "deviation" else out)[50] = np.nan
        return out, std

    monkeypatch.setattr(data, "servo_innovations", failed)
    bad = evidence.roll(model, "servo_x")
    assert np.isfinite(bad.log_std).all()
    assert np.abs(bad.z).max() == DIVERGED_Z
    mask = evidence.masks["servo_x"]
    assert loss(bad, mask) > 1e3 * abs(loss(good, mask))
    assert not bad.slope(good, 1.0).any()
    assert not bad.change(good).any()
