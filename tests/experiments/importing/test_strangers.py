"""Files of people who have not read how a map is proposed: right, or asked about what they lack."""

from pathlib import Path

import pytest

from experiments.importing.conversion import convert
from experiments.importing.formats.choose import read_recording
from experiments.importing.proposal import propose
from rig.log import CONTRACT
from tests.support.strangers import first, fresh, third
from tests.support.strangers.bench import faults, run

ASKS_MORE = {  # than a person would who sees the file
    "serial_plotter": "ball.unit",  # places without a unit, which pixels might be
    "json_array": "command.unit",  # radians, or a share
    "motion_capture": "angle.kind",  # Plate Roll
}
BATCHES = (first, fresh, third)
FILES = pytest.mark.parametrize(
    "lab", [lab for batch in BATCHES for lab in batch.LABS], ids=lambda lab: lab.__name__
)


@pytest.mark.slow
@FILES
def test_right_without_a_question_or_asked_about_what_it_lacks(lab, tmp_path: Path):
    path, told = lab(tmp_path)
    recording = read_recording(path)
    found = propose(recording.stream)
    asked = " ".join(f"{doubt.option} {doubt.why}" for doubt in found.doubts)
    if more := ASKS_MORE.get(lab.__name__):
        assert [more in doubt.option for doubt in found.doubts] == [True], asked
    elif told.open_words:
        assert any(word in asked for word in told.open_words), asked
    else:
        assert not found.doubts, asked
        (log,) = convert(recording.stream, found.map())
        assert faults({name: log[name] for name in CONTRACT}, told) == []


@pytest.mark.slow
@pytest.mark.parametrize("more", [1000, 2000])
@FILES
def test_other_runs_are_never_silently_wrong(
    lab, more: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    for batch in BATCHES:
        monkeypatch.setattr(batch, "run", lambda seed, **how: run(seed + more, **how))
    path, told = lab(tmp_path)
    recording = read_recording(path)
    found = propose(recording.stream)
    assert found.doubts or not told.open_words
    if not found.doubts:
        (log,) = convert(recording.stream, found.map())
        assert faults({name: log[name] for name in CONTRACT}, told) == []
