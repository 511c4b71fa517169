"""The same trials on a Dask cluster of two worker processes: the same answers, bit for bit.

Needs the extra `cluster`; without it the test is skipped, and says so.
"""

import json
from pathlib import Path

import pytest

from experiments.blind.command import AnalysisOptions, run_trials
from experiments.blind.draws import TrialPlan, plan_trials
from tests.support.blind_fakes import one_who_peeks
from tests.support.parts import need

need("distributed")


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # what a cluster warns of at its end is its own
def test_a_cluster_gives_the_same_answers_bit_for_bit(tmp_path: Path):
    trials = plan_trials(TrialPlan(5, 3, 2, protocols=("servo-squares",), kinds=("single",)))
    here = AnalysisOptions(one_who_peeks, jobs=2, say=lambda text: None)
    run_trials(trials, tmp_path / "here", here)
    import distributed

    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        there = AnalysisOptions(
            one_who_peeks, cluster=cluster.scheduler_address, say=lambda text: None
        )
        run_trials(trials, tmp_path / "there", there)
    for trial in trials:
        one, other = (
            json.loads((tmp_path / place / "answers" / f"{trial.name}.json").read_bytes())["answer"]
            for place in ("here", "there")
        )
        assert one == other
