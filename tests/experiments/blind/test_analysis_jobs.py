"""Logs by the contract, analysed elsewhere, under seal, resumable."""

import json
from pathlib import Path

import pytest

from experiments.blind.analysis_jobs import analyse_packed, pack_folder
from experiments.blind.command import AnalysisOptions, blind_trial, maker, run_trials
from experiments.blind.draws import TrialPlan, plan_trials
from experiments.blind.logs import write_logs
from experiments.blind.seal import SEAL, TRUTH, hash_of, open_seal, seal, sealed_hash
from experiments.records.importing import read_log
from experiments.workers import dask_client
from rig.log import CONTRACT
from tests.support.blind_fakes import failing_one, one_who_peeks, silent_one

TRIALS = plan_trials(TrialPlan(3, 1, 2, protocols=("steps",), kinds=("single", "stranger")))


def test_a_folder_holds_logs_and_rig_file_and_nothing_else(tmp_path: Path):
    paths = write_logs(TRIALS[0], tmp_path / "one")
    assert sorted(p.name for p in (tmp_path / "one").iterdir()) == [
        "log-1.csv",
        "log-2.csv",
        "rig.toml",
    ]
    header = paths[0].read_text(encoding="utf-8").split("\n", 1)[0].split(",")
    assert set(header) <= set(CONTRACT)
    log = read_log(paths[0])
    assert not log.notes
    assert len(log) > 14000
    again = write_logs(TRIALS[0], tmp_path / "two")
    assert paths[0].read_bytes() == again[0].read_bytes()


def test_the_seal_holds_and_shows_when_it_is_broken(tmp_path: Path):
    digest = seal(TRIALS, tmp_path)
    assert digest == sealed_hash(tmp_path) == hash_of(TRIALS)
    assert open_seal(tmp_path, digest) == TRIALS
    truth = tmp_path / TRUTH
    truth.write_text(truth.read_text(encoding="utf-8").replace('"single"', '"nothing"', 1))
    with pytest.raises(ValueError, match="seal is broken"):
        open_seal(tmp_path, digest)


def test_trials_run_elsewhere_and_go_on_where_they_stopped(tmp_path: Path):
    stated: list[str] = []
    shown: list[tuple[int, int]] = []

    def progress(stage: str, done: int, total: int) -> None:
        shown.append((done, total))

    scores = run_trials(
        TRIALS, tmp_path, AnalysisOptions(silent_one, jobs=1, say=stated.append, progress=progress)
    )
    assert hash_of(TRIALS) in stated[0]
    assert [m.trial for m in scores] == TRIALS
    assert shown == [(0, 4), (1, 4), (2, 4), (3, 4), (4, 4)]
    files = sorted((tmp_path / "answers").iterdir())
    seen = [json.loads(path.read_text(encoding="utf-8"))["answer"]["files"] for path in files]
    assert all(names == ["log-1.csv", "log-2.csv", "rig.toml"] for names in seen)
    kept = files[0].read_bytes()
    files[1].unlink()
    shown.clear()
    run_trials(
        TRIALS, tmp_path, AnalysisOptions(silent_one, jobs=1, say=stated.append, progress=progress)
    )
    assert shown == [(3, 4), (4, 4)]
    assert files[0].read_bytes() == kept
    with pytest.raises(ValueError, match="other trials"):
        run_trials(TRIALS[:2], tmp_path, AnalysisOptions(silent_one, say=stated.append))
    assert json.loads((tmp_path / SEAL).read_text(encoding="utf-8"))["trials"] == 4


def test_a_failed_analysis_is_an_answer_in_one_line(tmp_path: Path):
    write_logs(TRIALS[0], tmp_path)
    name, result = analyse_packed(("a", pack_folder(tmp_path)), failing_one)
    assert name == "a"
    assert result["answer"]["verdict"] == "failed"
    assert result["answer"]["sentence"] == "ValueError: nothing to see in blind-"


def test_nobody_stays_behind(tmp_path: Path):
    packed = maker(TRIALS)(TRIALS[0].name)
    assert sorted(packed) == ["log-1.csv", "log-2.csv", "rig.toml"]
    assert sorted(maker(TRIALS, tmp_path)(TRIALS[0].name)) == sorted(packed)
    assert (tmp_path / TRIALS[0].name / "log-1.csv").read_bytes() == packed["log-1.csv"]


@pytest.mark.slow
def test_a_cluster_that_is_not_there_is_said_in_one_line():
    with pytest.raises(ValueError, match="--cluster tcp://localhost:1"):
        dask_client("tcp://localhost:1")


@pytest.mark.slow
def test_the_command_writes_table_figures_and_results(tmp_path: Path):
    stated: list[str] = []
    results = blind_trial(
        trials=6, out=tmp_path, seed=4, effects=("dead_zone", "viscous_drag"),
        protocols=("servo-squares",), answer=one_who_peeks, jobs=1, say=stated.append,
    )  # fmt: skip
    assert results["trials"] == 12
    assert set(results["effects"]) <= {"dead_zone", "viscous_drag"}
    names = {path.name for path in tmp_path.iterdir()}
    assert {"table.md", "confusion.png", "power.png", "results.json", "seal.json"} <= names
    assert (
        "| right name, one hidden effect | at least 99 % |" in (tmp_path / "table.md").read_text()
    )
    again = blind_trial(trials=9, out=tmp_path, answer=one_who_peeks, jobs=1, say=stated.append)
    assert again["trials"] == 12  # without a seed, what is sealed there
    assert stated[0] == stated[1]


def test_onto_a_recorded_log(tmp_path: Path):
    path = write_logs(TRIALS[0], tmp_path / "own")[0]
    short = tmp_path / "log.csv"
    short.write_text("\n".join(path.read_text(encoding="utf-8").split("\n")[:1500]) + "\n")
    results = blind_trial(
        trials=1, out=tmp_path / "out", seed=4, onto=[short], answer=one_who_peeks, jobs=1,
        rig_file=tmp_path / "own" / "rig.toml", say=lambda text: None,
    )  # fmt: skip
    assert len(results["lines"]) == 2 * 16
    assert results["named"]["n"] == 32
    assert {line["effect"] for line in results["lines"]} >= {"dead_zone", "camera_yaw", "cogging"}
    assert (tmp_path / "out" / "table.md").read_text().startswith("As they came: ")
