"""What the report says beside the names."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.gap.findings import Interval, Named
from calibration.gap.model.fit import evaluate
from calibration.gap.model.parameters import NominalModel
from calibration.gap.model.state import State
from calibration.gap.name.decide import Decision
from calibration.gap.name.stepwise import Accepted, Naming, Rival
from calibration.gap.report.wording import notes, sentence
from tests.support.gap.tables import RIG, evidence_of, foreign


def decision(*, load_friction: bool) -> Decision:
    """A decision on a short log in which nothing was looked for."""
    evidence = evidence_of(foreign("steps", seed=2, duration_s=6.0))
    nominal = NominalModel(RIG, load_friction=load_friction)
    state = State(evidence, nominal, evaluate(evidence, nominal, {}, evidence.outputs))
    naming = Naming(state, state, (), (), (("", state),), [])
    return Decision("nothing-missing", naming, (), None, state)


@pytest.mark.parametrize("load_friction", [True, False])
def test_friction_that_nobody_measured_is_told_with_its_size(load_friction: bool):
    told = [note for note in notes(decision(load_friction=load_friction), {}) if "assumed" in note]
    assert len(told) == load_friction
    drive, servo = RIG.drive, RIG.servo
    volts = (drive.arm_friction_nm + drive.joint_friction_nm) / servo.torque_per_volt_nm
    for note in told:
        assert "servo x and servo y" in note
        assert float(note.split(" V ")[0]) == pytest.approx(volts, rel=0.05)
    assert np.isfinite(volts)


def test_a_name_that_is_not_certain_is_told_as_one():
    size = {"x": {"play_rad": Interval(0.03, 0.02, 0.04)}}
    sure, doubted = Named("joint_backlash", 0.99, (), size), Named("gear_backlash", 0.5, (), size)
    accepted = (Accepted("joint_backlash", ("x",), 30.0, ()),)
    one = replace(decision(load_friction=False), verdict="named", accepted=accepted)
    both = sentence(one, (sure, doubted))
    played = "joint_backlash (x 1.72 deg)"
    assert both.startswith(f"The model lacks {played}. It may lack gear_backlash (x 1.72 deg):")
    assert sentence(one, (sure,) * 3) == f"The model lacks {played}, {played} and {played}."
    assert sentence(one, (doubted,)).startswith("The model may lack gear_backlash (")
    assert "not certain" not in sentence(one, (sure,))


def test_a_name_that_is_certain_is_not_told_as_one_of_two():
    """Beside a friction with a rival it was "joint_backlash; coulomb_friction, or gear_backlash or
    dead_zone", with the far rival of the name that is certain."""
    named = decision(load_friction=False)
    far, near = Rival("gear_backlash", 40.0, named.state), Rival("dead_zone", 2.0, named.state)
    accepted = (
        Accepted("joint_backlash", ("x",), 300.0, (far,)),
        Accepted("coulomb_friction", ("x",), 50.0, (near,)),
    )
    size = Interval(0.03, 0.02, 0.04)
    names = (
        Named("joint_backlash", 0.99, (), {"x": {"play_rad": size}}),
        Named("coulomb_friction", 0.7, (), {"x": {"friction_V": size}}),
    )
    told = sentence(replace(named, verdict="undecided", accepted=accepted), names)
    assert told == (
        "The model lacks joint_backlash (x 1.72 deg). coulomb_friction (x 0.0300 V) or dead_zone: "
        "this log cannot tell them apart."
    )
