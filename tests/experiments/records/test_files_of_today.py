"""Files written by the version whose formats are the contract stay readable, with their numbers.

`tests/data/today` holds a run folder (`rig run`, 1.5 s from the corner, seed 3), a rig file with
every kind of section, the bundle of `rig reproduce`, and the answer and rig file of `rig gap` on a
servo-squares run.
"""

import json

import numpy as np
import pytest

from calibration import bundle
from experiments.records.exporting import export_log
from experiments.records.importing import read_log
from experiments.records.recording import read_run
from rig.log import NAMES
from rig.rigfile import read_rig
from tests.support import DATA
from tests.support.gap.exchange import assert_contract

TODAY = DATA / "today"


def test_a_run_folder(tmp_path):
    run = read_run(TODAY / "run")
    assert (run.meta["source"], run.meta["arm"], run.meta["seed"]) == ("simulated", "with", 3)
    assert run.log.rows.shape == (956, len(NAMES))
    assert run.log["t_s"][[0, 600, -1]] == pytest.approx([0.0, 1.2, 1.91])
    assert run.log["theta_x_rad"][600] == -0.14572817484913592
    assert run.log["phase"][600] == 2.0
    seen = np.isfinite(run.log["ball_x_m"])
    assert 100 < seen.sum() < 125  # 60 Hz
    again = read_log(export_log(run.log, tmp_path / "run.csv"))
    np.testing.assert_array_equal(again["theta_x_rad"], run.log["theta_x_rad"])


def test_a_rig_file():
    rig = read_rig(TODAY / "rig.toml")
    assert (rig.servo.gain_rad_s_V, rig.ball.colour) == (1.7, "white")
    assert (rig.play.gear_x_rad, rig.play.gear_y_rad, rig.play.joint_x_rad) == (0.015, 0.016, 0.025)
    assert (rig.table.kind, rig.table.address) == ("remote", "192.0.2.7:7645")
    assert (rig.table.sign_volts, rig.table.swap) == ((1, -1), True)
    assert rig.tolerances == {"coulomb_friction": 0.02}
    assert rig.effects == {
        "gear_backlash": {"x": {"play_rad": 0.017453}, "y": {"play_rad": 0.016}},
        "coulomb_friction": {"x": {"friction_V": 0.0522}},
        "plate_bowl": {"xy": {"stiffness_1_s2": 0.2}},
    }


def test_a_calibration_bundle():
    found = bundle.load(TODAY / "calibration.json")
    assert (found.schema_version, found.source) == (1, "simulated")
    assert found.lens.matrix[0][0] == 1086.2152328714385
    assert (found.lens.width_px, found.lens.views) == (640, 22)
    assert found.plate is not None


def test_an_answer_of_the_gap_and_its_rig_file():
    answer = json.loads((TODAY / "gap.json").read_text())
    assert_contract(answer)
    assert answer["verdict"] == "undecided"
    gear = answer["effects"][0]
    assert gear["name"] == "gear_backlash"
    rig = read_rig(TODAY / "rig_of_gap.toml")
    play = gear["parameters"]["y"]["play_rad"]["value"]
    assert rig.effects["gear_backlash"]["y"]["play_rad"] == play
