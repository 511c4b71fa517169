"""Forces of a ball that slips or is heavier on a side, against closed forms and another plant."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.gap import investigate
from calibration.gap.unnamed.forces import attitude, slip_force
from rig.log import Log
from rig.rigfile import read_rig
from tests.support.worlds import WORLDS, logs
from tests.support.worlds.plant import G_m_s2, STEP_s, ball_step

FACTOR = 0.6  # of a hollow ball


def test_a_ball_rolls_where_friction_suffices():
    t = np.linspace(0.0, 4.0, 241)
    a = np.column_stack([0.2 * np.sin(3.0 * t), 0.1 * np.cos(5.0 * t)])
    assert np.abs(slip_force(t, a, FACTOR, 0.4 * np.hypot(0.2, 0.1))).max() < 1e-12


def test_on_a_steep_plate_friction_gives_no_more_than_there_is():
    """From rest it slides with a - mu g, where a rolling one has 0.6 a."""
    t = np.linspace(0.0, 1.0, 61)
    a = np.tile([0.3, 0.4], (61, 1))
    told = slip_force(t, a, FACTOR, 0.06)[1:]
    np.testing.assert_allclose(told, np.tile((0.4 * 0.5 - 0.06) * np.array([0.6, 0.8]), (60, 1)))


def test_a_level_plate_takes_up_the_slip():
    """s' = a - mu g/(1 - k), then back on the level s' = -mu g/(1 - k): it slips for longer than
    the plate was steep."""
    t = np.linspace(0.0, 2.0, 2001)
    a = np.zeros((2001, 2))
    a[:501, 0] = 0.4  # for half a second
    slips = np.abs(slip_force(t, a, FACTOR, 0.08)[:, 0]) > 1e-9
    speed_m_s = (0.4 - 0.08 / 0.4) * 0.5
    assert t[slips][-1] == pytest.approx(0.5 + speed_m_s / (0.08 / 0.4), abs=0.003)


@given(st.integers(0, 10_000), st.floats(0.005, 0.2))
def test_friction_is_never_more_than_there_is(seed: int, most: float):
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.01, 0.03, 120))
    a = rng.normal(0.0, 0.3, (120, 2))
    mean = 0.5 * (a[1:] + a[:-1])
    friction = (1.0 - FACTOR) * mean - slip_force(t, a, FACTOR, most)[1:]
    assert np.hypot(*friction.T).max() <= most * (1.0 + 1e-9)


def test_another_plants_ball_slips_the_same():
    """The speed of the independent plant's ball on a plate that is set ever anew."""
    mu, rng = 0.006, np.random.default_rng(2)
    tilts = np.repeat(rng.uniform(-0.05, 0.05, (16, 2)), 2000, axis=0)
    heavy, still, plate = np.array([0.0, 0.0, -1.0]), np.zeros(2), logs.ball(mu=mu)
    ball, path = np.zeros(6), []
    for tilt in tilts:
        ball_step(ball, heavy, tilt, still, still, still, plate, STEP_s)
        path.append(ball[2:4].copy())
    a, t = G_m_s2 * np.sin(tilts), STEP_s * np.arange(1, len(tilts) + 1)
    beyond = slip_force(t, a, FACTOR, mu * G_m_s2)
    speed = np.cumsum(FACTOR * a + beyond, axis=0) * STEP_s
    rolling = np.cumsum(FACTOR * a, axis=0) * STEP_s
    missed, of = np.abs(speed - path).max(), np.abs(rolling - path).max()
    assert of > 0.05
    assert missed < 0.01 * of


def test_a_ball_that_rolled_once_round_looks_as_before():
    path = np.column_stack([np.linspace(0.0, 2.0 * np.pi * 0.02, 500), np.zeros(500)])
    turned = attitude(path, 0.02)
    np.testing.assert_allclose(turned[-1], np.eye(3), atol=1e-9)
    np.testing.assert_allclose(turned[len(turned) // 2] @ [0.0, 0.0, 1.0], [0, 0, -1], atol=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(("world", "seed"), [("slipping_ball", 2602), ("mujoco_slipping_ball", 0)])
def test_a_ball_that_slips_has_no_name_but_is_told(world: str, seed: int, tmp_path):
    """Before, it was a camera scale with drag and ripple, with certainty."""
    if world.startswith("mujoco"):
        pytest.importorskip("mujoco", reason="uv sync --extra benchmark")
    columns, rig, _ = WORLDS[world](seed)
    (tmp_path / "rig.toml").write_text(rig, "utf-8")
    found = investigate([Log.from_columns(columns)], read_rig(tmp_path / "rig.toml")).findings
    assert found.verdict == "unknown-effect"
    assert "slips" in found.sentence
