"""`rig gap` on logs of all kinds: without a channel, at other rates, still, undecided."""

from pathlib import Path

import numpy as np
import pytest

from experiments.gap.gap import investigate
from experiments.records.exporting import export_log
from experiments.runs.protocol import read_protocol
from rig.log import Log
from tests.support.command import call
from tests.support.gap.exchange import (
    BALL_ONLY,
    SERVO_ONLY,
    answer,
    assert_contract,
    foreign,
    written,
)


@pytest.mark.parametrize(
    ("blank", "channels"),
    [
        (SERVO_ONLY, {"servo_x", "servo_y"}),
        (BALL_ONLY, {"ball_x", "ball_y"}),
        (("voltage_x", "theta_x", "ball_x", "target_x"), {"servo_y", "ball_y"}),
    ],
    ids=["servo only", "ball only", "one axis"],
)
def test_what_a_log_lacks_is_skipped_and_said_so(blank, channels, tmp_path, rig_file):
    path = written(tmp_path, foreign(10.0, seed=5), *blank)
    assert call("gap", path, "--rig", rig_file, "--out", tmp_path, "--until", "prove") == 0
    found = answer(tmp_path)
    assert_contract(found)
    assert found["verdict"] == "nothing-missing", found["sentence"]
    assert set(found["gap"]["before"]) == channels
    servo = {channel[-1] for channel in channels if channel.startswith("servo")}
    keys = [k for a in servo for k in (f"gain_{a}_rad_s_V", f"time_constant_{a}_s")]
    assert set(found["calibrated"]) == set(keys)
    lacking = {one["name"] for one in found["untestable"] if "lacks" in one["why"]}
    assert ("coulomb_friction" in lacking) == (not servo)
    assert ("rolling_resistance" in lacking) == (not any("ball" in c for c in channels))


@pytest.mark.parametrize("blank", [SERVO_ONLY, pytest.param((), marks=pytest.mark.slow)])
@pytest.mark.parametrize("rate_hz", [50.0, 1000.0])
def test_other_rates(rate_hz: float, blank: tuple[str, ...], tmp_path: Path, rig_file):
    path = written(tmp_path, foreign(10.0, rate_hz=rate_hz, hidden="offset"), *blank)
    assert call("gap", path, "--rig", rig_file, "--out", tmp_path, "--until", "name") == 0
    found = answer(tmp_path)
    assert found["verdict"] == "named", found["sentence"]
    assert [effect["name"] for effect in found["effects"]] == ["voltage_offset"]
    size = found["effects"][0]["parameters"]["y"]["offset_V"]["value"]
    assert size == pytest.approx(0.1, rel=0.1)


def test_no_motion_is_undecided_for_want_of_excitation(capsys, tmp_path: Path, rig_file):
    log = foreign()
    still = {name: np.zeros(len(log)) for name in log.columns if name[:5] in ("volta", "theta")}
    path = export_log(Log.from_columns({"t_s": log["t_s"], **still}), tmp_path / "still.csv")
    assert call("gap", path, "--rig", rig_file, "--out", tmp_path) == 0
    found = answer(tmp_path)
    assert_contract(found)
    assert found["verdict"] == "undecided"
    assert found["effects"] == []
    assert found["untestable"]
    assert "not enough excitation" in found["sentence"]
    assert "not enough excitation" in capsys.readouterr().out
    assert not (tmp_path / "rig.toml").exists()


@pytest.mark.slow
def test_two_names_between_which_no_log_decides_come_with_the_next_experiment(
    tmp_path: Path, rig_file
):
    """On one short roll to the middle two kinds of drag look alike."""
    log = foreign(8.0, seed=4, hidden="drag", protocol="corner")
    path = written(tmp_path, log, *BALL_ONLY)
    found = investigate([path], rig_file)
    assert_contract(found.to_json())
    assert found.verdict == "undecided", found.sentence
    pair = {"viscous_drag", "rolling_resistance"}
    assert {effect.name for effect in found.effects} == pair
    assert sum(effect.probability for effect in found.effects) == pytest.approx(1.0, abs=0.05)
    assert "cannot tell them apart" in found.sentence
    following = found.next_experiment
    assert following is not None
    assert set(following.separates) == pair
    assert read_protocol(following.protocol).duration_s <= following.seconds
    assert following.separation > 10
    assert not found.to_json()["unknown"]
