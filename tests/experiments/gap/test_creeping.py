"""A servo that only creeps: friction's break-away decides there, and no name comes out of it."""

from pathlib import Path

import pytest

from calibration.gap.investigation import investigate, levels_of, usable_runs
from calibration.gap.model.data import gather
from calibration.gap.model.parameters import SERVO, NominalModel
from calibration.gap.name.load_friction import creeping_servos
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import RunRequest, simulate_run
from rig.parameters import Rig


@pytest.mark.parametrize(
    ("protocol", "friction", "creeping"),
    [("hold", True, tuple(SERVO)), ("hold", False, ()), ("servo-squares", True, ())],
)
def test_a_servo_creeps_that_is_slow_against_the_friction_of_its_load(
    protocol: str, friction: bool, creeping: tuple[str, ...]
):
    brief = read_protocol(protocol).model_copy(update={"duration_s": 10.0})
    log = simulate_run(RunRequest(Rig(), brief, "without", 3, Path(), kind=Rig())).log
    evidence = gather(usable_runs([log], Rig()), levels_of(Rig()))
    assert creeping_servos(evidence, NominalModel(Rig(), load_friction=friction)) == creeping


@pytest.mark.slow
@pytest.mark.parametrize(
    "protocol",
    [
        "hold",
        "slow-triangle",
    ],
)
def test_a_healthy_table_whose_servos_creep_gets_no_name_and_its_volts_are_not_judged(protocol):
    order = RunRequest(Rig(), read_protocol(protocol), "without", 3, Path(), kind=Rig())
    found = investigate([simulate_run(order).log], Rig(), quick=True).findings
    assert found.verdict == "nothing-missing", found.sentence
    assert found.calibrated == {}
    assert any("servo x only creeps" in note for note in found.notes)
    untold = {one.name: one.why for one in found.untestable}
    assert "servo that moves" in untold["coulomb_friction"]
