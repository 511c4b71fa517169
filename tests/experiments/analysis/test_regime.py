"""Every report says which regime its runs were in."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from experiments.analysis.regime import (
    BETWEEN,
    DROPS,
    KEEPS,
    ball_torque_nm,
    regime,
    regime_of_record,
    regime_sentence,
)
from experiments.paper.alternative_explanations import little_friction
from experiments.reports.report_runs import report_runs
from experiments.runs.assemble import load_rig
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import RunRequest, run
from rig.parameters import Rig
from rig.plant import plant, plant_record

TABLE = load_rig(None)


def with_friction(rig: Rig, joint_friction_nm: float) -> Rig:
    return replace(rig, drive=replace(rig.drive, joint_friction_nm=joint_friction_nm))


@pytest.mark.parametrize(
    ("friction_nm", "word"), [(0.02, KEEPS), (2e-3, KEEPS), (6e-4, BETWEEN), (1e-4, DROPS)]
)
def test_the_word_is_that_of_friction_against_the_ball(friction_nm: float, word: str):
    rig = with_friction(TABLE, friction_nm)
    assert regime(rig) == word
    assert word in regime_sentence(rig)
    assert f"{ball_torque_nm(rig):.2g} N m" in regime_sentence(rig)


@pytest.mark.parametrize(("friction_nm", "moves"), [(0.02, False), (1e-4, True)])
def test_the_simulated_plate_does_what_the_word_says(friction_nm: float, moves: bool):
    rig = with_friction(TABLE, friction_nm)
    p, s, seen = plant_record.pack(rig), plant.rest((0.1, 0.0)), np.full(7, np.nan)
    history, half = plant_record.no_volts(rig), rig.effects["joint_backlash"]["x"]["play_rad"] / 2
    for k in range(500):  # servos held, the ball kept 10 cm out
        s[plant.BALL], s[plant.BALL_W] = (0.1, 0.0), 0.0
        for row in (plant.MOTOR, plant.ARM, plant.MOTOR_RATE, plant.ARM_RATE):
            s[row] = 0.0
        plant.advance(s, p, history, k * 0.002, 0.002, 0.0, 0.0, False, np.inf, seen)
    assert (s[plant.PLATE, 0] > 0.8 * half) == moves
    assert (regime(rig) == DROPS) == moves


def test_a_record_says_what_its_rig_says_and_none_says_so():
    loose = with_friction(TABLE, 1e-4)
    assert regime_of_record(asdict(loose)) == regime_sentence(
        loose, "On this table, if its joints have play"
    )
    assert "not known" in regime_of_record(None)
    assert regime(little_friction(TABLE)) == KEEPS
    assert regime(replace(TABLE, ball=replace(TABLE.ball, mass_kg=0.0))) == KEEPS


def test_a_report_of_runs_names_each_runs_regime(tmp_path: Path):
    short = read_protocol("hold").model_copy(update={"duration_s": 1.0})
    rigs = (TABLE, with_friction(TABLE, 1e-4))
    folders = [run(RunRequest(rig, short, "with", 1, tmp_path / "runs")).folder for rig in rigs]
    (tmp_path / "out").mkdir()
    page = report_runs(folders, tmp_path / "out").read_text(encoding="utf-8")
    assert KEEPS in page
    assert DROPS.replace("'", "&#39;") in page
