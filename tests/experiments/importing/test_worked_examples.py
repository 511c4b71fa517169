"""The examples of the page: each command line is taken from it and does what it says."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from experiments.records.importing import read_log
from tests.support import ROOT, command
from tests.support.command import call

PAGE = ROOT / "experiments" / "importing" / "README.md"
HZ = 50.0


def table(seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time [s], commanded angles (n, 2) [rad], a steel ball (n, 2) [m] on a plate that follows with
    a lag of 60 ms: 1 rad of servo is 0.14 of tilt."""
    rng, dt = np.random.default_rng(seed), 1 / HZ
    t = np.arange(40 * int(HZ)) * dt
    told, ball = np.zeros((len(t), 2)), np.zeros((len(t), 2))
    angle, speed, target = np.zeros(2), np.zeros(2), np.zeros(2)
    for k in range(1, len(t)):
        if k % 60 == 1:
            target = rng.uniform(-0.06, 0.06, 2)
        told[k] = np.clip(8.0 * (target - ball[k - 1]) - 4.2 * speed, -0.5, 0.5)
        angle += (told[k - 1] - angle) * (1 - np.exp(-dt / 0.06))
        pull = 5 / 7 * 9.81 * 0.14 * np.sin(angle)
        ball[k] = ball[k - 1] + speed * dt + 0.5 * pull * dt * dt
        speed += pull * dt
    return t, told, ball + rng.normal(0, 3e-4, ball.shape)


T, TOLD, BALL = table()


def text(path: Path, names: str, columns: np.ndarray, *, comma: bool = False) -> None:
    rows = [";".join(f"{v:.6f}" for v in row) for row in columns]
    whole = "\n".join(([names] if names else []) + rows) + "\n"
    path.write_text(whole.replace(".", ",") if comma else whole.replace(";", ","), "utf-8")


def write_all(folder: Path) -> None:
    """The files that the page's examples name."""
    deg, mm = np.degrees(TOLD), 1e3 * BALL
    text(
        folder / "messung.csv",
        "Zeit [ms];Servo X Soll [°];Servo Y Soll [°];Kugel X [mm];Kugel Y [mm]",
        np.column_stack((1e3 * T, 90 - deg[:, 0], 90 + deg[:, 1], mm)),
        comma=True,
    )
    pixels = (320, 240) + 2000 * BALL * (1, -1)
    text(folder / "nameless.csv", "", np.column_stack((1e3 * T, deg, pixels)))
    pulses = 1500 + TOLD * 1000 / (np.pi / 2)
    text(folder / "pulses.csv", "t_ms;pwm_1_us;pwm_2_us;x_cm;y_cm",
         np.column_stack((1e3 * T, pulses[:, ::-1], 0.1 * mm)))  # fmt: skip
    text(folder / "plain.csv", "tiempo;angulo_x;angulo_y;pelota_x;pelota_y",
         np.column_stack((T, deg, mm)))  # fmt: skip
    savemat(folder / "run.mat", {"t": T, "servo": deg, "ball": mm})
    np.savez(folder / "run.npz", t=T, servo_cmd_deg=deg, ball_mm=mm)
    text(folder / "lies.csv", "t_s;command_x_rad;command_y_rad;ball_x_m;ball_y_m",
         np.column_stack((T, deg, BALL)))  # fmt: skip


def examples() -> list[str]:
    """The command lines of the page's worked examples."""
    part = PAGE.read_text(encoding="utf-8").split("## Worked examples")[1].split("\n## ")[0]
    return re.findall(r"^uv run (rig import .*)$", part, re.MULTILINE)


def test_the_page_has_an_example_for_every_file():
    assert len(examples()) == 7


@pytest.mark.parametrize("line", examples())
def test_an_example_gives_the_log_that_was_hidden(line: str, tmp_path: Path, monkeypatch, capsys):
    write_all(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("experiments.cli.importing.somebody_is_there", lambda: False)
    assert call(*shlex.split(line)[1:]) == 0, capsys.readouterr().err
    log = read_log(tmp_path / "out" / "run.csv")
    told = np.column_stack((log["command_x_rad"], log["command_y_rad"]))
    ball = np.column_stack((log["ball_x_m"], log["ball_y_m"]))
    np.testing.assert_allclose(log["t_s"] - log["t_s"][0], T, atol=1e-6)
    # pixels count downwards, and the page says that such an axis stays as the camera has it
    sign = (1, -1) if "nameless" in line else (1, 1)
    np.testing.assert_allclose(told * sign, TOLD, atol=2e-4)
    np.testing.assert_allclose((ball - ball[0]) * sign, BALL - BALL[0], atol=2e-5)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("lies.csv", "it would with the angle in deg: state it with --set command.unit=deg"),
        ("pulses.csv", "nothing says the rad in one us (90 degrees in 1000 us are 0.00157)"),
        ("nameless.csv", "no column is the ball's place by its name"),
        ("plain.csv", "commanded or measured: state it with --set angle.kind=commanded"),
    ],
)
def test_what_a_file_does_not_say_is_asked_in_one_line(line, says, tmp_path, monkeypatch, capsys):
    write_all(tmp_path)
    monkeypatch.setattr("experiments.cli.importing.somebody_is_there", lambda: False)
    out = tmp_path / "out.csv"
    assert call("import", tmp_path / line, "--out", out, "--yes") == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert says in said
    assert not out.exists()


@pytest.mark.parametrize("how", ["alike", "turned round", "plugs exchanged", "in ms"])
def test_a_further_file_that_contradicts_the_map_is_refused(how: str, tmp_path: Path):
    """The first file's map was laid on all: wrong signs, axes and clocks without a word."""
    names = "time;cmd_x;cmd_y;ball_x;ball_y"
    t, told, ball = table(seed=2)
    deg = np.degrees(told)
    other = {
        "turned round": np.column_stack((t, deg * (-1, 1), 1e3 * ball)),
        "plugs exchanged": np.column_stack((t, deg[:, ::-1], 1e3 * ball)),
        "in ms": np.column_stack((1e3 * t, deg, 1e3 * ball)),
    }.get(how, np.column_stack((t, deg, 1e3 * ball)))
    text(tmp_path / "one.csv", names, np.column_stack((T, np.degrees(TOLD), 1e3 * BALL)))
    text(tmp_path / "two.csv", names, other)
    files = ["one.csv", "two.csv"]
    units = ["--set", "ball.unit=mm", "--set", "command.unit=deg", "--set", "time.unit=s"]
    words = [*(str(tmp_path / name) for name in files), "--out", str(tmp_path / "log.csv")]
    code, out, error = command.told("import", *words, "--yes", *units)
    if how == "alike":
        assert code == 0, error
        assert (tmp_path / "log-2.csv").is_file()
        return
    assert code == 2, out
    assert "two.csv: the map of the first file does not fit it" in error
    assert not list(tmp_path.glob("log*"))
