"""The lab sheets: tables of one's own, what a results file may hold, right and wrong answers."""

import json
import re
import shlex
import tracemalloc
from contextlib import suppress
from math import degrees
from pathlib import Path

import numpy as np
import pytest

from experiments.sheets.catalogue import SHEETS, LabSheet
from experiments.sheets.check import OPEN, RIGHT, WRONG, check
from experiments.sheets.handout import BLANK, EXERCISE, blank_results, exercise, next_commands
from experiments.sheets.swing import swing
from experiments.sheets.tables import seed_of
from rig.log import Log
from rig.rigfile import to_record
from tests.support import ROOT
from tests.support.command import told

STUDENT = "Ada L."


def filled(sheet: LabSheet, answers: dict[str, float | str], student: str = STUDENT) -> str:
    text = blank_results(sheet, student)
    for key, value in answers.items():
        shown = f'"{value}"' if isinstance(value, str) else repr(float(value))
        text = re.sub(rf'^{key} = "\?"', f"{key} = {shown}", text, flags=re.M)
    return text


def test_every_student_has_a_table_of_their_own():
    for sheet in SHEETS.values():
        truths = [sheet.table_of(f"student {i}").truth for i in range(20)]
        assert len({json.dumps(one) for one in truths}) == 20
        assert set(truths[0]) | {"amplitude_x_cm", "period_x_s"} >= {
            one.key for one in sheet.questions
        }
    assert seed_of("play", " ada  l. ") == seed_of("play", STUDENT) != seed_of("servo", STUDENT)


def test_the_rig_file_that_is_handed_out_holds_nothing_of_what_is_hidden():
    for sheet in SHEETS.values():
        table = sheet.table_of(STUDENT)
        assert to_record(table.known) != to_record(table.plant)
        assert not table.known.effects


@pytest.mark.parametrize("name", ["servo", "camera", "missing"])
def test_right_answers_are_accepted_and_wrong_ones_refused(name: str, tmp_path: Path):
    sheet, file = SHEETS[name], tmp_path / "results.toml"
    for student in (STUDENT, "7", "Zoë"):
        truth = sheet.table_of(student).truth
        file.write_text(filled(sheet, truth, student), encoding="utf-8")
        assert [one.state for one in check(sheet, file)] == [RIGHT] * len(sheet.questions)
        for question in sheet.questions:
            true = truth[question.key]
            if question.choices:
                wrong = next(word for word in question.choices if word != true)
            else:
                wrong = float(true) + 1.05 * (question.within + question.share * abs(float(true)))
            file.write_text(filled(sheet, truth | {question.key: wrong}, student), "utf-8")
            states = {one.question.key: one.state for one in check(sheet, file)}
            assert states.pop(question.key) == WRONG
            assert set(states.values()) <= {RIGHT}


def test_what_is_not_answered_is_neither_right_nor_wrong(tmp_path: Path):
    file = tmp_path / "results.toml"
    file.write_text(blank_results(SHEETS["servo"], 'Quo"te\\'), encoding="utf-8")
    assert [one.state for one in check(SHEETS["servo"], file)] == [OPEN] * 3


@pytest.mark.parametrize(
    ("text", "say"),
    [
        ("sheet = ", "results.toml"),
        ('sheet = "servo"\nstudent = "a"\n', "answers"),
        ('sheet = "servo"\nstudent = "a"\nmark = 1\n[answers]\n', "unknown key 'mark'"),
        ('sheet = "play"\nstudent = "a"\n[answers]\n', "is of sheet 'play'"),
        ('sheet = "servo"\nstudent = ""\n[answers]\n', "printable"),
        ('sheet = "servo"\nstudent = "a"\n[answers]\nk = 1\n', "unknown answer 'k'"),
        ('sheet = "servo"\nstudent = "a"\n[answers]\ngain_rad_s_V = "much"\n', "no number"),
        ('sheet = "servo"\nstudent = "a"\n[answers]\ngain_rad_s_V = nan\n', "finite"),
    ],
)
def test_a_bad_results_file_is_one_line(tmp_path: Path, text: str, say: str):
    file = tmp_path / "results.toml"
    file.write_text(text)
    code, _, err = told("check", "servo", file)
    assert (code, err.count("\n")) == (2, 1), err
    assert say in err


@pytest.mark.parametrize(
    ("words", "say"),
    [
        (("sheet", "cooking", "--student", "a"), "known: play"),
        (("sheet", "play", "--student", " "), "printable"),
        (("check", "servo", "none.toml"), "no such results file"),
        (("check", "nothing", "none.toml"), "known: play"),
    ],
)
def test_bad_words_are_one_line(monkeypatch, tmp_path: Path, words, say: str):
    monkeypatch.chdir(tmp_path)
    code, _, err = told(*words)
    assert (code, err.count("\n")) == (2, 1), err
    assert say in err


def commands(name: str, folder: Path) -> list[list[str]]:
    """The commands of a sheet's page, in `folder`; patterns are expanded when they are run."""
    text = (ROOT / "experiments/sheets" / f"{name}.md").read_text(encoding="utf-8")
    lines = [
        line for block in re.findall(r"```sh\n(.*?)```", text, re.S) for line in block.split("\n")
    ]
    made = [line.replace("out/", f"{folder}/").replace("YOUR NAME", STUDENT) for line in lines]
    return [shlex.split(line)[3:] for line in made if line.startswith("uv run rig")]


def answers_of(name: str, folder: Path) -> dict[str, float | str]:
    """What a student reads from the pages that the sheet's commands made."""
    found = json.loads((folder / "gap" / "results.json").read_text())
    sizes = {one["name"]: one["parameters"] for one in found["effects"]}

    def size(effect: str, axis: str, key: str) -> float:
        return float(sizes.get(effect, {}).get(axis, {}).get(key, {}).get("value", 0.0))

    if name == "play":
        from experiments.records.recording import read_run

        amplitude_m, period_s = swing(
            read_run(next((folder / "runs").glob("*hold-without"))).log, 0
        )
        x, y = (degrees(size("joint_backlash", a, "play_rad")) for a in "xy")
        known = {"amplitude_x_cm": 100 * amplitude_m, "period_x_s": period_s}
        return known | {"play_x_deg": x, "play_y_deg": y, "wider": "x" if x > y else "y"}
    if name == "servo":
        k, tau = (
            found["calibrated"][key]["value"] for key in ("gain_x_rad_s_V", "time_constant_x_s")
        )
        friction = size("coulomb_friction", "x", "friction_V")
        return {"gain_rad_s_V": k, "time_constant_ms": 1000 * tau, "friction_x_V": friction}
    if name == "camera":
        scale = 100 * size("camera_scale", "xy", "fraction")
        yaw = degrees(size("camera_yaw", "xy", "angle_rad"))
        delay = 1000 * size("camera_delay", "xy", "extra_s")
        (absent,) = (n for n, v in (("scale", scale), ("yaw", yaw), ("delay", delay)) if v == 0.0)
        return {"absent": absent, "scale_percent": scale, "yaw_deg": yaw, "delay_ms": delay}
    effect = max(
        sizes,
        key=lambda name: next(e for e in found["effects"] if e["name"] == name)["probability"],
    )
    axis, keys = next((a, keys) for a, keys in sizes[effect].items() if keys)
    return {"effect": effect, "axis": axis, "size": next(iter(keys.values()))["value"]}


@pytest.mark.parametrize("name", list(SHEETS))
def test_what_to_do_is_handed_out_for_the_students_own_folder(tmp_path: Path, name: str):
    sheet, folder = SHEETS[name], tmp_path / "mine"
    text = exercise(sheet, folder)
    assert all(question.key in text for question in sheet.questions)
    assert "out/sheet-" not in text
    assert f"{folder}/runs/" in text
    *_, last = next_commands(sheet, folder)
    assert last == f"uv run rig check {name} {folder}/results.toml"


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", list(SHEETS))
def test_a_sheet_from_its_pages_own_commands(tmp_path: Path, name: str):
    *work, last = commands(name, tmp_path)
    folder, results = tmp_path / f"sheet-{name}", Path(last[-1])
    assert [words[0] for words in work][:1] == ["sheet"]
    assert last[:2] == ["check", name]
    for words in work:
        given = []
        for word in words:
            place = Path(word)
            given += sorted(place.parent.glob(place.name)) if "*" in word else [word]
        code, _, err = told(*given)
        assert code == 0, f"{words}: {err}"
    assert not list(folder.rglob("truth.json"))
    assert BLANK in results.read_text()
    assert (folder / EXERCISE).read_text().startswith(f"# {SHEETS[name].title}")
    code, out, _ = told(*last)
    assert code == 1
    assert "0 of" in out
    answers = answers_of(name, folder)
    results.write_text(filled(SHEETS[name], answers))
    code, out, _ = told(*last)
    assert (code, out.count(RIGHT)) == (0, len(SHEETS[name].questions) + 1), out
    wrong = {k: 1.5 * v + 1.0 for k, v in answers.items() if not isinstance(v, str)}
    results.write_text(filled(SHEETS[name], answers | wrong))
    code, out, _ = told(*last)
    assert code == 1
    assert out.count(WRONG) == len(wrong)
    truth = SHEETS[name].table_of(STUDENT).truth
    numbers = [value for value in truth.values() if isinstance(value, float) and value]
    assert not [value for value in numbers if f"{value:.3g}" in out]


@pytest.mark.parametrize("step_s", [1e-5, 1e-6, 1e-9])
def test_a_run_of_200_rows_close_together_takes_no_memory(step_s: float):
    """The rate of its rows made a periodogram of gigabytes."""
    t = np.concatenate([np.arange(100) * step_s, 60.0 + np.arange(100) * step_s])
    ball = 0.01 * np.sin(t)
    log = Log.from_columns({"t_s": t, "ball_x_m": ball, "ball_y_m": ball})
    tracemalloc.start()
    try:
        with suppress(ValueError):  # a line of its own is as good
            swing(log, 0)
        assert tracemalloc.get_traced_memory()[1] < 1e8
    finally:
        tracemalloc.stop()
