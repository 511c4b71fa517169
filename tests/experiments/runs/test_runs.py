"""Runs of a protocol through frames: the calibration is theirs as long as they last."""

from pathlib import Path

import pytest

from experiments.paper.reproduce import reproduce
from experiments.records.recording import lock
from experiments.runs import runs
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import FinishedRun, RunRequest
from rig.loop.loop import Ending
from rig.parameters import Rig


def test_two_programs_do_not_use_one_calibration(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The later one's, of another plate or seed, was used by the runs of the earlier one."""
    drawn, refused = [], []

    def calibrate(rig: Rig, out: Path, seed: int) -> Path:
        drawn.append(seed)
        return out / "calibration.json"

    def run(request: RunRequest, progress) -> FinishedRun:
        assert request.bundle == tmp_path / "calibration.json"
        with pytest.raises(ValueError, match=r"another program makes runs .* name another --out"):
            go(seed=9)
        refused.append(request.seed)
        return FinishedRun(tmp_path / "run", Ending("completed"), None)  # pyright: ignore[reportArgumentType]

    def go(seed: int) -> None:
        plan = read_protocol("circle")
        runs.run_protocol(
            Rig(), plan, arms=["with"], out=tmp_path, seed=seed, repetitions=2, frames=True
        )

    monkeypatch.setattr(runs, "calibrate_camera", calibrate)
    monkeypatch.setattr(runs, "run", run)
    go(seed=1)
    assert (drawn, refused) == ([1], [1, 2])
    go(seed=3)
    assert drawn == [1, 3]


def test_a_study_does_not_share_its_calibration_either(tmp_path: Path):
    """Another program's, of another ball, was used by the later of its runs through frames."""
    (tmp_path / runs.LOCK_FILE).touch()
    with (tmp_path / runs.LOCK_FILE).open("a") as held:
        assert lock(held.fileno())
        with pytest.raises(ValueError, match=r"another program makes runs .* name another --out"):
            reproduce(Rig(), tmp_path)
    assert [one.name for one in tmp_path.iterdir()] == [runs.LOCK_FILE]


@pytest.mark.parametrize("error", [KeyboardInterrupt(), SystemExit(143)], ids=repr)
def test_unfinished_runs_are_completed_however_the_study_is_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException
):
    def ended(*_: object):
        raise error

    mended = []
    monkeypatch.setattr("experiments.paper.reproduce._figure_runs", ended)
    monkeypatch.setattr("experiments.paper.reproduce.mend_unfinished", mended.append)
    with pytest.raises(type(error)):
        reproduce(Rig(), tmp_path, frames=False)
    assert mended == [tmp_path / "runs"]
