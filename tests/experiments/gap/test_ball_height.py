"""A ball that is higher than its pictures were taken for: a scale, and a shift with the tilt."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration.gap.investigation import investigate
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import RunRequest, simulate_run
from rig.parameters import Rig
from rig.prediction.innovations import noise, predict, signals

FRACTION, HEIGHT_M = 0.027, 0.02


def seen_too_low(*, noise_m: float) -> tuple[Rig, Rig]:
    """The nominal rig and the table: camera 0.74 m above the plate, the ball taken for a disc."""
    nominal = Rig()
    nominal = replace(nominal, camera=replace(nominal.camera, noise_m=noise_m))
    camera = replace(nominal.camera, ball_height_m=HEIGHT_M)
    hidden = {"camera_scale": {"xy": {"fraction": FRACTION}}}
    return nominal, replace(nominal, camera=camera, effects=hidden)


def recorded(plant: Rig, nominal: Rig):
    order = RunRequest(plant, read_protocol("steps"), "without", 4, Path(), kind=nominal)
    return simulate_run(order).log


def test_the_predictor_and_the_simulator_shift_it_alike():
    nominal, plant = seen_too_low(noise_m=1e-6)
    known = signals(recorded(plant, nominal), camera_delay_s=plant.camera.delay_s)
    levels = noise(ball_measured=1e-5, ball_process=0.01)
    flat = replace(plant, camera=nominal.camera)
    with_height, without = (
        np.sqrt(np.nanmean(predict(rig, known, levels).ball[30:] ** 2)) for rig in (plant, flat)
    )
    assert with_height < 3e-6 < 0.4 * without  # its noise and the tick


@pytest.mark.slow
def test_it_is_named_as_a_scale_and_the_height_goes_into_the_model():
    nominal, plant = seen_too_low(noise_m=3e-4)
    found = investigate([recorded(plant, nominal)], nominal, quick=True).findings
    assert [effect.name for effect in found.effects] == ["camera_scale"], found.sentence
    (pairs,) = found.effects[0].parameters.values()
    assert set(pairs) == {"fraction"}
    assert pairs["fraction"].value == pytest.approx(FRACTION, abs=0.004)
    assert found.rig_after is not None
    assert found.rig_after.camera.ball_height_m == pytest.approx(HEIGHT_M, rel=0.15)
    assert any("higher than its pictures" in note for note in found.notes)


@pytest.mark.slow
def test_a_scale_alone_says_nothing_of_the_ball():
    nominal, plant = seen_too_low(noise_m=3e-4)
    plant = replace(plant, camera=nominal.camera)
    found = investigate([recorded(plant, nominal)], nominal, quick=True).findings
    assert [effect.name for effect in found.effects] == ["camera_scale"], found.sentence
    assert found.rig_after is not None
    assert found.rig_after.camera.ball_height_m == 0.0
    assert not any("higher" in note for note in found.notes)
