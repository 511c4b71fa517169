"""`rig watch` on folders of run folders: what is told, what is skipped, what is refused."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from calibration.gap.model.parameters import Parameter
from calibration.gap.report.units import sig
from experiments.runs.runs import reject
from experiments.watch.report import _skipped_words, history
from experiments.watch.runs import RunFolder, accepted_of, other_protocol, runs_of
from experiments.watch.watch import ACCEPTED, SKIPPED, JudgedRun, Watch, _not_compared
from experiments.watch.words import run_words
from rig import Rig, write_rig
from tests.support.command import told
from tests.support.dated_runs import step_logs, write_runs

PLAY_RAD, GREW_RAD = 0.015, 0.009


def table(play_x_rad: float) -> Rig:
    plays = {"x": {"play_rad": play_x_rad}, "y": {"play_rad": PLAY_RAD}}
    return Rig(effects={"joint_backlash": plays, "gear_backlash": {"x": {"play_rad": 0.01}}})


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Seven runs of a table whose joint comes loose in the fifth, and what lies beside them."""
    folder = tmp_path_factory.mktemp("runs")
    logs = step_logs([table(PLAY_RAD)] * 4 + [table(PLAY_RAD + GREW_RAD)] * 3, seed=1)
    made = write_runs(folder, logs, replace(table(PLAY_RAD), effects={}))
    others = write_runs(folder, logs[1:5], replace(table(PLAY_RAD), effects={}), first_day=20)
    for path, change in zip(
        others,
        (
            {"outcome": "ball lost"},
            {"protocol": {"name": "hold"}},
            {"rejected": "somebody sneezed"},
            {},
        ),
        strict=True,
    ):
        file = path / "run.json"
        file.write_text(json.dumps(json.loads(file.read_text()) | change))
    mcap = others[3] / "samples.mcap"
    mcap.write_bytes(mcap.read_bytes()[:3000])
    (folder / "20260501T000000Z-steps-without").mkdir()
    (folder / "20260501T000000Z-steps-without" / "run.json").write_text("{")
    write_rig(table(PLAY_RAD), folder / "rig.toml")
    assert len(made) == 7
    return folder


@pytest.mark.slow
def test_a_loose_joint_is_told_with_run_name_and_size(runs, tmp_path: Path):
    words = ("watch", runs, "--rig", runs / "rig.toml", "--out", tmp_path)
    code, out, err = told(*words)
    assert code == 0, err
    found = json.loads((tmp_path / "results.json").read_text())
    assert found["verdict"] == "changed"
    first = found["changes"][0]
    assert (first["effect"], first["axis"], first["key"]) == ("joint_backlash", "x", "play_rad")
    assert first["since"].startswith("20260305")
    assert first["size"]["low"] < GREW_RAD < first["size"]["high"]
    states = [one["state"] for one in found["runs"]]
    assert states[:4] == ["accepted"] + ["unchanged"] * 3
    assert states[5:7] == ["changed"] * 2
    whys = [one["why"] for one in found["runs"][7:]]
    for why, say in zip(
        whys, ("ball lost", "hold", "sneezed", "end before", "damaged"), strict=True
    ):
        assert say in why
    page = (tmp_path / "report.html").read_text()
    assert "joint play x grew by" in page
    assert page.count("<tr") >= 12
    assert "joint play x" in out
    assert f"taken as accepted: {found['accepted'][0]}, the first run that counts (another: " in out
    assert f", a change from {found['threshold']:.2f}" in out
    begin = found["runs"][0]["values"]  # of the accepted run: what the figure shows, too
    shown = re.findall(r"<td>(?:V|ms)</td><td class=\"n\">([^<]*)</td>", page)
    inside = [p["unit"] in ("V", "s") for p in found["parameters"]]
    factors = [{"s": 1e3}.get(p["unit"], 1.0) for p in found["parameters"]]
    assert shown == [sig(f * v) for f, v, i in zip(factors, begin, inside, strict=True) if i]


@pytest.mark.slow
def test_a_repaired_table_is_judged_from_the_run_that_is_accepted(runs, tmp_path: Path):
    begin = next(runs.glob("20260305*")).name
    words = ("watch", runs, "--rig", runs / "rig.toml", "--accept", begin, "--out", tmp_path)
    code, out, err = told(*words)
    assert code == 0, err
    found = json.loads((tmp_path / "results.json").read_text())
    assert found["verdict"] == "nothing-changed"
    assert found["accepted"] == [begin]
    assert "before the accepted" in found["runs"][0]["why"]
    assert "nothing changed in 2 runs" in out
    assert "taken as accepted" not in out  # it was said which


def test_runs_are_in_order_and_the_first_whole_one_is_accepted(runs: Path):
    found = runs_of(runs)
    assert [one.name for one in found] == sorted(one.name for one in found)
    assert accepted_of(found, [], runs)[0].name.startswith("20260301")


def test_the_order_is_that_of_the_times_not_of_their_words(runs: Path, tmp_path: Path):
    """23:30 in New York is after 2 o'clock of the next day in London; what has no time is last."""
    dates = {
        "a": "2026-03-01T23:30:00-05:00",
        "b": "2026-03-02T02:00:00Z",
        "c": "yesterday",
        "d": "2026-03-02T04:29:59.5+00:00",
    }
    first = min(path for path in runs.iterdir() if path.is_dir())
    for name, created in dates.items():
        folder = shutil.copytree(first, tmp_path / name)
        meta = json.loads((folder / "run.json").read_text()) | {"created": created}
        (folder / "run.json").write_text(json.dumps(meta))
    assert [one.name for one in runs_of(tmp_path)] == ["b", "d", "a", "c"]


def test_a_run_counts_once_however_often_it_was_copied(runs: Path, tmp_path: Path):
    first, second, *_ = sorted(path for path in runs.iterdir() if path.is_dir())
    for name, source in (("a", first), ("b", first), ("d", second)):
        shutil.copytree(source, tmp_path / name)
    (tmp_path / "c").symlink_to(tmp_path / "a")
    found = runs_of(tmp_path)
    assert [one.why for one in found] == ["", *["is the same run as a"] * 2, ""]
    reject(tmp_path / "d", "somebody sneezed")
    shutil.copytree(second, tmp_path / "e")
    assert runs_of(tmp_path)[-1].why == "is the same run as d"  # no way around a rejection


def test_a_run_without_its_samples_is_skipped_and_the_next_is_taken(runs: Path, tmp_path: Path):
    first, second, *_ = sorted(path for path in runs.iterdir() if path.is_dir())
    for name, source in (("a", first), ("b", second)):
        shutil.copytree(source, tmp_path / name)
    (tmp_path / "a" / "samples.mcap").unlink()
    found = runs_of(tmp_path)
    assert [one.why for one in found] == ["is damaged: it has no samples.mcap", ""]
    assert [one.name for one in accepted_of(found, (), tmp_path)] == ["b"]


def test_an_edited_protocol_of_the_same_name_is_another(tmp_path: Path):
    """Smaller and shorter steps moved the estimate of a time constant by a quarter."""
    protocol = {"name": "steps", "duration_s": 30.0, "reference": {"shape": "steps", "a": 0.045}}
    one, same, edited = (
        RunFolder(tmp_path, {"arm": "without", "protocol": {**protocol, **change}})
        for change in ({}, {"seed": 5, "title": "again"}, {"duration_s": 14.0})
    )
    assert one.kind == edited.kind
    assert other_protocol(same, one) == ""
    assert other_protocol(edited, one) == "protocol.duration_s (14, 30)"
    said = _not_compared(edited, one, Rig(), before=False)
    assert said.startswith("is of another protocol of that name")
    assert _not_compared(same, one, Rig(), before=False) == ""


def test_the_page_names_what_was_skipped_and_why():
    judged = [
        JudgedRun(RunFolder(Path(f"run-{i}"), {}), state, why)
        for i, (state, why) in enumerate([(ACCEPTED, ""), *[(SKIPPED, "ball lost")] * 8])
    ]
    (said,) = _skipped_words(Mock(runs=judged))
    assert said.startswith("Skipped: run-1 (ball lost), run-2")
    assert said.endswith("run-6 (ball lost), and 2 more (table).")
    assert _skipped_words(Mock(runs=judged[:1])) == []


def test_the_history_shows_what_the_rig_file_says():
    play = Parameter("joint_backlash", "play_rad", "x", 0.01, 0.005, 0.0, 0.1, 0.001)
    values = np.array([[0.02], [0.021]])
    found = SimpleNamespace(
        parameters=(play,), runs=(SimpleNamespace(state=ACCEPTED),), changes=(),
        values=values, stds=0.001 * np.ones((2, 1)),
    )  # fmt: skip
    figure = history(found)  # pyright: ignore[reportArgumentType]
    axis = figure.axes[0]
    assert axis.get_title() == "joint play x [deg], rig file 0.573"
    heights = np.concatenate([np.asarray(line.get_ydata(), float) for line in axis.lines])
    assert np.isclose(heights, np.degrees(0.01)).any()
    assert axis.get_ylim()[0] > 0.6  # the runs set the scale


def test_lost_rows_are_told_and_odd_names_break_no_line(runs: Path, tmp_path: Path):
    first = min(path for path in runs.iterdir() if path.is_dir())
    odd = shutil.copytree(first, tmp_path / "runs" / "one\n\x1b[31mred")
    meta = json.loads((odd / "run.json").read_text()) | {"loop": {"lost_rows": 500}}
    (odd / "run.json").write_text(json.dumps(meta))
    (run,) = runs_of(tmp_path / "runs")
    assert run.name == "one ?[31mred"
    assert accepted_of([run], [odd.name], tmp_path) == accepted_of([run], [run.name], tmp_path)
    found = Mock(spec=Watch)
    for state, why in ((ACCEPTED, ""), (SKIPPED, "failed (a\nb)")):
        said = run_words(found, JudgedRun(run, state, why))
        assert said.startswith(("500 rows are missing", "failed (a b); 500 rows are missing"))


@pytest.mark.parametrize(
    ("words", "say"),
    [
        (("nowhere",), "no such folder"),
        ((".",), "no run folder"),
        (("runs", "--accept", "that"), "no such run"),
        (("runs", "--accept", "20260321*"), "ball lost"),
        (("runs", "--accept", "20260301*", "--accept", "20260322*"), "several protocols"),
        (("runs/20260301*",), "folder that holds it"),
        (("runs", "--rig", "none.toml"), "none.toml"),
    ],
)
def test_bad_input_is_one_line(runs, monkeypatch, tmp_path: Path, words, say):
    monkeypatch.chdir(tmp_path)
    given = []
    for word in words:
        if word.startswith("runs/"):
            word = next(runs.glob(word[5:]))
        elif word == "runs":
            word = runs
        elif "*" in word:
            word = next(runs.glob(word)).name
        given.append(word)
    code, _, err = told("watch", *given)
    assert (code, err.count("\n")) == (2, 1), err
    assert say in err
