"""A Start makes runs that are not there yet, and pairs stay pairs."""

from dataclasses import replace
from pathlib import Path

from experiments.dashboard.session.plan import BOTH, RunPlan, planned_runs, shipped_plan
from experiments.dashboard.session.seeds import with_new_seeds
from experiments.records.run_folder import new_run_folder, replace_json, write_truth
from experiments.records.run_folder import start_record as record
from experiments.runs.assemble import load_rig, with_play
from experiments.runs.runner import RunRequest, start_record, truth_record

RIG = load_rig(None)
WITHOUT = "without"


def made(plan: RunPlan, parent: Path, rig=RIG) -> list[tuple[int, str]]:
    """Seed and controller of the runs that a Start makes, whose run.json is written."""
    runs = planned_runs(with_new_seeds(plan, rig, parent))
    for run in runs:
        folder = new_run_folder(parent, plan.protocol.name, run.method)
        request = RunRequest(rig, plan.protocol, run.method, run.seed, parent)
        replace_json(folder / "run.json", record(start_record(request)))
        write_truth(folder, truth_record(request))
    return [(run.seed, run.method) for run in runs]


def test_every_start_takes_seeds_that_no_run_of_the_protocol_had(tmp_path: Path):
    both = shipped_plan("free-release", BOTH, 1)
    first = both.protocol.seed
    assert made(both, tmp_path) == [(first, "without"), (first, "with")]
    assert made(both, tmp_path) == [(first + 1, "without"), (first + 1, "with")]
    two = [seed for seed, _ in made(replace(both, repetitions=2), tmp_path)]
    assert two == [first + 2] * 2 + [first + 3] * 2
    assert made(shipped_plan("hold", BOTH, 1), tmp_path)[0][0] == first  # another protocol


def test_the_other_controller_alone_completes_the_pair_on_the_same_table_only(tmp_path: Path):
    alone = shipped_plan("free-release", WITHOUT, 1)
    first = alone.protocol.seed
    assert made(alone, tmp_path) == [(first, "without")]
    with_ = replace(alone, methods=("with",))
    worn = with_play(RIG, gear_rad=0.03, joint_rad=0.03)
    assert made(with_, tmp_path, worn) == [(first + 1, "with")]
    assert made(with_, tmp_path) == [(first, "with")]
