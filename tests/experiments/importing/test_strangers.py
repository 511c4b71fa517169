"""Files of people who have not read how a map is proposed: right, or asked about what they lack."""

from pathlib import Path

import pytest

from experiments.importing.conversion import convert
from experiments.importing.formats.choose import read_recording
from experiments.importing.proposal import propose
from rig.log import CONTRACT
from tests.support.strangers import first
from tests.support.strangers.bench import faults

ASKS_MORE = {  # than a person would who sees the file
    "serial_plotter": "ball.unit",  # places without a unit, which pixels might be
    "json_array": "command.unit",  # radians, or a share
}


@pytest.mark.slow
@pytest.mark.parametrize("lab", first.LABS, ids=lambda lab: lab.__name__)
def test_right_without_a_question_or_asked_about_what_it_lacks(lab, tmp_path: Path):
    path, told = lab(tmp_path)
    recording = read_recording(path)
    found = propose(recording.stream)
    asked = " ".join(f"{doubt.option} {doubt.why}" for doubt in found.doubts)
    if more := ASKS_MORE.get(lab.__name__):
        assert [more in doubt.option for doubt in found.doubts] == [True]
    elif told.open_words:
        assert any(word in asked for word in told.open_words)
    else:
        assert not found.doubts, asked
        (log,) = convert(recording.stream, found.map())
        assert faults({name: log[name] for name in CONTRACT}, told) == []
