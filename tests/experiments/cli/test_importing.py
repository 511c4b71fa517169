"""`rig import`: from a stranger's file to a log, or one line."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from experiments.cli import application
from experiments.importing.import_map import read_map
from experiments.records.importing import read_log
from tests.support.command import told
from tests.support.other_labs.labs import LABS
from tests.support.parts import RECORDINGS, needs


@dataclass(frozen=True)
class Done:
    returncode: int
    stdout: str
    stderr: str


@pytest.fixture
def rig(monkeypatch) -> Callable[..., Done]:
    """The command line in this process, with nobody there to ask."""

    def call(*arguments: str | Path) -> Done:
        monkeypatch.setattr("experiments.cli.importing.somebody_is_there", lambda: False)
        return Done(*told(*arguments))

    return call


@pytest.fixture
def fails(rig) -> Callable[..., str]:
    """The one line on standard error of a command that must end with exit code 2."""

    def call(*arguments: str | Path) -> str:
        done = rig(*arguments)
        assert done.returncode == 2, done.stderr
        assert done.stderr.count("\n") == 1
        assert done.stderr.startswith("rig: ")
        return done.stderr

    return call


def test_yes_writes_the_log_and_the_map_and_the_map_is_used_again(rig, tmp_path: Path):
    path, truth = LABS["german_hobby"](tmp_path, seed=1)
    first, again = tmp_path / "out/a.csv", tmp_path / "out/b.mat"
    done = rig("import", path, "--out", first, "--yes")
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == 8  # five of the proposal, the log, the map, what next
    assert truth.faults(read_log(first)) == []
    made = read_map(tmp_path / "out/import.toml")
    assert made.sources == ("messung.csv",)
    done = rig("import", path, "--out", again, "--map", tmp_path / "out/import.toml")
    assert done.returncode == 0, done.stderr
    one, two = read_log(first), read_log(again)
    np.testing.assert_array_equal(one.rows, two.rows)


def test_what_is_open_is_refused_with_the_option_that_states_it(rig, fails, tmp_path: Path):
    path, truth = LABS["pixels"](tmp_path, seed=1)
    out = tmp_path / "out/a.csv"
    line = fails("import", path, "--out", out, "--yes")
    assert "--set ball.scale=NUMBER" in line
    assert not out.exists()
    said = [f"ball.scale={1 / 1500}", "ball_x_m.offset=320", "ball_y_m.offset=240"]
    options = [part for one in said for part in ("--set", one)]
    done = rig("import", path, "--out", out, "--yes", *options)
    assert done.returncode == 0, done.stderr
    assert truth.faults(read_log(out)) == []


def test_a_name_that_is_no_text_loses_no_map(rig, tmp_path: Path):
    path, _ = LABS["german_hobby"](tmp_path, seed=1)
    odd = tmp_path / os.fsdecode(b"n-\xff.csv")
    try:
        path.rename(odd)
    except OSError:
        pytest.skip("this file system takes no such name")
    out = tmp_path / "out" / os.fsdecode(b"o-\xff.csv")
    done = rig("import", odd, "--out", out, "--yes")
    assert done.returncode == 0, done.stderr
    assert read_map(tmp_path / "out/import.toml").sources == ("n-?.csv",)


def test_sessions_and_several_files_are_numbered(rig, tmp_path: Path):
    path, _ = LABS["appended"](tmp_path, seed=1)
    done = rig("import", path, path, "--out", tmp_path / "out/a.csv", "--yes")
    assert done.returncode == 0, done.stderr
    names = sorted(one.name for one in (tmp_path / "out").glob("*.csv"))
    assert names == [f"a-{i}.csv" for i in range(1, 7)]


def test_lines_that_were_left_out_are_told_of_every_file(rig, tmp_path: Path):
    first, _ = LABS["german_hobby"](tmp_path, seed=1)
    cut = tmp_path / "cut.csv"
    cut.write_bytes(first.read_bytes().rstrip().rpartition(b";")[0])
    words = "cells, left out: 1 of"
    done = rig("import", first, cut, "--out", tmp_path / "out/a.csv", "--yes")
    assert words not in done.stdout
    assert done.stderr.startswith(f"note: {cut}: lines without ")
    assert words in done.stderr
    assert words in rig("import", cut, "--out", tmp_path / "out/b.csv", "--yes").stdout
    made = tmp_path / "out/import.toml"
    assert words in rig("import", cut, "--out", tmp_path / "out/c.csv", "--map", made).stderr


def test_a_recording_is_never_written_over(fails, tmp_path: Path):
    path, _ = LABS["german_hobby"](tmp_path, seed=1)
    before = path.read_bytes()
    assert "is the recording itself" in fails("import", path, "--out", path, "--yes")
    assert path.read_bytes() == before
    numbered = path.rename(tmp_path / "a-2.csv")
    out = tmp_path / "a.csv"
    assert "a-2.csv: is the" in fails("import", numbered, numbered, "--out", out, "--yes")
    assert numbered.read_bytes() == before
    assert [one.name for one in tmp_path.iterdir()] == ["a-2.csv"]


def test_questions_are_asked_where_somebody_is_there(tmp_path: Path, monkeypatch):
    path, truth = LABS["pixels"](tmp_path, seed=1)
    monkeypatch.setattr("experiments.cli.importing.somebody_is_there", lambda: True)
    answers = ["many", str(1 / 1500), "320", "240", "y"]
    arguments = ["import", str(path), "--out", str(tmp_path / "a.csv")]
    done = CliRunner().invoke(application.app, arguments, input="\n".join(answers) + "\n")
    assert done.exit_code == 0, done.output
    assert truth.faults(read_log(tmp_path / "a.csv")) == []
    done = CliRunner().invoke(
        application.app, arguments, input="\n".join([*answers[:4], "n"]) + "\n"
    )
    assert done.exit_code != 0


@pytest.mark.parametrize("rows", [1, 2, 19])
def test_too_few_rows_are_named_as_what_is_wrong(fails, tmp_path: Path, rows: int):
    path = tmp_path / "few.csv"
    lines = [f"{0.1 * i:.1f},{i % 3},{i % 5}" for i in range(rows)]
    path.write_text("\n".join(["t,ball_x_mm,ball_y_mm", *lines, ""]))
    line = fails("import", path, "--out", tmp_path / "out.csv", "--yes")
    assert f"{path}: it has {rows} row" in line
    assert "limit: at least 20" in line


def test_a_name_that_stands_twice_has_a_cure(fails, tmp_path: Path):
    path = tmp_path / "twice.csv"
    path.write_text("t,x,x\n" + "".join(f"0.{i},{i},{i}\n" for i in range(30)))
    line = fails("import", path, "--out", tmp_path / "out.csv", "--yes")
    assert line == f"rig: {path}: a column's name stands twice: x; rename one of them\n"


def write(path: Path, header: str, columns: list[np.ndarray]) -> Path:
    rows = (",".join(map(str, row)) for row in np.column_stack(columns))
    path.write_text(header + "\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return path


def test_bad_input_is_one_line(fails, tmp_path: Path):
    out = tmp_path / "out/a.csv"
    rng, t = np.random.default_rng(0), np.arange(400) * 0.02
    noise = rng.standard_normal((3, 400))
    timeless = write(tmp_path / "b.csv", "ball_x_mm,ball_y_mm,servo_cmd_x_deg", [*(40 * noise)])
    assert "--set time.rate_hz" in fails("import", timeless, "--out", out, "--yes")
    ballless = write(tmp_path / "c.csv", "t_s,servo_cmd_x_deg", [t, noise[0]])
    assert "ball" in fails("import", ballless, "--out", out, "--yes")
    empty = tmp_path / "d.csv"
    empty.write_text("")
    assert "empty" in fails("import", empty, "--out", out, "--yes")
    assert "does not exist" in fails("import", tmp_path / "e.csv", "--out", out)
    assert ".csv" in fails("import", timeless, "--out", tmp_path / "a.xlsx", "--yes")
    assert "--set" in fails("import", timeless, "--out", out, "--set", "wheel.unit=m")
    assert "no column" in fails(
        "import", timeless, "--out", out, "--yes", "--set", "time.column=nothing"
    )
    assert not out.exists()


@needs("recordings")
@pytest.mark.parametrize("name", ["position_table/run.csv", "positioning_axis/run_a.csv"])
def test_real_recordings_are_imported_unasked(rig, name: str, tmp_path: Path):
    done = rig("import", RECORDINGS / name, "--out", tmp_path / "a.csv", "--yes")
    assert done.returncode == 0, done.stderr
    log = read_log(tmp_path / "a.csv")
    there = np.genfromtxt(RECORDINGS / name, delimiter=",", names=True)
    for column in there.dtype.names or ():
        given = there[column] - (there[column][0] if column == "t_s" else 0)
        np.testing.assert_allclose(log[column], given, atol=1e-9)


def test_what_nobody_named_is_kept(rig, tmp_path: Path):
    """A map of another program or with somebody's comments; a log numbered as a session's."""
    (path, _), out = LABS["german_hobby"](tmp_path, seed=1), tmp_path / "out"
    out.mkdir()
    (out / "import.toml").write_text("mine = true")
    done = rig("import", path, "--out", out / "log.csv", "--yes")
    assert done.returncode == 0
    assert "import.toml was there: it is kept as import.toml.1" in done.stdout
    assert (out / "import.toml.1").read_text() == "mine = true"
    made = (out / "import.toml").read_text()
    own = made + "# why: the encoder of y was changed\n"
    (out / "import.toml").write_text(own)
    rig("import", path, "--out", out / "again.csv", "--map", out / "import.toml")
    assert (out / "import.toml").read_text() == own
    rig("import", path, "--out", out / "third.csv", "--yes")
    assert (out / "import.toml").read_text() == made
    assert (out / "import.toml.2").read_text() == own
    rig("import", path, "--out", out / "third.csv", "--yes")
    assert sorted(one.name for one in out.iterdir()) == [
        "again.csv",
        "import.toml",
        "import.toml.1",
        "import.toml.2",
        "log.csv",
        "third.csv",
    ]


def test_a_log_of_a_session_takes_no_other_files_place(rig, tmp_path: Path):
    (path, _), out = LABS["german_hobby"](tmp_path, seed=1), tmp_path / "out"
    out.mkdir()
    (out / "log-2.csv").write_text("mine")
    for _ in range(2):
        done = rig("import", path, path, "--out", out / "log.csv", "--yes")
        assert done.returncode == 0
    assert (out / "log-2.csv.1").read_text() == "mine"
    assert len([*out.glob("log-2.csv*")]) == 2
