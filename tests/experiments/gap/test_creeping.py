"""A servo that only creeps: friction's break-away decides there, and no name comes out of it."""

from pathlib import Path

import pytest

from calibration.gap.investigation import investigate
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import RunRequest, simulate_run
from rig.parameters import Rig


@pytest.mark.slow
@pytest.mark.parametrize("protocol", ["hold", "slow-triangle"])
def test_a_healthy_table_whose_servos_creep_gets_no_name_and_its_volts_are_not_judged(protocol):
    order = RunRequest(Rig(), read_protocol(protocol), "without", 3, Path(), kind=Rig())
    found = investigate([simulate_run(order).log], Rig(), quick=True).findings
    assert found.verdict == "nothing-missing", found.sentence
    assert found.calibrated == {}
    assert any("servo x only creeps" in note for note in found.notes)
    untold = {one.name: one.why for one in found.untestable}
    assert "servo that moves" in untold["coulomb_friction"]
