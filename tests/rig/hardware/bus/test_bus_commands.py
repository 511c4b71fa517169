"""From servos in a box to a balanced ball by the commands of the README, on a serial device."""

import json
from pathlib import Path

import numpy as np
import pytest

from experiments.calibrate.motion import calibrate_servo
from rig.hardware.wiring import Wiring
from tests.support.boards.bus_lab import BusLab
from tests.support.boards.bus_servos import DEAD_TIME_S, LAG_S
from tests.support.boards.bus_world import VENDORS
from tests.support.boards.commands import SQUARES

pytestmark = pytest.mark.realtime
ODD = Wiring(order=(1, 0), sign_angle=(-1, 1), zero_counts=(2048 + 60, 2048 - 45))
BALL = """title = "short"
duration_s = 4.0
[start]
x_m = -0.05
y_m = 0.05
hold_s = 0.5
"""
MARK = [
    kind if kind == "feetech" else pytest.param(kind, marks=pytest.mark.slow) for kind in VENDORS
]


@pytest.fixture
def make_lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys):
    labs: list[BusLab] = []

    def make(kind: str, **settings) -> BusLab:
        labs.append(BusLab(kind, tmp_path, monkeypatch, capsys, **settings))
        return labs[-1]

    yield make
    for lab in labs:
        lab.close()


@pytest.mark.parametrize("kind", MARK)
def test_home_then_squares_then_a_ball(kind: str, make_lab):
    lab = make_lab(kind, wiring=ODD, counts=(2300, 1900))
    (lab.folder / "mine.toml").write_text(SQUARES)
    code, _, error = lab.call("run", str(lab.folder / "mine.toml"))
    assert (code, error.count("\n")) == (2, 1)
    assert "has not been homed" in error

    code, said, error = lab.call("home")
    assert code == 0, error
    assert "channels: swapped" in said
    assert "the markers see the plate level" in said
    kept = json.loads(lab.rig_file.with_suffix(".home.json").read_text())
    wiring = kept["wiring"]
    assert (wiring["order"], wiring["sign_angle"]) == ([1, 0], [-1, 1])
    # The plate has 1 degree of play at the arm (11 counts), of which homing sees either end.
    assert np.abs(np.subtract(wiring["zero_counts"], ODD.zero_counts)).max() <= 8
    assert kept["where"] == f"{lab.pty.port} [1, 2]"

    code, said, found = lab.run(SQUARES)
    assert (code, found.meta["outcome"]) == (0, "completed"), said
    told, seen = found.log["command_x_rad"], found.log["theta_x_rad"]
    assert np.abs(told[-100:]).max() == pytest.approx(0.1, abs=1e-6)
    assert np.abs(seen[-100:]).max() == pytest.approx(0.1, abs=0.005)
    assert found.meta["table"] == kind
    notes = found.meta["link"]
    assert notes["bad_packets"] == 0
    # A shared machine may hold the program, or the simulated servos, for a tick now and then.
    assert notes["asked_again"] + notes["ticks_missed"] <= 0.01 * len(told)
    assert notes["lowest_voltage_V"] == pytest.approx(12.1)

    lab.lay_the_ball()
    code, said, found = lab.run(BALL)
    assert (code, found.meta["outcome"]) == (0, "completed"), said
    x, y, t_s = (found.log[name] for name in ("ball_x_m", "ball_y_m", "t_s"))
    last = np.isfinite(x) & (t_s > t_s[-1] - 1.0)
    assert np.hypot(x[last], y[last]).max() < 0.04
    lab.run_on(1.0)
    assert np.abs(lab.world.shafts_rad).max() < 0.02


ARMS_ODD = Wiring((1, 2, 0), (1, 1, 1), (-1, 1, -1), (2048 + 40, 2048 + 30, 2048 - 20))


def three_arms(make_lab, kind: str) -> BusLab:
    lab = make_lab(
        kind, wiring=ARMS_ODD, counts=(2100, 2000, 2060), shipped="three-arms.toml", rate_hz=200.0
    )
    text = lab.rig_file.read_text()
    told = text.replace('kind = "position"', 'kind = "position"\nangle_measured = true')
    lab.rig_file.write_text(told.replace("period_s = 0.02 ", "period_s = 0.0 "))
    return lab


@pytest.mark.parametrize("kind", MARK)
def test_three_arms_are_homed_and_balance_a_ball(kind: str, make_lab):
    lab = three_arms(make_lab, kind)
    code, said, error = lab.call("home")
    assert code == 0, error
    assert "channels: arm at 120 degrees, arm at 240 degrees, arm at 0 degrees" in said
    wiring = json.loads(lab.rig_file.with_suffix(".home.json").read_text())["wiring"]
    assert (wiring["order"], wiring["sign_angle"]) == ([1, 2, 0], [-1, 1, -1])
    # By sign the arms lie -40, 30 and 20 counts off: 10 together, which is height, not tilt. Each
    # keeps a third of it; the plate's play is 7 counts at an arm, columns are secants.
    zeros = np.array([2048 + 40 + 3, 2048 + 30 - 3, 2048 - 20 + 3])
    assert wiring["zero_counts"] == pytest.approx(zeros, abs=9)

    lab.start_m = (-0.03, 0.03)
    lab.lay_the_ball()
    code, said, found = lab.run(BALL.replace("0.05", "0.03"))
    assert (code, found.meta["outcome"]) == (0, "completed"), said
    x, y, t_s = (found.log[name] for name in ("ball_x_m", "ball_y_m", "t_s"))
    last = np.isfinite(x) & (t_s > t_s[-1] - 1.0)
    assert np.hypot(x[last], y[last]).max() < 0.02
    lab.run_on(1.0)
    assert np.abs(lab.world.shafts_rad).max() < 0.01


def test_a_servo_that_gives_up_in_a_run_ends_it_by_name(make_lab):
    lab = make_lab("feetech", markers=False)
    assert lab.call("home")[0] == 0

    def overload(run_s: float) -> None:
        if run_s > 1.0:
            lab.world.board.servos[2].alarm = 32

    lab.lay_the_ball(overload)
    code, said, found = lab.run(SQUARES)
    assert (code, found.meta["outcome"]) == (1, "servo alarm")
    assert "servo 2 (y) reports: overload" in said


def test_a_bus_that_is_not_there_or_has_other_servos_is_one_line(make_lab):
    lab = make_lab("feetech", keys="ids = [1, 5]")
    code, _, error = lab.call("home")
    assert (code, error.count("\n")) == (1, 1)
    assert "servo 5 (y) is lost: silent" in error
    text = lab.rig_file.read_text()
    lab.rig_file.write_text(text.replace(lab.pty.port, "/dev/ttyUSB77"))
    code, _, error = lab.call("home")
    assert (code, error.count("\n")) == (2, 1)
    assert "plug the adapter in" in error
    lab.rig_file.write_text(text.replace("ids = [1, 5]", "ids = [1, 1]"))
    code, _, error = lab.call("home")
    assert (code, error.count("\n")) == (2, 1)
    assert "2 different numbers" in error


@pytest.mark.slow
@pytest.mark.parametrize("arms", [False, True])
def test_the_servos_are_measured_from_a_run(arms: bool, make_lab):
    """`rig calibrate servo` on a recording of theirs, by the angle that they read back."""
    lab = three_arms(make_lab, "feetech") if arms else make_lab("feetech", markers=False)
    assert lab.call("home")[0] == 0
    code, said, found = lab.run(SQUARES.replace("2.0", "12.0"))
    assert code == 0, said
    calibrate_servo([found.folder], lab.rig_file, lab.folder / "cal", seed=1)
    record = json.loads((lab.folder / "cal/calibration.json").read_text())["position_servo"]
    assert record["source"] == "angle"
    for axis in "xy":
        lag, late = record[axis]["lag_s"], record[axis]["dead_time_s"]
        assert lag["low"] < LAG_S < lag["high"]
        assert late["low"] < DEAD_TIME_S + 1e-3 < late["high"]  # the answer comes 1 ms after asking
        assert lag["high"] - lag["low"] < 0.01
