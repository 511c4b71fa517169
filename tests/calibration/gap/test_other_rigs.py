"""Rigs that are not ours: servos that turn far, balls in grooves, late cameras, poor logs."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calibration.gap.findings import Interval
from calibration.gap.investigation import investigate
from calibration.gap.model.data import DIVERGED_Z
from calibration.gap.model.fit import evaluate
from calibration.gap.model.parameters import BALL, NominalModel
from calibration.gap.report.wording import notes, vague
from experiments.gap.words import recalibration
from rig.discrepancy import Discrepancy
from rig.log import Log
from tests.support.gap.tables import RIG, evidence_of, foreign, released, without_columns


def test_a_model_that_runs_away_is_no_model_of_the_log():
    evidence = evidence_of(foreign("steps", seed=1, duration_s=6.0))
    nominal = NominalModel(RIG, load_friction=False)
    wild = nominal.with_unknown(Discrepancy(servo_map_x=(0.0, 0.0, 0.0, 1e9)))
    roll = evidence.roll(wild.model({}), "servo_x")
    assert np.all(roll.z[1:] == DIVERGED_Z)
    sane, lost = (evaluate(evidence, b, {}, ["servo_x"]).cost for b in (nominal, wild))
    assert lost > 100 * abs(sane)


@pytest.mark.slow
def test_a_solid_ball_in_a_groove_and_a_web_camera_are_found_beyond_the_usual():
    """A gain 30 % too small and pictures 0.15 s late, as on a ball and beam."""
    hidden = {"camera_scale": {"fraction": -0.3}, "camera_delay": {"extra_s": 0.15}}
    hidden = {name: {"xy": pairs} for name, pairs in hidden.items()}
    log = foreign("steps", seed=4, duration_s=20.0, effects=hidden)
    found = investigate([without_columns(log, "voltage")], RIG, until="name", quick=True).findings
    named = {effect.name: effect.parameters["xy"] for effect in found.effects}
    assert set(named) == {"camera_scale", "camera_delay"}, found.sentence
    assert named["camera_scale"]["fraction"].value == pytest.approx(-0.3, abs=0.02)
    assert named["camera_delay"]["extra_s"].value == pytest.approx(0.15, abs=0.01)
    assert not any("the most it may be" in note for note in found.notes)


def test_a_size_at_the_end_of_what_may_be_is_told():
    state = released(evidence_of(foreign("steps", seed=1, duration_s=6.0)), ("camera_yaw", "xy"))
    parameter = state.nominal.of("camera_yaw", "xy")[0]

    for value, told in (
        (parameter.upper, True),
        (parameter.lower, True),
        (0.5 * parameter.upper, False),
    ):
        fit = evaluate(state.evidence, state.nominal, {parameter.name: value}, [BALL])
        decided: Any = SimpleNamespace(state=replace(state, fit=fit), chance=None, change=None)
        assert bool(notes(decided, {})) is told


def test_a_gain_that_the_logs_do_not_tell_is_no_reason_to_recalibrate():
    sure, wide = Interval(2.0, 1.95, 2.05), Interval(36.0, -1.8, 73.8)
    assert (vague(sure), vague(wide)) == (False, True)
    assert recalibration("gain_x_rad_s_V", sure, RIG)[1]
    assert not recalibration("gain_x_rad_s_V", wide, RIG)[1]
    assert not recalibration("gain_x_rad_s_V", Interval(1.65, 1.5, 1.8), RIG)[1]


def bridge_log(seed: int, *, swallowed_V: float = 4.5, seconds: float = 8.0) -> Log:
    """A gear motor (K 2.5 rad/s/V, tau 0.12 s) behind an H-bridge that swallows the first volts,
    swept up, down and through zero at 100 Hz; 2400 counts, a load of 0.3 V rms."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 0.01)
    volts = 9.5 * np.sin(2 * np.pi * 0.21 * t + 0.4) + 1.5 * np.sin(2 * np.pi * 0.9 * t)
    inner, step = 20, 0.01 / 20
    load = np.repeat(rng.normal(0.0, 0.3, len(t)), inner)
    drive = np.repeat(volts, inner)
    drive = np.sign(drive) * np.maximum(np.abs(drive) - swallowed_V, 0.0) + load * (drive != 0)
    angle = speed = 0.0
    angles = [angle]
    for v in drive:
        speed += step / 0.12 * (2.5 * v - speed)
        angle += step * speed
        angles.append(angle)
    count = 2 * np.pi / 2400
    theta = count * np.round(np.array(angles[: inner * len(t) : inner]) / count)
    return Log.from_columns({"t_s": t, "voltage_x_V": volts, "theta_x_rad": theta})


BRIDGED = replace(
    RIG,
    servo=replace(
        RIG.servo, gain_rad_s_V=1.5, time_constant_s=0.05, encoder_counts_per_rev=2400,
        voltage_limit_V=12.0, angle_limit_rad=60.0, stop_rad=100.0,
    ),
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_bridge_that_swallows_half_the_volts_is_no_noise(seed: int):
    found = investigate([bridge_log(seed)], BRIDGED, until="name", quick=True).findings
    sizes = {effect.name: effect.parameters["x"] for effect in found.effects}
    assert set(sizes) == {"dead_zone"}, found.sentence
    for width in sizes["dead_zone"].values():  # one, or one a side
        assert width.value == pytest.approx(4.5, rel=0.07)
    assert found.calibrated["gain_x_rad_s_V"].value == pytest.approx(2.5, rel=0.05)
