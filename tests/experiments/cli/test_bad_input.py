"""Bad input of any kind: exit code 2 and one line that a person can read."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
import typer

from experiments.cli.console import bars, effects_table
from experiments.records.recording import Recorder
from experiments.records.run_folder import write_results
from experiments.runs.protocol import shipped
from rig.effects import BY_NAME
from rig.parameters import Rig
from rig.rigfile import write_rig
from tests.support.command import told
from tests.support.gap.logs import table_log

NESTED = "x = " + "[" * 5000
DIGITS = "9" * 400


def refused(*words: object) -> str:
    code, _, error = told(*words)
    assert (code, error.count("\n")) == (2, 1), error
    assert len(error) < 1200
    assert error.isprintable() or error[:-1].isprintable()
    return error


@pytest.mark.parametrize("text", [NESTED, f"control_rate_hz = {DIGITS}", f"x = {'9' * 5000}"])
def test_numbers_and_brackets_beyond_all_measure(tmp_path: Path, text: str):
    file = tmp_path / "odd.toml"
    file.write_text(text)
    assert "odd.toml" in refused("run", "circle", "--rig", file)
    assert "odd.toml" in refused("run", file)


@pytest.mark.parametrize("words", [("run", "circle", "--rig"), ("run",), ("export",), ("recover",)])
def test_names_that_no_file_can_have(tmp_path: Path, words):
    name = "x" * 5000 + ".toml"
    more = ("--out", tmp_path / "a.csv") if words[0] == "export" else ()
    assert "too long" in refused(*words, name, *more)


@pytest.mark.parametrize(
    ("change", "say"),
    [
        ({"rows": "many"}, "rows = 'many'"),
        ({"source": None}, "simulated or measured"),
        ({"rig": [1]}, "rig"),
        ({"outcome": 7}, "outcome = 7"),
        ({"created": "once"}, "created"),
    ],
)
def test_a_run_json_with_wrong_values(tmp_path: Path, change, say):
    run = tmp_path / "run"
    with Recorder(run, {"source": "simulated", "arm": "with"}):
        pass
    file = run / "run.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | change))
    for words in (("report", run, "--out", tmp_path / "r"), ("recover", run)):
        assert say in refused(*words)


def test_what_gap_can_know_before_it_works(tmp_path: Path):
    log = tmp_path / "log.csv"
    log.write_text("t_s\n0\n")
    for words, say in (
        ((log, "--json", tmp_path), "is a folder"),
        ((log, "--json", tmp_path / "none" / "x.json"), "no such folder"),
        (("--demo", "--rig", "nope.toml"), "--demo has a table of its own"),
        (("--demo", "--until", "xyz"), "known stages"),
        (("--demo", "--from", "12"), "is for LOG..."),
        (("--blind-trial", "--onto", log, "--from", "12"), "and no trial's"),
    ):
        assert say in refused("gap", *words, "--out", tmp_path / "o")


def test_gap_writes_over_nothing_that_is_the_users_own(tmp_path: Path):
    log, rig_file, run = (tmp_path / name for name in ("log.csv", "rig.toml", "run"))
    log.write_text("t_s\n0\n")
    rig_file.write_text("# measured in March\n")
    run.mkdir()
    given = ("gap", log, run, "--rig", rig_file, "--out", tmp_path / "o", "--json")
    assert "is the recording itself" in refused(*given, log)
    assert "is the rig file itself" in refused(*given, rig_file)
    made = tmp_path / "made" / "rig.toml"  # by a command, so that it might be written over
    made.parent.mkdir()
    write_rig(Rig(), made)
    for more in ((), ("--tolerances-from",)):
        onto_it = ("gap", log, "--rig", made, "--out", made.parent, *more)
        assert "is the rig file itself" in refused(*onto_it)
    assert "lies in the recording" in refused(*given, run / "run.json")
    for more in ((), ("--tolerances-from",)):
        assert "a rig file of yours" in refused("gap", log, "--out", tmp_path, *more)
    assert "a rig file of yours" in refused("sheet", "play", "--student", "a", "--out", tmp_path)
    assert rig_file.read_text() == "# measured in March\n"
    assert log.read_text() == "t_s\n0\n"


@pytest.mark.parametrize("text", ['{"mine": 1}', "[1, 2]", "no JSON", ""])
def test_a_run_writes_over_no_results_that_are_the_users_own(tmp_path: Path, text: str):
    mine = tmp_path / "results.json"
    mine.write_text(text)
    assert "a file of yours lies where" in refused("run", "servo-squares", "--out", tmp_path)
    assert mine.read_text() == text
    assert [path.name for path in tmp_path.iterdir()] == ["results.json"]


def test_no_command_writes_over_results_that_are_the_users_own(tmp_path: Path):
    run, mine = tmp_path / "runs" / "one", tmp_path / "results.json"
    with Recorder(run, {"source": "simulated", "arm": "with"}):
        pass
    mine.write_text('{"mine": 1}')
    for words in (
        ("reproduce", "--no-frames"),
        ("report", run),
        ("watch", run.parent),
        ("gap", run),
        ("gap", "--demo"),
        ("gap", "--blind-trial"),
        ("compare",),
        ("track", tmp_path),
        ("benchmark", "score", tmp_path, tmp_path / "answers"),
    ):
        assert "a file of yours lies where" in refused(*words, "--out", tmp_path)
    with pytest.raises(ValueError, match="a file of yours lies where"):
        write_results(tmp_path, {"source": "simulated"})
    assert mine.read_text() == '{"mine": 1}'
    assert {path.name for path in tmp_path.iterdir()} == {"runs", "results.json"}


def test_a_folder_where_results_go_is_told_before_the_work(tmp_path: Path):
    """`rig reproduce` said so after minutes, of a file with a name that nobody knew."""
    (tmp_path / "results.json").mkdir()
    told = f"{tmp_path / 'results.json'}: a folder lies where the results are"
    assert told in refused("reproduce", "--out", tmp_path)


@pytest.mark.parametrize("text", ['{"source": "measured"}', "[1, 2]", "no JSON"])
def test_rendered_frames_write_over_no_calibration_of_another_camera(tmp_path: Path, text: str):
    mine = tmp_path / "calibration.json"
    mine.write_text(text)
    for words in (("run", "free-release", "--camera", "frames"), ("reproduce",)):
        error = refused(*words, "--out", tmp_path)
        assert f"{mine}: a file of yours lies where the virtual camera's calibration" in error
    assert mine.read_text() == text
    assert [path.name for path in tmp_path.iterdir()] == ["calibration.json"]


def test_a_run_takes_the_place_of_what_a_command_here_has_made(tmp_path: Path):
    for made in ({"source": "simulated"}, {"verdict": "named"}, {"mine": {"confident wrong": 0}}):
        (tmp_path / "results.json").write_text(json.dumps(made))
        code, *_ = told("run", "servo-squares", "--arm", "without", "--out", tmp_path)
        assert code == 0
        assert json.loads((tmp_path / "results.json").read_text())["protocol"] == "servo-squares"


def test_odd_words(tmp_path: Path):
    run = tmp_path / "run"
    with Recorder(run, {"source": "simulated", "arm": "with"}):
        pass
    assert "1000" in refused("run", "circle", "--repetitions", 99999999999)
    assert "1000" in refused("compare", "--seeds", 99999999)
    assert "named twice" in refused("report", run, tmp_path / "." / "run", "--out", tmp_path / "r")
    assert "control characters" in refused("reject", run, "a\x1b[2Jb")
    (tmp_path / "loop").symlink_to("loop")
    assert "loop is no run folder" in refused("report", tmp_path / "loop", "--out", tmp_path / "r")
    assert "not a place" in refused("export", run, "--out", tmp_path / "loop" / "log.csv")
    columns = table_log(seconds=1.0)
    names, rows = list(columns), zip(*columns.values(), strict=True)
    lines = [",".join(names), *(",".join(map(str, row)) for row in rows)]
    lines[3] = "1_0" + lines[3][lines[3].index(",") :]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    out = ("--out", tmp_path / "o")
    assert "1_0" in refused("gap", tmp_path / "log.csv", *out)
    (tmp_path / "wide.csv").write_text(",".join(f"c{k}" for k in range(100_000)) + "\n1\n")
    refused("gap", tmp_path / "wide.csv", *out)


def test_what_a_recording_says_steers_no_terminal(tmp_path: Path):
    with Recorder(tmp_path / "run", {"source": "simulated", "arm": "with"}) as recorder:
        recorder.finish("done\x1b]0;mine\x07")
    code, shown, _ = told("recover", tmp_path / "run")
    assert code == 0
    assert shown.endswith("outcome done?]0;mine?\n")


def test_brackets_in_a_labs_own_words_are_shown(capsys):
    """rich reads [V] as a style and fails over [/V]."""
    known = BY_NAME["dead_zone"]
    width = replace(known.parameters[0], unit="[V]")
    effects_table([replace(known, parameters=(width,), sentence="half [/V] of it")])
    shown = capsys.readouterr().out
    assert "[V]" in shown
    assert "half [/V] of it" in shown
    with bars() as progress:
        progress("run [/hold]", 1, 2)
    assert "run [/hold]" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "say"),
    [
        (("run", "hold", "--seed", "-1"), "'--seed'.*0, not '-1'; see rig run --help"),
        (("run", "hold", "--seed=soon"), "'--seed'.*not 'soon'; see rig run --help"),
        (("run",), "Missing argument 'protocol'; see rig run --help"),
        (("rnu",), "Did you mean 'run'; see rig --help"),
    ],
)
def test_the_command_line_names_the_value_and_where_help_is(words, say):
    assert re.search(say, refused(*words))


@pytest.mark.parametrize("words", [(), ("calibrate",), ("benchmark",)])
def test_a_group_of_commands_alone_is_its_help(words):
    code, out, _ = told(*words)
    assert code == 0
    assert out.startswith("Usage: ")
    assert "\n  --help  " in out


def test_the_help_lists_every_command_in_one_section():
    from experiments.cli.application import app
    from experiments.cli.sections import SECTIONS

    listed = [name for names in SECTIONS.values() for name in names]
    assert sorted(listed) == sorted(typer.main.get_command(app).commands)
    _, out, _ = told("--help")
    assert all(f"\n{title}:\n" in out for title in SECTIONS)
    lines = [line for line in out.splitlines() if line.split() and line.split()[0] in listed]
    assert len({line.index(line.split(maxsplit=1)[1]) for line in lines}) == 1  # one column


def test_the_help_of_gap_sets_trials_apart_from_a_persons_recording():
    _, out, _ = told("gap", "--help")
    own, _, rest = out.partition("\nDemo")
    demo, _, trials = rest.partition("\nBlind trials")
    assert all(one in own for one in ("Your recording:", "logs...", "--rig", "--from", "--until"))
    assert all(one in demo for one in ("--demo", "--guess", "--seed"))
    assert all(one in trials for one in ("--blind-trial", "--trials", "--onto", "--jobs"))
    assert out.count("--") < 25  # no option says again how it is not set


def test_the_help_of_calibrate_says_of_both_kinds_of_servos():
    _, out, _ = told("calibrate", "--help")
    assert "servos told an angle: lag, limits." in out


def test_the_help_of_run_names_every_shipped_protocol():
    _, out, _ = told("run", "--help")
    assert all(name.replace("-", "") in re.sub(r"[-\s]", "", out) for name in shipped())


def test_a_slip_in_a_rig_files_key_is_told_with_what_was_meant(tmp_path: Path):
    file = tmp_path / "rig.toml"
    file.write_text("[servo]\nangle_limit = 3\n")
    assert refused("run", "hold", "--rig", file).endswith("did you mean 'angle_limit_rad'?\n")
    file.write_text("[effects.columb_friction]\nx.torque_V = 0.1\n")
    assert refused("run", "hold", "--rig", file).endswith("did you mean 'coulomb_friction'?\n")


@pytest.mark.parametrize("step", ["table", "time"])
def test_a_step_of_calibration_names_the_step_before_it_and_its_folder(tmp_path: Path, step):
    error = refused("calibrate", step, "--out", tmp_path / "c")
    assert f"rig calibrate camera --out {tmp_path / 'c'} first" in error
