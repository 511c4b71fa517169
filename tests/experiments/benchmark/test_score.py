"""Scores in closed form, and what is refused with one line."""

import hashlib
import json
import os
import shutil
from dataclasses import replace
from math import inf, sqrt
from pathlib import Path

import pytest
from typer.testing import CliRunner

from experiments.benchmark.answers import answer_set, read_answer
from experiments.benchmark.score import score_set, scores_of, summary, truth_of
from experiments.benchmark.table import lines_of, numbers_of, side_by_side
from experiments.blind.seal import seal
from experiments.blind.trial import BlindTrial, to_plain
from experiments.cli.application import app
from rig.files import LONGEST

PLANT = {"servo": {"kind": "voltage"}}
PLAY = {"joint_backlash": {"x": {"play_rad": 0.04}}}


def trial(number: int, kind: str, hidden: dict | None = None, **more) -> BlindTrial:
    name = f"case-{number:04d}"
    return BlindTrial(name, kind, "", ("steps",), (number,), PLANT, {}, hidden or {}, **more)


def effect(name: str, probability: float | None, value: float, low: float, high: float) -> dict:
    size = {"value": value, "low": low, "high": high}
    key = {"joint_backlash": "play_rad", "voltage_offset": "offset_V"}[name]
    return {"name": name, "probability": probability, "parameters": {"x": {key: size}}}


TRIALS = [
    trial(1, "single", PLAY, factor=8.0),  # right, sure
    trial(2, "single", PLAY, factor=2.0, engine="foreign"),  # wrong and sure
    trial(3, "nothing"),  # right
    trial(4, "stranger", engine="mujoco"),  # not answered
    trial(5, "single", PLAY, factor=8.0, engine="foreign"),  # right, not sure, misses the interval
]
ANSWERS = {
    "case-0001": {"verdict": "named", "effects": [effect("joint_backlash", 0.9, 0.05, 0.03, 0.06)]},
    "case-0002": {"verdict": "named", "effects": [effect("voltage_offset", 0.99, 0.1, 0.0, 0.2)]},
    "case-0003": {"verdict": "nothing-missing", "effects": []},
    "case-0005": {
        "verdict": "named",
        "effects": [effect("joint_backlash", None, 0.03, 0.02, 0.035)],
    },
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A set of these trials without logs, and the answers to it."""
    out = tmp_path / "set"
    seal(TRIALS, out)
    for one in TRIALS:
        (out / "cases" / one.name).mkdir(parents=True)
    (tmp_path / "answers").mkdir()
    for name, answer in ANSWERS.items():
        (tmp_path / "answers" / f"{name}.json").write_text(json.dumps(answer))
    return tmp_path


def test_counts_intervals_calibration_and_sizes_in_closed_form(folder: Path):
    found = score_set(folder / "set", folder / "answers")
    right = found["all"]["right"]
    assert (right["k"], right["n"]) == (3, 5)
    z, n, p = 1.959964, 5, 0.6  # Wilson 1927
    middle, half = p + z * z / (2 * n), z * sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    assert right["low"] == pytest.approx((middle - half) / (1 + z * z / n), abs=1e-5)
    assert right["high"] == pytest.approx((middle + half) / (1 + z * z / n), abs=1e-5)
    said = {word: found["all"][word]["k"] for word in ("named", "nothing", "unknown", "no answer")}
    assert said == {"named": 3, "nothing": 1, "unknown": 0, "no answer": 1}
    assert found["all"]["wrong and sure"]["k"] == 1
    # Stated: 0.9 and right, 0.99 and wrong; no probability is no statement.
    assert found["calibration"]["n"] == 2
    assert found["brier"] == pytest.approx((0.1**2 + 0.99**2) / 2)
    assert found["calibration"]["error"] == pytest.approx(abs((0.9 + 0.99) / 2 - 0.5))
    assert found["sizes"]["median"] == pytest.approx(0.25)  # 0.05 and 0.03 for 0.04
    assert (found["covered"]["k"], found["covered"]["n"]) == (1, 2)


def test_groups_by_kind_and_engine(folder: Path):
    found = score_set(folder / "set", folder / "answers")
    rights = {name: (g["right"]["k"], g["right"]["n"]) for name, g in found["kinds"].items()}
    assert rights == {
        "one effect, real size": (2, 2),
        "one effect, small": (0, 1),
        "an effect without a name": (0, 1),
        "healthy": (1, 1),
    }
    engines = {name: group["right"]["n"] for name, group in found["engines"].items()}
    assert engines == {"own simulator": 2, "independent plant": 2, "MuJoCo": 1}
    lines = lines_of(found)
    assert lines[0][:2] == ("all", "5")
    assert len(lines) == 1 + 4 + 3
    assert "25 % in the median" in numbers_of(found)[1]
    assert "| 60.0 % (23.1 to 88.2; 3/5) |" in side_by_side({"mine": found})


def test_the_first_cases_alone(folder: Path):
    found = score_set(folder / "set", folder / "answers", first=2)
    assert (found["all"]["right"]["k"], found["all"]["right"]["n"]) == (1, 2)


def test_an_unknown_effect_has_to_be_called_unknown():
    unknown, named = {"verdict": "unknown-effect"}, ANSWERS["case-0001"]
    for answer, right in ((unknown, 1), (named, 0)):
        found = summary(scores_of(TRIALS[3:4], {"case-0004": answer}, {}))
        assert found["all"]["right"]["k"] == right
    assert summary(scores_of(TRIALS[3:4], {}, {}))["all"]["no answer"]["k"] == 1


def test_a_truth_that_was_changed_is_refused(folder: Path):
    assert truth_of(folder / "set") == TRIALS
    path = folder / "set/sealed/truth.json"
    path.write_text(path.read_text().replace("0.04", "0.05"))
    with pytest.raises(ValueError, match="the seal is broken"):
        score_set(folder / "set", folder / "answers")
    path.unlink()
    with pytest.raises(FileNotFoundError, match="sealed truth is not there"):
        score_set(folder / "set", folder / "answers")


def test_answers_to_another_set_are_refused(folder: Path):
    seal([replace(TRIALS[0], seeds=(77,))], folder / "other")
    (folder / "answers/seal.json").write_bytes((folder / "other/seal.json").read_bytes())
    with pytest.raises(ValueError, match="answers to another set"):
        score_set(folder / "set", folder / "answers")
    (folder / "answers/seal.json").unlink()
    (folder / "answers/case-0099.json").write_text("{}")
    with pytest.raises(ValueError, match="no case of that name"):
        score_set(folder / "set", folder / "answers")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "not a JSON file"),
        ("[]", "valid dictionary"),
        ("{}", "'verdict' is missing"),
        ('{"verdict": "perhaps"}', "verdict = 'perhaps'"),
        ('{"verdict": "named", "effects": [{"probability": 1}]}', "effects.0.name' is missing"),
        ('{"verdict": "named", "effects": [{"name": "a", "probability": 7}]}', "probability = 7"),
        ('{"verdict": "named", "effects": [{"name": "a", "probability": NaN}]}', "probability"),
        (
            '{"verdict": "named", "effects": [{"name": "a", "parameters": {"z": {}}}]}',
            "parameters.z",
        ),
        (
            '{"verdict": "named", "effects": [{"name": "a", "parameters": {"x": {"k": {}}}}]}',
            "value' is missing",
        ),
        ('{"verdict": "named", "effects": [{"name": "a", "probability": true}]}', "probability"),
        ('{"verdict": "named", "x": ' + "9" * 5000 + "}", "a number has too many digits"),
        ('{"verdict": "named", "x": ' + "[" * 10_000 + "]" * 10_000 + "}", "too deep"),
        ('{"verdict": "named"}' + " " * LONGEST, "longer than"),
    ],
)
def test_a_malformed_answer_is_one_line(folder: Path, text: str, words: str):
    path = folder / "answers/case-0004.json"
    path.write_text(text)
    with pytest.raises(ValueError, match="case-0004") as caught:
        score_set(folder / "set", folder / "answers")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes with a name")
@pytest.mark.parametrize("place", ["case-0004.json", "work/case-0004.json"])
def test_a_pipe_among_the_answers_is_refused_and_not_waited_for(folder: Path, place: str):
    path = folder / "answers" / place
    path.parent.mkdir(exist_ok=True)
    path.unlink(missing_ok=True)
    os.mkfifo(path)
    with pytest.raises(ValueError, match=f"{place}: no file, but a folder, a pipe or a device"):
        score_set(folder / "set", folder / "answers")


@pytest.mark.parametrize("text", ["x", "[]", "{}", '{"sha256": 5}', "[" * 100_000])
def test_a_damaged_seal_is_one_line(folder: Path, text: str):
    (folder / "answers/seal.json").write_text(text)
    with pytest.raises(ValueError, match=r"answers/seal.json: (not a JSON file|no seal)"):
        score_set(folder / "set", folder / "answers")


@pytest.mark.parametrize("text", ["[1]", "{}", '{"answer": {}, "seconds": "long"}', "["])
def test_answers_without_their_seconds_are_one_line(folder: Path, text: str):
    (folder / "answers/work").mkdir(exist_ok=True)
    (folder / "answers" / "work" / "case-0001.json").write_text(text)
    with pytest.raises(ValueError, match=r"work/case-0001.json: (no answer with|not a JSON file)"):
        score_set(folder / "set", folder / "answers")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"hidden": {"gremlins": {"x": {"size": 1.0}}}}, "'gremlins' hidden in"),
        ({"hidden": {"joint_backlash": {"x": {"play_rad": 0.0}}}}, "no effect of a size"),
        ({"hidden": [1]}, "hidden"),
        ({"noise": None}, "noise"),
        ({"kind": 5}, "kind"),
        (None, "no trial in it"),
    ],
)
def test_a_truth_that_is_none_is_one_line(folder: Path, changes: dict | None, words: str):
    text = json.dumps([] if changes is None else [to_plain(TRIALS[0]) | changes])
    (folder / "set/sealed/truth.json").write_text(text)
    seal_of_it = {"sha256": hashlib.sha256(text.encode()).hexdigest()}
    (folder / "set/seal.json").write_text(json.dumps(seal_of_it))
    with pytest.raises(ValueError, match=words) as caught:
        truth_of(folder / "set")
    assert "\n" not in str(caught.value)


def test_code_in_a_set_is_not_executed(tmp_path: Path):
    case, ran = tmp_path / "set/cases/case-0001", tmp_path / "ran"
    case.mkdir(parents=True)
    (case / "rig.toml").write_text('[effects]\nown = "evil.py"\n')
    (case / "evil.py").write_text(f"open({str(ran)!r}, 'w')\n")
    (tmp_path / "set/seal.json").write_text('{"sha256": "00"}')
    with pytest.raises(ValueError, match=r"names effects of its own \(evil.py\)"):
        answer_set(tmp_path / "set", tmp_path / "answers", jobs=1)
    assert not ran.exists()


def test_what_rig_gap_says_beside_is_not_in_the_way(folder: Path):
    path = folder / "answers/case-0001.json"
    whole = ANSWERS["case-0001"] | {
        "sentence": "play",
        "gap": [1],
        "next_experiment": "x",
        "unknown": None,
    }
    whole["effects"][0]["parameters"]["x"]["offset_rad"] = {"value": 0.0, "low": None, "high": None}
    path.write_text(json.dumps(whole))
    assert read_answer(path) == whole
    assert score_set(folder / "set", folder / "answers")["all"]["right"]["k"] == 3


def test_the_command_prints_a_table_and_writes_it(folder: Path):
    command = ["benchmark", "score", str(folder / "set"), str(folder / "answers")]
    found = CliRunner().invoke(app, [*command, "--out", str(folder / "out")])
    assert found.exit_code == 0, found.output
    assert "60.0 % (23.1 to 88.2; 3/5)" in found.output
    assert "| healthy | 1 |" in (folder / "out/table.md").read_text()
    found = json.loads((folder / "out/results.json").read_text())
    assert found["answers"]["all"]["right"]["k"] == 3


def test_several_entries_stand_side_by_side(folder: Path):
    (folder / "silent").mkdir()
    words = [str(folder / name) for name in ("set", "answers", "silent")]
    found = CliRunner().invoke(app, ["benchmark", "score", *words, "--out", str(folder / "out")])
    assert found.exit_code == 0, found.output
    page = (folder / "out/table.md").read_text()
    assert "|  | answers | silent |" in page
    assert "| no answer | 20.0 % (3.6 to 62.4; 1/5) | 100.0 % (56.6 to 100.0; 5/5) |" in page


def test_entries_are_told_apart_by_names_that_steer_no_terminal(folder: Path):
    for name in ("one/out", "two/out", "[b]|c\x1b[31m"):
        (folder / name).mkdir(parents=True)
    words = [str(folder / name) for name in ("set", "one/out", "two/out", "[b]|c\x1b[31m")]
    found = CliRunner().invoke(app, ["benchmark", "score", *words, "--out", str(folder / "res")])
    assert found.exit_code == 0, found.output
    one, two = (str((folder / name).resolve()) for name in ("one/out", "two/out"))
    assert list(json.loads((folder / "res/results.json").read_text())) == [one, two, "[b]?c?[31m"]
    page = (folder / "res/table.md").read_text()
    assert f"|  | {one} | {two} | [b]?c?[31m |" in page
    assert "\x1b" not in found.output + page


def told_by_folder(place: Path) -> dict:
    """A fake analysis: the answer depends on what lies in the folder alone."""
    names = sorted(path.name for path in place.iterdir())
    never = {"name": "input_delay", "score": -inf}  # as `rig gap` has it in its ranking
    told = {"sentence": " ".join(names), "effects": [], "ranking": [never]}
    return {"verdict": "nothing-missing", **told}


def test_answers_go_on_where_they_stopped(folder: Path):
    for one in TRIALS:
        (folder / "set/cases" / one.name / f"log-{one.name}").write_text("x")
    out = folder / "mine"
    assert answer_set(folder / "set", out, answer=told_by_folder, first=2, jobs=1) == 0
    first = (out / "work/case-0001.json").read_bytes()

    def fails(place: Path) -> dict:
        raise RuntimeError("no idea")

    assert answer_set(folder / "set", out, answer=fails, jobs=1) == 3
    assert (out / "work/case-0001.json").read_bytes() == first
    second = json.loads((out / "case-0002.json").read_text())
    assert second["sentence"] == "log-case-0002"
    assert second["ranking"][0]["score"] is None
    assert json.loads((out / "case-0004.json").read_text())["verdict"] == "failed"
    found = score_set(folder / "set", out)
    assert (found["all"]["nothing"]["k"], found["all"]["no answer"]["k"]) == (2, 3)
    assert found["seconds"]["n"] == 5


def test_answers_that_were_begun_for_one_set_are_none_to_another(folder: Path):
    for one in TRIALS:
        (folder / "set/cases" / one.name / "log").write_text("x")
    out, other = folder / "mine", folder / "other"
    shutil.copytree(folder / "set", other)
    (other / "seal.json").write_text('{"sha256": "00"}')

    def stops(place: Path) -> dict:
        if len(list((out / "work").glob("*.json"))) == 1:
            raise KeyboardInterrupt
        return told_by_folder(place)

    with pytest.raises(KeyboardInterrupt):
        answer_set(folder / "set", out, answer=stops, jobs=1)
    with pytest.raises(ValueError, match="answers to another set"):
        answer_set(other, out, answer=told_by_folder, jobs=1)
    (out / "seal.json").unlink()  # of an earlier version
    with pytest.raises(ValueError, match=r"does not say to which set .* choose another --out"):
        answer_set(folder / "set", out, answer=told_by_folder, jobs=1)
