"""Runs on the servos alone beside runs with the ball: what the dashboard advises to analyse."""

from pathlib import Path

import pytest

from experiments.gap.gap import investigate
from experiments.gap.short_answer import WANTED
from experiments.runs.assemble import known, load_rig
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import RunRequest, keep_simulated, simulate_run


@pytest.mark.slow
@pytest.mark.timeout(900)  # two minutes on a quiet machine
def test_the_advised_runs_of_the_houses_table_give_an_answer(tmp_path: Path):
    rig = load_rig(None)
    runs = []
    for name in WANTED:
        request = RunRequest(
            rig, read_protocol(name), "without", 1, tmp_path / "runs", kind=known(rig)
        )
        runs.append(keep_simulated(request, simulate_run(request)))
    found = investigate(runs, None)
    assert found.verdict in ("named", "unknown-effect", "undecided")
    assert found.sentence
