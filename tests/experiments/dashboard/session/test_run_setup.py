"""Runs of the virtual table are prepared one by one; one that cannot be leaves nothing behind."""

from dataclasses import replace
from pathlib import Path

import pytest

from experiments.dashboard.session import virtual_job
from experiments.dashboard.session.plan import planned_runs, shipped_plan
from experiments.dashboard.session.run_setup import VirtualRunSetup
from rig.parameters import Rig


def test_a_run_by_hand_that_cannot_be_made_does_not_leave_its_hand_to_the_next(tmp_path: Path):
    """The next run waited for a person who had not been asked for."""
    plan = shipped_plan("circle", "with play compensation", 1)
    setup = VirtualRunSetup(tmp_path)
    (tmp_path / "runs").write_text("in the way")
    (by_hand,) = planned_runs(replace(plan, by_hand=True))
    with pytest.raises(OSError, match="runs"), setup.ready(by_hand, Rig()):
        pass
    (tmp_path / "runs").unlink()
    (alone,) = planned_runs(plan)
    with setup.ready(alone, Rig()) as run:
        assert run.job.operator.func is virtual_job.virtual_operator
