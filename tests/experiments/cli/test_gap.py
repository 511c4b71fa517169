"""`rig gap` from the command line: what it takes, what it writes, how it ends."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from experiments.gap import demo
from experiments.records.recording import read_run
from experiments.runs.protocol import Protocol, read_protocol
from experiments.runs.runner import RunRequest, keep_simulated, simulate_run
from rig.rigfile import read_rig
from tests.support.command import call
from tests.support.gap.exchange import RIG, SERVO_ONLY, answer, assert_contract, foreign, written
from tests.support.gap.findings import named

PLAY = {"joint_backlash": {"x": {"play_rad": 0.04}}}


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory) -> Path:
    """A run folder of a simulated table with play in a joint that its rig file does not know."""
    steps = read_protocol("steps").model_copy(update={"duration_s": 10.0})
    plant, folder = replace(RIG, effects=PLAY), tmp_path_factory.mktemp("runs")
    order = RunRequest(plant, steps, "without", 5, folder, kind=RIG)
    return keep_simulated(order, simulate_run(order))


@pytest.mark.slow
def test_a_run_folder_from_end_to_end(run_folder: Path, tmp_path: Path):
    """One long call, then: what it wrote, that the rig file runs, and that it needed no truth."""
    out = tmp_path / "out"
    assert call("gap", run_folder, "--out", out, "--json", out / "a.json") == 0
    assert_report_json_and_rig_file(out)
    assert_the_simulated_table_has_the_play(out / "rig.toml", tmp_path)
    assert_the_same_without_the_truth(run_folder, answer(out), tmp_path)


def assert_report_json_and_rig_file(whole: Path) -> None:
    found = answer(whole)
    assert_contract(found)
    assert json.loads((whole / "a.json").read_text()) == found
    assert found["verdict"] == "named"
    (effect,) = found["effects"]
    assert effect["name"] == "joint_backlash"
    play = effect["parameters"]["x"]["play_rad"]
    assert play["value"] == pytest.approx(0.04, rel=0.05)
    assert effect["parameters"]["y"] == {}
    assert found["gap"]["held_out"]
    assert found["gap"]["after"]["ball_x"] < 1.1 < found["gap"]["before"]["ball_x"]
    page = (whole / "gap.html").read_text()
    assert "joint_backlash" in page
    assert "http" not in page.replace("http-equiv", "").replace("http://www.w3.org", "")
    believed = read_rig(whole / "rig.toml")
    assert believed.effects["joint_backlash"]["x"]["play_rad"] == pytest.approx(play["value"])


def assert_the_simulated_table_has_the_play(rig_file: Path, tmp_path: Path) -> None:
    quick = tmp_path / "quick.toml"
    quick.write_text('title = "quick"\nduration_s = 1.0\n[start]\nhold_s = 0.0\n')
    assert call("run", quick, "--rig", rig_file, "--out", tmp_path, "--arm", "with") == 0
    (folder,) = (tmp_path / "runs").iterdir()
    plant = json.loads((folder / "truth.json").read_text())["rig"]["effects"]
    known = read_run(folder).meta["rig"]["effects"]
    added = read_rig(rig_file).effects["joint_backlash"]["x"]["play_rad"]
    assert plant["joint_backlash"]["x"]["play_rad"] == added
    assert not known  # controllers see everything but the effects


def assert_the_same_without_the_truth(run_folder: Path, full: dict, tmp_path: Path) -> None:
    copy = tmp_path / run_folder.name
    shutil.copytree(run_folder, copy)
    (copy / "truth.json").unlink()
    assert call("gap", copy, "--out", tmp_path / "blind", "--until", "name") == 0
    blind = answer(tmp_path / "blind")
    for key in ("verdict", "sentence", "effects", "calibrated", "untestable", "ranking"):
        assert blind[key] == full[key]


@pytest.mark.parametrize("stage", ["locate", "name", "prove"])
def test_a_csv_stops_at_the_stage_that_is_asked_for(stage: str, tmp_path: Path, rig_file):
    path = written(tmp_path, foreign(hidden="offset"), *SERVO_ONLY)
    assert call("gap", path, "--rig", rig_file, "--out", tmp_path, "--until", stage) == 0
    found = answer(tmp_path)
    assert_contract(found)
    assert found["where"][0]["channel"] == "servo_y"
    assert (found["gap"]["after"] != {}) == (stage == "prove")
    assert found["next_experiment"] is None
    if stage == "name":
        assert [effect["name"] for effect in found["effects"]] == ["voltage_offset"]


@pytest.mark.slow
def test_tolerances_come_from_five_clean_runs(capsys, tmp_path: Path, rig_file):
    names = []
    for seed in range(1, 6):
        log = foreign(6.0, seed=seed)
        names.append(written(tmp_path, log, *SERVO_ONLY, name=f"log-{seed}.csv"))
    out = tmp_path / "out"
    assert call("gap", "--tolerances-from", *names, "--rig", rig_file, "--out", out) == 0
    rig = read_rig(out / "rig.toml")
    learned = rig.tolerances
    assert learned["coulomb_friction"] >= 0.015
    assert learned["voltage_offset"] >= 0.02
    assert "rolling_resistance" not in learned  # nobody saw a ball
    assert set(rig.floors) == {"servo_x", "servo_y"}
    hidden = foreign(6.0, seed=7, hidden="offset")
    log = written(tmp_path, hidden, *SERVO_ONLY, name="hidden.csv")
    assert call("gap", log, "--rig", out / "rig.toml", "--out", tmp_path) == 0
    gap = answer(tmp_path)["gap"]
    assert gap["floor"] == "repeated runs"
    assert gap["floor_si"] == pytest.approx(rig.floors)
    assert gap["before"]["servo_y"] > 1.2
    assert gap["after"]["servo_y"] == pytest.approx(1.0, abs=0.1)
    assert call("gap", "--tolerances-from", *names[:4], "--rig", rig_file, "--out", out) == 2
    assert "at least 5" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], ["no log given"]),
        (["no-such.csv"], ["no-such.csv"]),
        (["log.csv", "--until", "guess"], ["--until guess", "locate, name, add, prove, next"]),
        (["log.csv", "--rig", "no.toml"], ["no.toml", "not found"]),
        (["log.csv", "log.csv"], ["named twice"]),
        (["log.csv", "--demo"], ["--demo"]),
        (["log.csv", "--guess"], ["--guess", "--demo"]),
        (["log.csv", "--blind-trial"], ["--blind-trial"]),
        (["--blind-trial", "--onto"], ["--onto"]),
        (["log.csv", "--out", "log.csv"], ["log.csv", "folder"]),
    ],
)
def test_bad_input_is_exit_2_and_one_line(arguments, words, capsys, monkeypatch, tmp_path: Path):
    monkeypatch.chdir(tmp_path)
    written(tmp_path, foreign(), *SERVO_ONLY)
    assert call("gap", *arguments) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if line.strip()]
    assert len(lines) == 1, lines
    for word in words:
        assert word in lines[0]


def short(name: str) -> Protocol:
    """As shipped, but for the time that it takes."""
    return read_protocol(name).model_copy(update={"duration_s": 10.0})


def test_the_demo_hides_a_play_of_which_the_investigation_is_not_told(
    capsys, monkeypatch, tmp_path: Path
):
    asked = []
    monkeypatch.setattr(demo, "read_protocol", short)
    monkeypatch.setattr(
        "experiments.cli.gap._investigate_and_report",
        lambda runs, **more: asked.append((runs, more)) or named(),
    )
    assert call("gap", "--demo", "--out", tmp_path, "--seed", "2") == 0
    told = capsys.readouterr().out
    before, hidden, _ = told.partition("Hidden in the demo's simulated table")
    assert hidden
    assert "deg" not in before.replace(str(tmp_path), "")
    assert "rad" not in told.replace(str(tmp_path), "")  # one unit for what was hidden and found
    assert "joint play x: found 2.01 [1.93, 2.09] deg, truth 2.01 deg: agrees" in told
    ((runs, more),) = asked
    assert (more["rig_file"], more["until"]) == (None, "next")
    assert runs
    for run in runs:
        assert set(json.loads((run / "truth.json").read_text())["rig"]["effects"]) == {
            "joint_backlash"
        }
        assert read_run(run).meta["rig"]["effects"] == {}


def test_a_person_guesses_before_the_analysis_and_the_hidden_is_told_last(
    monkeypatch, capsys, tmp_path: Path
):
    asked, answers = [], iter((1.5, 2.5))
    monkeypatch.setattr(demo, "read_protocol", short)
    monkeypatch.setattr("experiments.gap.guess.clues", lambda runs, seed: ["a clue"])
    monkeypatch.setattr("typer.prompt", lambda text, type: asked.append(text) or next(answers))
    monkeypatch.setattr(
        "experiments.cli.gap._investigate_and_report",
        lambda runs, **more: SimpleNamespace(effects=[]),
    )
    assert call("gap", "--demo", "--guess", "--out", tmp_path, "--seed", "2") == 0
    told = capsys.readouterr().out
    assert asked == ["play of x [degrees]", "play of y [degrees]"]
    before, _, after = told.partition("a clue")
    assert "hidden" not in before
    assert "you 1.50, the analysis nothing degrees: you are nearer" in after
    assert "the same game again: --seed 2" in after


@pytest.mark.slow
def test_the_demo_finds_names_adds_and_closes_its_play(capsys, monkeypatch, tmp_path: Path):
    monkeypatch.setattr(demo, "read_protocol", short)
    assert call("gap", "--demo", "--out", tmp_path, "--seed", "2") == 0
    found = answer(tmp_path)
    assert_contract(found)
    assert [effect["name"] for effect in found["effects"]] == ["joint_backlash"]
    for axis, play in (("x", 0.035), ("y", 0.020)):
        size = found["effects"][0]["parameters"][axis]["play_rad"]["value"]
        assert size == pytest.approx(play, rel=0.1)
        assert found["gap"]["after"][f"ball_{axis}"] < 1.1 < found["gap"]["before"][f"ball_{axis}"]
    ahead = found["gap"]["ahead_1s_mm"]
    assert ahead["after"] < 1.2 * ahead["floor"] < ahead["before"]
    told = capsys.readouterr().out
    assert "Hidden in the demo's simulated table" in told
    assert "recalibrate" not in told  # the servos are as the rig file has them
