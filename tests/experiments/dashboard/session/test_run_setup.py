"""Runs of the virtual table are prepared one by one; one that cannot be leaves nothing behind."""

from dataclasses import replace
from pathlib import Path

import pytest

from experiments.dashboard.session import virtual_job
from experiments.dashboard.session.plan import planned_runs, shipped_plan
from experiments.dashboard.session.run_setup import RealRunSetup, VirtualRunSetup
from rig.parameters import Rig
from rig.rigfile import read_rig


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


def test_a_rig_file_that_was_changed_behind_the_page_starts_no_run(tmp_path: Path):
    """The page went on with the old limits, without a word, whatever the file said."""
    file = tmp_path / "table.toml"
    file.write_text('[table]\nkind = "serial"\nport = "none"\n')
    rig, plan = read_rig(file), shipped_plan("circle", "with play compensation", 1)
    setup = RealRunSetup(file, tmp_path)
    file.write_text(file.read_text() + "[servo]\nvoltage_limit_V = 2.0\n")
    with pytest.raises(ValueError, match=r"changed since .* start rig dashboard again"):
        setup.check(plan, rig)
    (planned,) = planned_runs(plan)
    with pytest.raises(ValueError, match="was changed"), setup.ready(planned, rig):
        pass
    assert not (tmp_path / "runs").exists()
