"""`rig home` and `rig run` on a table that another process serves: all but the last cable.

The slow ones part by part: tests/rig/loop/test_process.py (a program that dies),
tests/rig/hardware/network/test_remote.py (silence on the cable), homing/test_homed.py (power-ups),
tests/experiments/records/test_kill_nine.py (either signal).
"""

import json
import os
import signal
import subprocess
import time
from dataclasses import replace

import numpy as np
import pytest

from experiments.records.recording import read_run
from rig.hardware.homing.homed import load
from tests.support.command import told
from tests.support.rig_lab import Lab

pytestmark = pytest.mark.realtime


def refused(*arguments) -> str:
    """What a command says that ends with 2 before it opens the table."""
    code, _, error = told(*arguments)
    assert code == 2
    return error


@pytest.fixture(scope="module")
def homed(lab: Lab) -> Lab:
    arguments = ("run", lab.protocol(5.0), "--out", str(lab.out), "--arm", "with", "--yes")
    assert "has not been homed" in refused(*arguments, "--rig", lab.rig)
    assert "--yes" in refused("home", "--rig", lab.rig)
    out = lab.home()
    assert "no markers were seen" in out
    kept = json.loads(lab.rig.with_suffix(".home.json").read_text())
    assert np.abs(kept["wiring"]["zero_counts"]).max() <= 8
    assert lab.volts()[-1, 1:].tolist() == [0.0, 0.0]
    assert np.abs(lab.volts()[:, 1:]).max() <= 1.5
    return lab


def running(homed: Lab, seconds: float, arm: str) -> tuple[subprocess.Popen, list]:
    """A run that has been balancing for a while, and its folder."""
    before = homed.folders()
    child = homed.start(
        "run", homed.protocol(seconds), "--out", str(homed.out), "--arm", arm, "--yes"
    )
    deadline = time.monotonic() + 240
    while time.monotonic() < deadline and child.poll() is None:
        mine = [folder for folder in homed.folders() if folder not in before]
        if mine and len(read_run(mine[0]).log) > 1500:
            return child, mine[0]
        time.sleep(0.3)
    child.kill()
    raise AssertionError(child.communicate())


def test_a_protocol_runs_on_the_served_table_and_is_recorded_as_measured(homed: Lab):
    code, out, error = homed.call(
        "run", homed.protocol(6.0), "--out", str(homed.out), "--arm", "with", "--yes"
    )
    assert code == 0, error
    assert "place the ball at x = -10.0 cm, y = 10.0 cm" in out
    assert "let it go" in out
    run = homed.runs()[-1]
    meta = run.meta
    assert (meta["source"], meta["outcome"], meta["table"]) == ("measured", "completed", "remote")
    assert not (run.folder / "truth.json").exists()
    assert meta["loop"]["jitter"]["ticks"] >= len(run.log) > 3000
    assert meta["link"]["clock"]["exchanges"] > 1000
    assert abs(meta["link"]["clock"]["offset_s"]) < 2e-3  # one machine, one clock
    x, y = run.log["ball_x_m"], run.log["ball_y_m"]
    last = np.isfinite(x) & (run.log["t_s"] > run.log["t_s"][-1] - 1.0)
    assert np.hypot(x[last], y[last]).max() < 0.03  # it was balanced
    assert homed.volts()[-1, 1:].tolist() == [0.0, 0.0]
    results = json.loads((homed.out / "results.json").read_text())
    assert results["source"] == "measured"


@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)]
)
def test_a_signal_ends_at_zero_volts_with_its_reason(homed: Lab, number: signal.Signals):
    child, folder = running(homed, 60.0 + number, "without")
    child.send_signal(number)
    _, error = child.communicate(timeout=30)
    assert child.returncode == 128 + number, error
    assert "Traceback" not in error
    meta = read_run(folder).meta
    assert meta["outcome"] == "interrupted"
    assert signal.Signals(number).name in meta["reason"] or "operator" in meta["reason"]
    assert "link" in meta
    time.sleep(0.1)
    assert homed.volts()[-1, 1:].tolist() == [0.0, 0.0]


@pytest.mark.slow
def test_a_program_that_is_killed_leaves_the_table_at_zero_volts(homed: Lab):
    child, folder = running(homed, 61.0, "with")
    child.send_signal(signal.SIGKILL)
    killed_s = time.monotonic()
    child.communicate(timeout=30)
    time.sleep(max(0.0, killed_s + 1.5 - time.monotonic()))
    rows = homed.volts()
    assert rows[-1, 1:].tolist() == [0.0, 0.0]
    assert rows[-1, 0] < killed_s + 0.1 + 0.6 + 0.3  # silent, level for 0.6 s, a busy machine
    assert read_run(folder).meta["outcome"] is None  # as a kill leaves it: rig recover


@pytest.mark.slow
def test_a_served_table_that_hangs_is_named_and_another_power_up_wants_homing(homed: Lab):
    child, folder = running(homed, 63.0, "with")
    os.kill(homed.process.pid, signal.SIGSTOP)
    try:
        out, error = child.communicate(timeout=30)
    finally:
        os.kill(homed.process.pid, signal.SIGCONT)
    assert child.returncode == 1, (out, error)
    meta = read_run(folder).meta
    assert "silent for 90 ms" in meta["reason"]
    assert "remote table 127.0.0.1" in meta["reason"]
    time.sleep(1.0)
    assert homed.volts()[-1, 1:].tolist() == [0.0, 0.0]
    kept = homed.rig.with_suffix(".home.json")
    before = kept.read_text()
    replace(load(kept), boot_id="id 00").save(kept)
    try:
        code, out, error = homed.call(
            "run", homed.protocol(5.0), "--out", str(homed.out / "b"), "--arm", "with", "--yes"
        )
    finally:
        kept.write_text(before)
    assert code == 1
    assert "switched off or reset since its homing" in out + error
