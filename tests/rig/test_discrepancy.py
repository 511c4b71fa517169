"""Room for the unknown: each part of the basis acts as written; predictor and simulator agree."""

import re
from dataclasses import replace
from math import cos, pi, sin, tanh
from pathlib import Path

import numpy as np
import pytest

from experiments.runs.assemble import known, load_rig
from rig.discrepancy import (
    ZERO_4,
    ZERO_16,
    Discrepancy,
    discrepancy_acceleration,
    pack,
    servo_discrepancy,
)
from rig.parameters import Rig, Servo
from rig.plant import plant, plant_record
from rig.prediction.innovations import Signals, predict
from rig.rigfile import read_rig, write_rig
from tests.rig.prediction.test_innovations import LEVELS, sizes, table


def one(n: int, i: int, value: float) -> tuple[float, ...]:
    return tuple(value if k == i else 0.0 for k in range(n))


@pytest.mark.parametrize("i", range(4))
@pytest.mark.parametrize("j", range(4))
def test_the_map_is_made_of_chebyshev_products(i: int, j: int):
    u = pack(Discrepancy(ball_map_y=one(16, 4 * i + j, 2.0)))
    for x, y in ((0.3, -0.7), (-1.0, 1.0), (0.0, 0.5)):
        expected = 2.0 * cos(i * np.arccos(x)) * cos(j * np.arccos(y))
        assert discrepancy_acceleration(u, 1, x, y, 0.0, 0.0) == pytest.approx(expected, abs=1e-12)
        assert discrepancy_acceleration(u, 0, x, y, 0.0, 0.0) == 0.0


def test_speed_rhythm_and_segment_act_as_written():
    u = pack(
        Discrepancy(
            ball_speed_x=(0.1, 0.2, 0.3, 0.4), ball_rhythm_x=(0.5, 0.6), ball_rhythm_hz=1.5,
            ball_segment=(0.7, 0.0), ball_segment_s=(2.0, 3.0),
        )
    )  # fmt: skip
    v, t = -0.05, 2.5
    speed = 0.1 * tanh(v / 0.01) + 0.2 * v + 0.3 * v * abs(v) + 0.4 * abs(v)
    rhythm = 0.5 * sin(2 * pi * 1.5 * t) + 0.6 * cos(2 * pi * 1.5 * t)
    assert discrepancy_acceleration(u, 0, 0, 0, v, t) == pytest.approx(speed + rhythm + 0.7)
    at_end = 0.5 * sin(2 * pi * 1.5 * 3) + 0.6 * cos(2 * pi * 1.5 * 3)
    assert discrepancy_acceleration(u, 0, 0, 0, v, 3.0) == pytest.approx(speed + at_end)
    u = pack(Discrepancy(servo_map_y=(1.0, 0.0, 0.0, 2.0), servo_segment=(0.0, 3.0)))
    z = 0.2 / (pi / 6)
    expected = z + 2 * (8 * z**4 - 8 * z**2 + 1)
    assert servo_discrepancy(u, 1, 0.2, 0.0, 1.0) == pytest.approx(expected)


def test_a_servo_that_turns_further_has_a_wider_map():
    shape = Discrepancy(servo_map_x=(0.0, 0.0, 0.0, 2.0))
    assert servo_discrepancy(pack(shape, 3.0), 0, 3.0, 0.0, 0.0) == pytest.approx(2.0)
    wide = replace(Rig(), servo=Servo(angle_limit_rad=3.0), unknown=shape)
    assert plant_record.pack(wide)["unknown"]["servo_angle"] == 3.0


CASES = {
    "map": (Discrepancy(ball_map_x=one(16, 9, 0.05)), "ball"),
    "ball speed": (Discrepancy(ball_speed_y=(0.02, 0.0, 0.0, 0.0)), "ball"),
    "ball rhythm": (Discrepancy(ball_rhythm_x=(0.05, 0.0), ball_rhythm_hz=1.3), "ball"),
    "ball segment": (Discrepancy(ball_segment=(0.1, 0.0), ball_segment_s=(1.0, 1.5)), "ball"),
    "servo map": (Discrepancy(servo_map_x=(0.0, 0.3, 0.0, 0.0)), "servo"),
    "servo speed": (Discrepancy(servo_speed_x=(0.0, 0.0, 0.1, 0.0)), "servo"),
    "servo rhythm": (Discrepancy(servo_rhythm_y=(0.3, 0.1), servo_rhythm_hz=3.0), "servo"),
    "servo segment": (Discrepancy(servo_segment=(0.4, 0.0), servo_segment_s=(1.0, 1.5)), "servo"),
}


def log(unknown: Discrepancy) -> Signals:
    """A closed-loop log of a table with this unnamed term, without noise."""
    rig = replace(table(None, 1000.0), unknown=unknown)
    p, s = plant_record.pack(rig, step_s=2e-5), plant.rest((0.01, -0.02))
    history, seen, rows, frames = np.zeros((2, 2)), np.full(7, np.nan), [], []
    for k in range(2000):
        t = k / 1000
        wanted = 0.15 * np.array([sin(7.1 * t), sin(5.9 * t + 2)])
        volts = 14 * (wanted - 1.5 * s[plant.BALL] - s[plant.BALL_W] - s[plant.ARM])
        rows.append((t, *volts, *s[plant.ARM]))
        history[0] = volts
        plant.advance(s, p, history, t, 1e-3, 0.0, 0.0, False, (len(frames) + 1) / 60, seen)
        if not np.isnan(seen[6]):
            frames.append((seen[6], seen[0], seen[1]))
    r, f = np.array(rows), np.array(frames)
    return Signals(
        r[:, 0].copy(), r[:, 1:3].copy(), r[:, 3:].copy(), f[:, 0].copy(), f[:, 1:].copy()
    )


@pytest.mark.parametrize("name", CASES)
def test_simulator_and_predictor_share_the_term(name: str):
    unknown, channel = CASES[name]
    other = "ball" if channel == "servo" else "servo"
    signals, bare = log(unknown), table(None, 1000.0)
    with_it = sizes(predict(replace(bare, unknown=unknown), signals, LEVELS), 1000.0)
    without = sizes(predict(bare, signals, LEVELS), 1000.0)
    assert without[channel] > 8 * with_it[channel]
    assert without[other] == pytest.approx(with_it[other], rel=1e-9)


def test_it_lives_in_the_rig_file_and_controllers_do_not_see_it(tmp_path: Path):
    rig = replace(load_rig(None), unknown=Discrepancy(ball_map_x=one(16, 5, 0.1)))
    write_rig(rig, tmp_path / "rig.toml")
    assert read_rig(tmp_path / "rig.toml") == rig
    assert known(rig).unknown == Discrepancy()
    bad = tmp_path / "bad.toml"
    for line, words in (
        ("ball_speed_x = [1.0]", "unknown.ball_speed_x has 1 numbers; it needs 4"),
        ("ball_rhythm_hz = inf", "unknown.ball_rhythm_hz = inf: must be finite"),
        ("ball_rhythm_hz = true", "unknown.ball_rhythm_hz = True: Input should be a valid number"),
        ("servo_rhythm_x = [nan, 0.0]", "unknown.servo_rhythm_x = (nan, 0.0): must be finite"),
    ):
        bad.write_text(f"[unknown]\n{line}\n")
        with pytest.raises(ValueError, match=re.escape(f"{bad}: {words}")):
            read_rig(bad)


def test_zero_coefficients_change_nothing():
    bare = table(None, 500.0)
    told = replace(bare, unknown=Discrepancy(ball_map_x=ZERO_16, servo_map_y=ZERO_4))
    assert plant_record.pack(told).tobytes() == plant_record.pack(bare).tobytes()
    assert plant_record.pack(told)["unknown"]["on"] == 0
