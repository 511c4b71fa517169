"""A lab's own effects in run folders, on the command line and in the report."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from calibration.gap.findings import Findings, Interval, Named
from experiments.gap.beside import beside_rows, found_values, true_values
from experiments.gap.input import read_evidence
from experiments.gap.report import write_findings
from experiments.gap.summary import summary_lines
from experiments.runs.assemble import known
from experiments.runs.protocol import parse
from experiments.runs.runs import run_protocol
from rig.parameters import Rig
from rig.rigfile import read_rig
from tests.support.command import call
from tests.support.gap.own_effects import EXAMPLES

FILE = EXAMPLES / "hanging_arm.py"
RIG = '[effects]\nown = "mine.py"\n[effects.hanging_arm]\nx.weight_V = 0.4\nx.angle_rad = 0.2\n'
SHORT = {
    "title": "Short",
    "duration_s": 1.5,
    "reference": {"shape": "constant"},
    "repetitions": 1,
    "arms": ["without"],
}


@pytest.fixture(name="rig_file")
def fixture_rig_file(tmp_path: Path) -> Path:
    (tmp_path / "mine.py").write_text(FILE.read_text(encoding="utf-8"))
    (tmp_path / "rig.toml").write_text(RIG)
    return tmp_path / "rig.toml"


def recorded(rig: Rig, out: Path) -> Path:
    """The folder of a short run on the simulated table of a rig."""
    protocol = parse(SHORT, label="short", name="short")
    done = run_protocol(rig, protocol, arms=["without"], out=out, seed=1, repetitions=1)
    return done[0].folder


def test_a_run_folder_keeps_the_text_and_runs_no_code(rig_file: Path, tmp_path: Path):
    folder = recorded(read_rig(rig_file), tmp_path / "out")
    truth = json.loads((folder / "truth.json").read_text())["rig"]
    meta = json.loads((folder / "run.json").read_text())
    assert truth["own_effects"][0]["text"] == meta["rig"]["own_effects"][0]["text"]
    assert truth["own_effects"][0]["text"] == FILE.read_text(encoding="utf-8")
    assert meta["rig"]["effects"] == {}
    assert str(tmp_path) not in json.dumps(meta["rig"])
    assert true_values([folder]) is not None
    meta["rig"]["own_effects"][0]["text"] = f"open({str(tmp_path / 'trace')!r}, 'w')"
    (folder / "run.json").write_text(json.dumps(meta))
    given = read_evidence([folder])
    [note] = [note for note in given.notes if "effects" in note]
    assert "hanging_arm (mine.py); they are left out, since a recording runs no code" in note
    assert given.rig.own == ()
    assert not (tmp_path / "trace").exists()
    given = read_evidence([folder], rig_file)
    assert not [note for note in given.notes if "effects" in note]
    assert "hanging_arm" in given.rig.catalogue


def findings(rig: Rig) -> Findings:
    """As if the effect had been named."""
    sizes = {"weight_V": Interval(0.4, 0.39, 0.41), "angle_rad": Interval(0.2, 0.1, 0.3)}
    effect = Named("hanging_arm", 0.99, (), {"x": sizes})
    return Findings("named", "It hangs.", effects=(effect,), rig_before=known(rig), rig_after=rig)


def test_the_report_tells_its_units_and_its_rig_file_is_read_again(rig_file: Path, tmp_path: Path):
    rig = read_rig(rig_file)
    found = findings(rig)
    (tmp_path / "gap").mkdir()
    page = write_findings(found, tmp_path / "gap", names=["a"], rig_file=rig_file).read_text()
    assert "A weight hangs on the servo" in page
    assert "0.400 [0.390, 0.410] V" in page
    assert "-2 to 2 V" in page
    assert 'own = ["mine.py"]' in page.replace("&#34;", '"').replace("&quot;", '"')
    assert read_rig(tmp_path / "gap" / "rig.toml") == rig
    assert any("angle 11" in line and "deg" in line for line in summary_lines(found))
    rows = beside_rows(found_values(found), {}, None, found.known)
    assert rows[1][2].endswith("deg")
    nothing = replace(found, verdict="nothing-missing", effects=(), rig_after=None)
    write_findings(nothing, tmp_path / "gap", names=["a"], rig_file=rig_file)
    assert not (tmp_path / "gap" / "rig.toml").exists(), "of an earlier analysis"
    assert read_rig(tmp_path / "gap" / "rig.toml.1") == rig, "and kept: it may hold tolerances"


def test_rig_effects_lists_those_of_a_rig_file(rig_file: Path, capsys):
    assert call("effects", str(rig_file)) == 0
    shown = capsys.readouterr().out
    assert "hanging_arm" in shown
    assert "weight_V" in shown
    assert "cogging" in shown
    assert "command_dead_band" not in shown  # of servos that take an angle


def test_a_bad_effect_file_is_exit_2_and_one_line(rig_file: Path, capsys):
    (rig_file.parent / "mine.py").write_text("EFFECT = 1\n")
    assert call("effects", str(rig_file)) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert "mine.py: it has no EFFECT" in lines[0]
