"""The default table against a rig file that knows none of its effects: five act at once."""

from dataclasses import replace
from pathlib import Path

import pytest

from calibration.gap.investigation import investigate
from experiments.runs.assemble import load_rig
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import RunRequest, simulate_run

TABLE = load_rig(None)
BELIEVED = replace(TABLE, effects={})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("protocol", "arms"),
    [
        ("steps", ("without",)),
        ("free-release", ("without",)),
        ("free-release", ("with",)),
        ("free-release", ("without", "with")),
    ],
)
def test_what_acts_at_once_is_named_and_nothing_else(protocol: str, arms: tuple[str, ...]):
    course = read_protocol(protocol)
    runs = [RunRequest(TABLE, course, arm, 5, Path(), kind=BELIEVED) for arm in arms]
    logs = [simulate_run(run).log for run in runs]
    found = investigate(logs, BELIEVED, quick=True, until="name").findings
    assert {one.name for one in found.effects} == set(TABLE.effects), found.sentence
    for one in found.effects:
        for axis, pairs in one.parameters.items():
            key, size = next(iter(pairs.items()))
            truth = TABLE.effects[one.name][axis][key]
            assert size.value == pytest.approx(truth, rel=0.15)
            assert size.low < truth < size.high or size.value == pytest.approx(truth, rel=0.1)
