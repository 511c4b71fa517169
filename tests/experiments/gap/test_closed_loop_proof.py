"""The extended simulator behaves like the recording, where the plain one does not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.gap.closed_loop_proof import closed_loop_rows
from experiments.gap.input import GapInput, read_evidence
from experiments.runs.assemble import known, load_rig
from experiments.runs.protocol import Protocol, read_protocol
from experiments.runs.runner import RunRequest, keep_simulated, run, simulate_run

TRUTH = load_rig(None)
WITHOUT_PLAY = replace(
    TRUTH, effects={k: v for k, v in TRUTH.effects.items() if k != "joint_backlash"}
)
HOLD = read_protocol("hold").model_copy(update={"duration_s": 30.0})


def recorded(folder: Path, protocol: Protocol, *, arm: str = "without", seed: int = 9) -> Path:
    order = RunRequest(TRUTH, protocol, arm, seed, folder)
    return keep_simulated(order, simulate_run(order))


def by_name(inputs: GapInput, before=WITHOUT_PLAY, after=TRUTH, seeds: int = 3) -> dict:
    return {row.quantity: row for row in closed_loop_rows(inputs, before, after, seeds=seeds)}


@pytest.fixture(scope="module")
def holding(tmp_path_factory: pytest.TempPathFactory) -> GapInput:
    return read_evidence([recorded(tmp_path_factory.mktemp("hold"), HOLD)])


def test_with_its_hidden_play_the_model_cycles_like_the_table(holding: GapInput):
    rows = by_name(holding)
    for axis in "xy":
        row = rows[f"limit cycle amplitude {axis}"]
        assert row.measured > 5.0
        assert row.unit == "mm"
        assert abs(row.after / row.measured - 1) < 0.1
        assert abs(row.before / row.measured - 1) > 0.3
        assert abs(rows[f"limit cycle period {axis}"].after / 3.2 - 1) < 0.1
    spread = rows["spread"]
    assert abs(spread.after - spread.measured) < 0.2 * abs(spread.before - spread.measured)


def test_a_run_through_the_real_loop_serves_as_well(tmp_path: Path):
    short = HOLD.model_copy(update={"duration_s": 12.0})
    rows = by_name(read_evidence([run(RunRequest(TRUTH, short, "without", 4, tmp_path)).folder]))
    row = rows["limit cycle amplitude x"]
    assert abs(row.after - row.measured) < abs(np.nan_to_num(row.before) - row.measured)


@pytest.mark.slow
def test_the_ball_is_pushed_as_in_the_recording(tmp_path: Path):
    rows = by_name(read_evidence([recorded(tmp_path, read_protocol("pushed"), arm="with")]))
    assert abs(rows["spread"].after / rows["spread"].measured - 1) < 0.05
    assert abs(rows["settling time"].after - rows["settling time"].measured) < 0.5


def test_the_same_noise_meets_both_models(holding: GapInput):
    for row in closed_loop_rows(holding, TRUTH, TRUTH, seeds=2):
        assert row.before == row.after


@pytest.mark.slow
def test_a_moving_target_is_compared_by_its_error_and_groups_are_told_apart(tmp_path: Path):
    protocols = [read_protocol(name) for name in ("steps", "servo-squares", "free-release")]
    inputs = read_evidence([recorded(tmp_path, protocol) for protocol in protocols])
    rows = by_name(inputs, seeds=1)
    assert {"tracking error (steps, without)", "spread (free-release, without)"} <= set(rows)
    assert not any("squares" in quantity for quantity in rows)
    error = rows["tracking error (steps, without)"]
    assert abs(error.after / error.measured - 1) < 0.05


def test_a_run_that_was_stopped_early_is_simulated_as_long(holding: GapInput):
    log = holding.logs[0]
    cut = replace(holding, logs=(log.where(log["t_s"] < 11.0),))
    longer, shorter = by_name(holding)["spread"], by_name(cut)["spread"]
    assert shorter.after != longer.after
    assert abs(shorter.after / shorter.measured - 1) < 0.15


def test_a_model_that_loses_the_ball_has_no_numbers(holding: GapInput):
    hill = replace(TRUTH, effects={"plate_bowl": {"xy": {"stiffness_1_s2": -6.0}}})
    row = by_name(holding, after=hill)["spread"]
    assert np.isnan(row.after)
    assert row.measured > 0


def test_recordings_without_a_known_controller_are_skipped(holding: GapInput):
    for nothing in (
        {"arms": (None,)},
        {"arms": ("mine",)},
        {"protocols": (None,)},
        {"protocols": ({"title": "of another version", "lasts": 3},)},
        {"seeds": (None,)},
    ):
        assert closed_loop_rows(replace(holding, **nothing), known(TRUTH), TRUTH) == ()
    at_centre = HOLD.model_dump() | {"pushes": {"kind": "at-centre"}}
    assert closed_loop_rows(replace(holding, protocols=(at_centre,)), known(TRUTH), TRUTH) == ()
