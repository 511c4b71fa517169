"""From an unknown board to a balanced ball by the commands of the README: the real firmware behind
a real serial device, and protocol.c behind the real USB library."""

import json
from pathlib import Path

import numpy as np
import pytest

from rig.hardware.homing.homing_moves import MOST_V
from rig.hardware.wiring import Wiring
from tests.support.boards.chip import Chip
from tests.support.boards.commands import SQUARES, Lab
from tests.support.boards.host import HostBoard

ODD = Wiring(
    order=(1, 0), sign_volts=(-1, 1), sign_angle=(1, -1), zero_counts=(20, -12), crossed=True
)
BALL = """title = "short"
duration_s = {seconds}
[start]
x_m = -0.1
y_m = 0.1
hold_s = 0.5
"""
MAKES = {"serial": Chip, "usb": HostBoard}
CABLES = ["serial", pytest.param("usb", marks=pytest.mark.slow)]


@pytest.fixture
def make_lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys):
    labs: list[Lab] = []

    def make(cable: str, board) -> Lab:
        for _ in range(20):  # it boots where its arms happen to lie: there its counts are zero
            board.run_ms((0, 0))
        labs.append(Lab(board, cable, tmp_path, monkeypatch, capsys, wiring=ODD))
        return labs[-1]

    yield make
    for lab in labs:
        lab.close()


def homed(lab: Lab) -> str:
    code, said, error = lab.call("home")
    assert code == 0, error
    return said


def check_rest(lab: Lab) -> None:
    lab.world.run(0.7)
    assert lab.world.volts == (0.0, 0.0)
    # Friction and offset leave 0.03 rad, homing 8 counts; at 0 V the arm sinks in its play.
    assert np.abs(lab.world.arms_rad).max() < 0.06


@pytest.mark.slow
@pytest.mark.parametrize("cable", CABLES)
def test_home_then_squares_then_a_ball_then_a_reset(cable: str, make_lab):
    lab = make_lab(cable, MAKES[cable]())
    (lab.folder / "mine.toml").write_text(BALL.format(seconds=6.0))
    code, _, error = lab.call("run", str(lab.folder / "mine.toml"))
    assert (code, error.count("\n")) == (2, 1)
    assert "has not been homed" in error

    said = homed(lab)
    assert lab.most_V <= MOST_V
    assert "swapped, motors crossed" in said
    assert "the markers see the plate level" in said
    kept = json.loads(lab.rig_file.with_suffix(".home.json").read_text())["wiring"]
    assert (kept["order"], kept["crossed"]) == ([1, 0], True)
    assert (kept["sign_volts"], kept["sign_angle"]) == ([-1, 1], [1, -1])
    assert np.abs(np.subtract(kept["zero_counts"], ODD.zero_counts)).max() <= 8

    code, said, found = lab.run(SQUARES)
    assert (code, found.meta["outcome"]) == (0, "completed"), said
    theta = found.log["theta_x_rad"]
    assert np.abs(theta[-100:]).max() == pytest.approx(0.1, abs=0.03)
    check_rest(lab)

    lab.lay_the_ball()
    code, said, found = lab.run(BALL.format(seconds=6.0))
    assert (code, found.meta["outcome"]) == (0, "completed"), said
    assert "let it go" in said
    assert found.meta["table"] in MAKES
    assert found.meta["link"] == {"ticks_missed": 0, "bad_frames": 0}
    x, y, t_s = (found.log[name] for name in ("ball_x_m", "ball_y_m", "t_s"))
    last = np.isfinite(x) & (t_s > t_s[-1] - 1.0)
    assert np.hypot(x[last], y[last]).max() < 0.03
    check_rest(lab)

    lab.world.board.reset()
    for _ in range(2):  # asking does not make it homed
        code, said, found = lab.run(SQUARES)
        assert (code, found.meta["outcome"]) == (1, "not homed")
        assert "or reset since its homing" in said
        assert lab.world.volts == (0.0, 0.0)


@pytest.mark.parametrize("how", ["unplugged", "silent"])
def test_a_lost_cable_is_the_runs_outcome_and_a_refused_homing_leaves_none(how: str, make_lab):
    lab = make_lab("serial" if how == "unplugged" else "usb", HostBoard())
    lab.markers = False
    with lab.rig_file.open("a") as file:
        file.write("swap = true\nsign_angle = [1, -1]\n")
    said = homed(lab)
    assert "no markers were seen" in said
    assert "signs of volts [-1, 1], of angles [1, -1]" in said

    def strike(run_s: float) -> None:
        if run_s > 2.5 and how == "unplugged":
            lab.pty.unplug()
            lab.then = lambda run_s: None
        elif run_s > 2.5:
            lab.usb.hung = True

    lab.lay_the_ball(strike)
    code, _, found = lab.run(BALL.format(seconds=6.0))
    assert (code, found.meta["outcome"]) == (1, "link lost")
    assert "board on" in found.meta["reason"]
    assert 1.0 < found.log["t_s"][-1] < 2.7
    check_rest(lab)

    if how == "unplugged":
        return
    lab.usb.hung, lab.world.powered = False, False  # the emergency stop is pressed
    code, _, error = lab.call("home")
    assert (code, error.count("\n")) == (2, 1)
    assert "homing: stuck" in error
    assert not lab.rig_file.with_suffix(".home.json").exists()


def test_a_homing_of_a_board_ends_those_of_its_other_rig_files(make_lab):
    """Also one that is refused: after a reset the counts of the first mean nothing."""
    lab = make_lab("usb", HostBoard())
    lab.markers = False
    with lab.rig_file.open("a") as file:
        file.write("swap = true\nsign_angle = [1, -1]\n")
    homed(lab)
    lab.world.board.reset()
    first, lab.rig_file = lab.rig_file, lab.rig_file.with_name("other.toml")
    lab.rig_file.write_text(first.read_text())
    lab.world.powered = False
    code, _, error = lab.call("home")
    assert (code, "homing: stuck" in error) == (2, True)
    lab.world.powered, lab.rig_file = True, first
    code, said, found = lab.run(SQUARES)
    assert (code, found.meta["outcome"]) == (1, "not homed")
    assert "or homed with another rig file: run rig home" in said
    homed(lab)
    code, _, found = lab.run(SQUARES)
    assert (code, found.meta["outcome"]) == (0, "completed")
