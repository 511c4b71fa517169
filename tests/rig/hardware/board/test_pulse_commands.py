"""From hobby servos in a box to a balanced ball by the commands of the README."""

import json
from pathlib import Path

import numpy as np
import pytest

from rig.hardware.board.pulse_servo import PulseServo
from tests.support.boards.pulse_lab import PulseLab
from tests.support.parts import needs

pytestmark = needs("cc")

# The horns sit 0.07 and -0.05 rad off, the servo of y stands on its head, the plugs are swapped.
SLOPE = PulseServo().us_per_rad
X = PulseServo(1500.0 + 0.07 * SLOPE, SLOPE)
Y = PulseServo(1500.0 - 0.05 * SLOPE, -SLOPE)
BALL = """title = "short"
duration_s = 6.0
[start]
x_m = -0.05
y_m = 0.05
hold_s = 0.5
"""


@pytest.fixture
def make_lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys):
    labs: list[PulseLab] = []

    def make(servos=(X, Y), **settings) -> PulseLab:
        labs.append(PulseLab(servos, tmp_path, monkeypatch, capsys, **settings))
        return labs[-1]

    yield make
    for lab in labs:
        lab.close()


def test_home_then_a_ball(make_lab):
    lab = make_lab(order=(1, 0))
    code, said, error = lab.call("home")
    assert code == 0, error
    assert "channels: swapped" in said
    assert "the markers see the plate level" in said
    wiring = json.loads(lab.rig_file.with_suffix(".home.json").read_text())["wiring"]
    assert (wiring["order"], wiring["sign_angle"]) == ([1, 0], [-1, 1])
    off_rad = np.array(wiring["zero_counts"]) * 2 * np.pi / wiring["counts_per_rev"]
    # By channel; the dead bands of both servos and the play of the joints are in it.
    assert off_rad == pytest.approx([-0.05, 0.07], abs=0.02)
    assert max(lab.world.board.pulses_us()) == 0.0  # a finished program leaves no pulses

    lab.lay_the_ball()
    code, said, found = lab.run(BALL)
    assert code == 0, said
    assert (found.meta["outcome"], found.meta["table"]) == ("completed", "pulses")
    assert np.isnan(found.log["theta_x_rad"]).all()
    x, y, t_s = (found.log[name] for name in ("ball_x_m", "ball_y_m", "t_s"))
    last = np.isfinite(x) & (t_s > t_s[-1] - 1.0)
    assert np.hypot(x[last], y[last]).max() < 0.04
    assert max(lab.world.board.pulses_us()) == 0.0


# Of three arms the horns sit 0.06, -0.04 and -0.02 rad too high, which is no height together; the
# second servo stands on its head.
OFF_RAD = (0.06, 0.04, -0.02)
ARMS = tuple(
    PulseServo(1500.0 + off * SLOPE, sign * SLOPE)
    for off, sign in zip(OFF_RAD, (1, -1, 1), strict=True)
)
WIDE = """title = "short"
duration_s = 6.0
[start]
x_m = -0.03
y_m = 0.03
hold_s = 0.5
"""


def test_three_arms_in_any_order_are_homed_and_balance_a_ball(make_lab):
    order = (2, 0, 1)
    lab = make_lab(ARMS, order=order, shipped="three-arms.toml")
    code, said, error = lab.call("home")
    assert code == 0, error
    assert "channels: arm at 240 degrees, arm at 0 degrees, arm at 120 degrees" in said
    wiring = json.loads(lab.rig_file.with_suffix(".home.json").read_text())["wiring"]
    assert (wiring["order"], wiring["sign_angle"]) == ([2, 0, 1], [1, 1, -1])
    off_rad = np.array(wiring["zero_counts"]) * 2 * np.pi / wiring["counts_per_rev"]
    # The plate's own play is 0.0035 rad, 0.01 at an arm; columns are secants: a tenth of a trim.
    assert off_rad == pytest.approx([OFF_RAD[servo] for servo in order], abs=0.02)
    assert max(lab.world.board.pulses_us()) == 0.0

    lab.start_m = (-0.03, 0.03)
    lab.lay_the_ball()
    code, said, found = lab.run(WIDE)
    assert code == 0, said
    assert (found.meta["outcome"], found.meta["table"]) == ("completed", "pulses")
    x, y, t_s = (found.log[name] for name in ("ball_x_m", "ball_y_m", "t_s"))
    last = np.isfinite(x) & (t_s > t_s[-1] - 1.0)
    assert np.hypot(x[last], y[last]).max() < 0.02
    assert max(lab.world.board.pulses_us()) == 0.0


def test_without_markers_three_arms_are_the_files_word(make_lab):
    keys = "trim_rad = [0.06, 0.04, -0.02]\nsign_angle = [1, -1, 1]"
    lab = make_lab(ARMS, markers=False, keys=keys, shipped="three-arms.toml")
    code, said, error = lab.call("home")
    assert code == 0, error
    assert "no markers were seen" in said
    wiring = json.loads(lab.rig_file.with_suffix(".home.json").read_text())["wiring"]
    assert (wiring["order"], wiring["sign_angle"]) == ([0, 1, 2], [1, -1, 1])
    assert wiring["zero_counts"] == [39, 26, -13]


def test_without_markers_homing_keeps_the_files_word(make_lab):
    lab = make_lab(markers=False, keys="trim_rad = [0.07, -0.05]\nsign_angle = [1, -1]")
    code, said, error = lab.call("home")
    assert code == 0, error
    assert "no markers were seen" in said
    wiring = json.loads(lab.rig_file.with_suffix(".home.json").read_text())["wiring"]
    assert (wiring["order"], wiring["sign_angle"]) == ([0, 1], [1, -1])
    assert wiring["zero_counts"] == [46, -33]


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("pulse_range_us = [1000, 3000]", "500 and 2500 us"),
        ("pulse_us_per_rad = [636.6, 0]", "10 to 3000 us/rad"),
        ("trim_rad = [0.6, 0.0]", "lower servo.angle_limit_rad, or correct the pulses"),
    ],
)
def test_pulses_that_no_servo_takes_are_one_line(make_lab, keys: str, words: str):
    code, _, error = make_lab(keys=keys).call("home")
    assert (code, error.count("\n")) == (2, 1)
    assert words in error
