"""The command line: exit codes, one line for every mistake, nothing recorded lost."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
import pytest

from experiments.records.importing import read_log
from experiments.records.recording import Recorder, read_run
from rig.hardware.board.link import LinkLost
from rig.hardware.network.remote import RemoteTable
from rig.hardware.network.token_file import make_token, read_token
from rig.hardware.wiring import Wiring
from rig.log import INDEX, blank_row
from tests.support.command import call
from tests.support.waiting import wait_for

QUICK = 'title = "quick"\nduration_s = 1.0\n[start]\nhold_s = 0.0\n'


@pytest.fixture
def quick(tmp_path: Path) -> str:
    path = tmp_path / "quick.toml"
    path.write_text(QUICK)
    return str(path)


def test_run_report_export_import(capsys, tmp_path: Path, quick: str):
    out = tmp_path / "out"
    assert call("run", quick, "--out", str(out), "--seed", "4") == 0
    runs = sorted((out / "runs").iterdir(), key=lambda run: read_run(run).meta["arm"])
    assert [read_run(run).meta["arm"] for run in runs] == ["with", "without"]
    results = json.loads((out / "results.json").read_text())
    assert {run["folder"] for run in results["runs"]} == {run.name for run in runs}
    for suffix in ("csv", "parquet", "mat"):
        target = tmp_path / f"log.{suffix}"
        assert call("export", str(runs[0]), "--out", str(target)) == 0
        back, run = read_log(target), read_run(runs[0]).log
        assert np.array_equal(back["theta_x_rad"], run["theta_x_rad"])
    assert call("reject", str(runs[1]), "ball touched") == 0
    assert call("report", *map(str, runs), "--out", str(tmp_path / "r")) == 0
    page = (tmp_path / "r" / "report.html").read_text()
    assert "rejected: ball touched" in page
    assert "virtual rig" in page
    assert "http" not in page.replace("http-equiv", "")  # self-contained
    assert len(json.loads((tmp_path / "r" / "results.json").read_text())["runs"]) == 1
    capsys.readouterr()


@pytest.mark.parametrize(("measured", "told"), [("false", True), ("true", False)])
def test_a_run_of_servos_alone_that_nobody_reads_says_what_it_lacks(
    capsys, tmp_path: Path, measured: str, told: bool
):
    protocol, rig = tmp_path / "short.toml", tmp_path / "rig.toml"
    squares = '[reference]\nshape = "squares"\namplitude = 0.1\nperiod_s = 0.5\n'
    protocol.write_text(f'title = "s"\nduration_s = 1.0\nservo_only = true\n{squares}')
    rig.write_text(f'[servo]\nkind = "position"\nangle_measured = {measured}\n')
    how = ("--arm", "without", "--rig", str(rig), "--out", str(tmp_path / "out"))
    assert call("run", str(protocol), *how) == 0
    assert ("only what the servos were told is recorded" in capsys.readouterr().out) == told


def test_reproduce_says_of_each_claim_what_matters_and_counts_the_verdicts(
    capsys, monkeypatch, tmp_path: Path
):
    def claim(holds: bool | None, runs: int) -> dict:
        sizes = {"effect": 0.4, "low": 0.3, "high": 0.5, "relevant": 0.1}
        return {"holds": holds, "figure": "10", "claim": "C", "unit": "cm", "runs": runs} | sizes

    claims = [claim(True, 6), claim(True, 6), claim(False, 6), claim(None, 0)]
    monkeypatch.setattr(
        "experiments.paper.reproduce.reproduce", lambda *given, **more: {"claims": claims}
    )
    assert call("reproduce", "--out", str(tmp_path)) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == (
        "holds     Fig. 10  C: +0.400 [+0.300, +0.500] cm (matters from 0.1), n = 6"
    )
    assert lines[3].startswith("undecided Fig. 10  C: no completed pair of runs")
    assert lines[4].startswith("claims of the paper: holds 2, fails 1, undecided 1 (")


def test_the_version_is_told_as_the_package_has_it(capsys):
    assert call("--version") == 0
    assert capsys.readouterr().out == f"rig {version('balancing-table-rig')}\n"


def test_a_copy_that_nobody_installed_says_so(capsys, monkeypatch):
    def missing(name: str) -> str:
        raise PackageNotFoundError(name)

    monkeypatch.setattr("experiments.reports.program.version", missing)
    assert call("--version") == 0
    assert capsys.readouterr().out == "rig, not installed and without a version\n"


def test_effects_lists_the_whole_catalogue(capsys):
    assert call("effects") == 0
    shown = capsys.readouterr().out
    from rig.effects import CATALOGUE

    for effect in CATALOGUE:
        assert effect.name in shown
        for parameter in effect.parameters:
            assert parameter.key in shown
    assert "tolerance: so much of the first key" in " ".join(shown.split())  # what columns mean


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["run", "nothing"], ["unknown protocol", "free-release"]),
        (["run", "hold", "--arm", "left"], ["--arm left"]),
        (["run", "hold", "--camera", "film"], ["--camera film"]),
        (["run", "hold", "--rig", "no.toml"], ["no.toml", "not found"]),
        (["run", "hold", "--seed", "-1"], ["--seed"]),
        (["run", "hold", "--out", "/dev/null"], ["/dev/null", "folder"]),
        (["walk"], ["walk"]),
        (["report", "nowhere"], ["nowhere", "run.json"]),
        (["export", "nowhere", "--out", "a.csv"], ["nowhere"]),
        (["reject", "nowhere", "why"], ["nowhere"]),
        (["recover", "nowhere"], ["nowhere"]),
        (["track", "no-such-film.mp4"], ["no-such-film.mp4"]),
        (["track", "x.mp4", "--calibration", "no.json"], ["no.json"]),
    ],
)
def test_bad_input_is_exit_2_and_one_line(
    monkeypatch, capsys, tmp_path: Path, arguments: list[str], words: list[str]
):
    monkeypatch.chdir(tmp_path)
    assert call(*arguments) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if line.strip()]
    assert len(lines) == 1, lines
    for word in words:
        assert word in lines[0]


@pytest.mark.parametrize("threads", ["abc", "0", "-1", "", "1.5"])
def test_a_bad_number_of_threads_is_exit_2_and_one_line(monkeypatch, capsys, threads: str):
    monkeypatch.setenv("NUMBA_NUM_THREADS", threads)
    assert call("effects") == 2
    said = f"rig: NUMBA_NUM_THREADS = {threads!r}: must be a whole number above 0\n"
    assert capsys.readouterr().err == said


def test_what_a_command_starts_takes_one_thread_of_the_linear_algebra(monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "4")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    assert call("effects") == 0
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1"
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    assert call("effects") == 0
    assert os.environ["OPENBLAS_NUM_THREADS"] == "2", "what the user says counts"


def test_a_bad_rig_file_is_exit_2(capsys, tmp_path: Path):
    rig = tmp_path / "rig.toml"
    rig.write_text("[ball]\nradius_m = 0.2\n")
    assert call("run", "hold", "--rig", str(rig), "--out", str(tmp_path)) == 2
    assert "does not fit on the plate" in capsys.readouterr().err


def _start(arguments: list[str], **settings) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-m", "experiments.cli", *arguments],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        **settings,
    )


def _rows(out: Path) -> int:
    try:
        return len(read_run(next((out / "runs").iterdir())).log)
    except (OSError, ValueError, StopIteration):
        return 0


def _heeds() -> None:
    """A runner in the background ignores Ctrl-C, and its children would, too."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def test_ctrl_c_is_exit_130_and_keeps_what_was_recorded(tmp_path: Path):
    protocol, out = tmp_path / "long.toml", tmp_path / "out"
    protocol.write_text('title = "long"\nduration_s = 3000\n[start]\nhold_s = 0.0\n')
    child = _start(["run", str(protocol), "--arm", "with", "--out", str(out)], preexec_fn=_heeds)
    deadline = time.monotonic() + 240  # a busy machine with an empty cache compiles first
    while _rows(out) < 1000 and time.monotonic() < deadline:
        time.sleep(0.2)
    child.send_signal(signal.SIGINT)
    _, error = child.communicate(timeout=60)
    assert child.returncode == 130
    assert "interrupted" in error.splitlines()[-1]
    assert "Traceback" not in error
    run = read_run(next((out / "runs").iterdir()))
    assert run.meta["outcome"] == "interrupted"
    assert len(run.log) >= 1000


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="signals of POSIX")
def test_sigterm_is_obeyed_while_a_run_compiles_for_the_first_time(tmp_path: Path):
    cache, out = tmp_path / "cache", tmp_path / "out"
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)}
    child = _start(["run", "hold", "--arm", "with", "--out", str(out)], env=environment)
    wait_for("something compiled", lambda: any(cache.rglob("*.nbi")), 240)
    assert child.poll() is None
    child.send_signal(signal.SIGTERM)
    _, error = child.communicate(timeout=120)  # one function's machine code is not interrupted
    assert child.returncode == 128 + signal.SIGTERM
    assert error == "rig: ended by SIGTERM; what was recorded so far is kept\n"
    assert not list(out.glob("runs/*"))  # it did not wait for the others, or a run would have begun


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="file size limits are POSIX")
def test_a_full_disk_is_exit_1_and_keeps_what_was_recorded(tmp_path: Path):
    import resource

    def small_disk() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000))

    out = tmp_path / "out"
    environment = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}
    child = _start(
        ["run", "hold", "--arm", "with", "--out", str(out)], preexec_fn=small_disk, env=environment
    )
    _, error = child.communicate(timeout=120)
    assert child.returncode == 1, error
    assert "Traceback" not in error
    assert "stay readable" in error.splitlines()[-1]
    assert _rows(out) > 500


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="signals of POSIX")
def test_a_signal_in_the_midst_of_an_import_ends_a_program_with_one_line():
    code = (
        "import signal, sys\n"
        "class Signal:\n"
        "    def find_spec(self, name, *_):\n"
        "        if 'rig.files' in sys.modules:\n"
        "            sys.meta_path.remove(self)\n"
        "            signal.raise_signal(signal.SIGTERM)\n"
        "sys.meta_path.insert(0, Signal())\n"
        "sys.argv = ['rig', 'run', 'circle', '--rig', 'none.toml']\n"
        "from experiments.cli import main\n"
        "main()\n"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert out.stderr == "rig: ended by SIGTERM; what was recorded so far is kept\n"
    assert out.returncode == 128 + signal.SIGTERM


def test_a_mistake_of_which_nothing_can_be_said_has_its_exit_code():
    read, write = os.pipe()
    os.close(read)
    words = [sys.executable, "-m", "experiments.cli", "run", "no-such-protocol"]
    assert subprocess.run(words, stderr=write, check=False).returncode == 2
    os.close(write)


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="signals of POSIX")
@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP"])
def test_a_served_table_that_is_ended_says_so_and_tells_its_user(tmp_path: Path, name: str):
    number = getattr(signal, name)
    token, copied = tmp_path / "rig.token", tmp_path / "copied.token"
    make_token(token)
    if name == "SIGHUP":  # the token of a folder that somebody sent
        shutil.copy2(token, copied)
        token = copied
    command = [sys.executable, "-m", "experiments.cli", "serve", "--port", "0"]
    program = subprocess.Popen(
        [*command, "--token-file", str(token)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert program.stdout is not None
    try:
        lines = []
        for line in program.stdout:
            lines.append(line)
            if "serving" in line:
                break
        else:
            raise AssertionError(program.communicate())
        assert any("was not made here" in line for line in lines) == (token == copied)
        port = int(line.rsplit(":", 1)[1])
        table = RemoteTable("127.0.0.1", port, read_token(token), Wiring())
        table.read()
        program.send_signal(number)
        _, said = program.communicate(timeout=60)
    finally:
        program.kill()  # no harm where it has ended
        program.wait()
    assert program.returncode == 128 + number
    assert said == f"rig: ended by {name}; what was recorded so far is kept\n"
    with pytest.raises(LinkLost, match="rig serve was ended there"):
        all(table.read() for _ in range(500))
    table.close()


def test_a_run_that_is_still_being_recorded_is_exported_so_far(tmp_path, capsys):
    """Its rows were called lost."""
    recorder = Recorder(tmp_path / "run", {"source": "simulated", "protocol": "hold"})
    for k in range(5000):
        row = blank_row()
        row[INDEX["t_s"]] = 0.002 * k
        recorder.append(row)
    assert call("export", tmp_path / "run", "--out", tmp_path / "log.csv") == 0
    assert "still being recorded: these are its rows so far" in capsys.readouterr().err
    recorder.finish("done")
