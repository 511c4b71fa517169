"""What is accepted and estimated on a table that shares no code with the product, and on tables
whose servos take an angle.
"""

from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from calibration.gap.model.parameters import NominalModel
from calibration.watch import run_estimates
from calibration.watch.run_estimates import accept, estimate
from experiments.benchmark.engines.foreign.table import make_log
from experiments.runs.assemble import load_rig
from rig.course import Course
from rig.log import Log
from rig.parameters import Drive, Rig
from tests.support.simulated import run

GAIN = 1.53  # of both servos, as the rig file has it
PLAYS = {"x": 0.022, "y": 0.0205}
OFFSETS = {"x": -0.124, "y": 0.1}
FRICTION = {"x": 0.07, "y": 0.037}


def log(seed: int, gain: float = 1.0) -> Log:
    """12 s of random steps."""
    effects = {
        "gear_backlash": {a: {"play_rad": play} for a, play in PLAYS.items()},
        "coulomb_friction": {a: {"friction_V": volts} for a, volts in FRICTION.items()},
        "voltage_offset": {a: {"offset_V": volts} for a, volts in OFFSETS.items()},
    }
    columns = make_log(
        "steps", effects=effects, seed=seed, imperfect=False, duration_s=12.0,
        gain=(GAIN * gain, GAIN * gain),
    )  # fmt: skip
    return Log.from_columns(columns)


def test_a_drive_with_play_friction_and_offset_is_accepted_as_what_it_is():
    """The rig file knows the plays to a tenth, nothing of the rest. From there alone the fit ended
    where a larger play stands for the offset, and a weaker supply was not seen."""
    known = {"gear_backlash": {"x": {"play_rad": 0.0235}, "y": {"play_rad": 0.0195}}}
    model = accept(
        [log(1)], Rig(effects=known, drive=Drive(arm_friction_nm=0.0, joint_friction_nm=0.0))
    )
    for axis in "xy":
        offset = model.value(f"voltage_offset.offset_V.{axis}")
        assert offset == pytest.approx(OFFSETS[axis], abs=0.01)
        play = model.value(f"gear_backlash.play_rad.{axis}")
        assert play == pytest.approx(PLAYS[axis], abs=0.0015)
    gains = [model.names.index(f".gain_rad_s_V.{axis}") for axis in "xy"]
    before, after = estimate(model, log(2)), estimate(model, log(3, 0.93))
    assert after.values[gains] / before.values[gains] == pytest.approx(np.full(2, 0.93), abs=0.02)


@pytest.mark.parametrize("name", ["hobby-two-servos", "bus-servos", "three-arms"])
def test_servos_that_take_an_angle_have_no_law_of_volts(name: str):
    rig = load_rig(Path(name))
    n = round(2 * rig.control_rate_hz)
    points = np.random.default_rng(1).uniform(-0.045, 0.045, (6, 2))
    driven = run(rig, 0, Course(np.repeat(points, n, axis=0), np.zeros((6 * n, 2))), 1)
    model = accept([driven.log], rig)
    assert any(one.startswith("servo_dead_time.delay_s") for one in model.names)
    before = estimate(model, driven.log)
    assert np.isfinite(before.values).all()


def test_what_is_watched_has_a_name_and_a_unit(monkeypatch: pytest.MonkeyPatch):
    """A gear's coasting is fitted beside its play: `rig watch` ended in a StopIteration."""
    nominal = NominalModel(Rig(), load_friction=False)
    state = Mock(nominal=nominal, named=run_estimates._named(nominal))
    monkeypatch.setattr(run_estimates, "_spread", lambda _: dict.fromkeys(nominal.parameters, 1.0))
    watched = run_estimates._watched(state)
    assert ("gear_backlash", "play_rad") in {(one.effect, one.key) for one in watched}
    assert all(run_estimates.unit_of(one) for one in watched)
