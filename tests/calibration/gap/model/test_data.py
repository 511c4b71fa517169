"""What a prediction is worth: how it differs from another, and one that failed."""

from pathlib import Path

import numpy as np
import pytest

from calibration.gap.model import data
from calibration.gap.model.cost import loss
from calibration.gap.model.data import DIVERGED_Z, UNTOLD_S, Evidence, Roll
from calibration.gap.model.parameters import NominalModel
from rig.log import Log
from rig.rigfile import read_rig
from tests.support.gap.tables import RIG, evidence_of, foreign, without_columns
from tests.support.worlds import WORLDS


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


def test_what_a_tracker_tells_that_lost_the_ball_is_left_out():
    log = foreign("steps", seed=5, duration_s=20.0)
    columns = {name: log[name].copy() for name in log.columns}
    t_s, seen = columns["t_s"], ~np.isnan(columns["ball_x_m"])
    columns["ball_exposed_s"] = np.where(seen, t_s, np.nan)
    whole = data.usable(Log.from_columns(columns), camera_delay_s=0.0)
    nowhere, latched = (seen & (t_s > begin) & (t_s < begin + 3.0) for begin in (5.0, 17.0))
    for name in ("ball_x_m", "ball_y_m"):
        columns[name][nowhere] = 0.0
        columns[name][latched] = columns[name][latched][0]
    run = data.usable(Log.from_columns(columns), camera_delay_s=0.0)
    assert run.repeats == nowhere.sum() + latched.sum()
    assert whole.repeats == run.outliers == 0
    assert not np.isin(run.exposed_s, t_s[nowhere | latched]).any()
    assert len(run.exposed_s) == pytest.approx(0.7 * len(whole.exposed_s), rel=0.05)


@pytest.mark.parametrize("name", ["late_servo", "late_bus_servo"])
def test_behind_a_hole_nothing_counts_that_shows_what_the_servos_were_told_in_it(
    name: str, tmp_path: Path
):
    columns, rig, _ = WORLDS[name](4100)
    (tmp_path / "rig.toml").write_text(rig, "utf-8")
    begin, count = len(columns["t_s"]) // 2, 20
    kept = {key: np.delete(values, slice(begin, begin + count)) for key, values in columns.items()}
    table = read_rig(tmp_path / "rig.toml")
    holed = evidence_of(Log.from_columns(kept), rig=table)
    end_s = kept["t_s"][begin]
    assert holed.outputs
    for output in holed.outputs:
        t_s, mask = holed.times(output)[0], holed.masks[output] > 0
        assert not mask[
            t_s < kept["t_s"][0] + UNTOLD_S
        ].any()  # what came before is not told either
        behind = (t_s >= end_s) & (t_s < end_s + UNTOLD_S)
        assert behind.any()
        assert not mask[behind].any()
        assert mask[t_s >= end_s + UNTOLD_S].any()


def test_behind_a_hole_servos_that_take_volts_count_at_once():
    log = without_columns(foreign("steps", seed=5, duration_s=5.0), "ball", "target")
    rows = np.delete(log.rows, slice(1000, 1020), axis=0)
    holed = evidence_of(Log.from_rows(rows))
    t_s = holed.times("servo_x")[0]
    behind = (t_s >= rows[1000, 0]) & (t_s < rows[1000, 0] + UNTOLD_S)
    assert np.mean(holed.masks["servo_x"][behind] > 0) > 0.9


@pytest.mark.parametrize("delay_s", [-0.019, 0.0, 0.1213, 0.238, 0.3999 - 1e-3])
def test_no_frame_of_the_beginning_comes_or_goes_with_the_delay_that_is_tried(
    delay_s: float, tmp_path: Path
):
    """The first residuals of a filter that begins with another frame are others altogether: such a
    secant outweighed all the rest of a log."""
    columns, rig, _ = WORLDS["late_camera_250ms_at_60hz"](3930)
    (tmp_path / "rig.toml").write_text(rig, "utf-8")
    table = read_rig(tmp_path / "rig.toml")
    seen = evidence_of(Log.from_columns(columns), rig=table)
    nominal = NominalModel(table, load_friction=False)
    here, beyond = (
        seen.roll(nominal.model({"camera_delay.extra_s.xy": delay_s + more_s}), "ball").z
        for more_s in (0.0, 1e-3)
    )
    assert np.max(np.abs(beyond - here)[seen.masks["ball"] > 0]) < 0.5
