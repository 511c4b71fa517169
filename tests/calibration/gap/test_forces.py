"""Forces of a ball that slips, is pushed or heavier on a side, and of a plate that swings: closed
forms, another plant."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import cumulative_trapezoid
from scipy.signal import lfilter

from calibration.gap import investigate
from calibration.gap.model.parameters import BALL
from calibration.gap.unnamed.basis import _answer
from calibration.gap.unnamed.forces import (
    SWING_STEP_S,
    as_one,
    attitude,
    pushes,
    slip_force,
    swing_force,
    swung,
)
from calibration.gap.unnamed.term import UnnamedTerm
from calibration.gap.unnamed.wording import describe
from rig.discrepancy import Discrepancy
from rig.log import Log
from rig.rigfile import read_rig
from tests.support.gap.tables import evidence_of, released
from tests.support.worlds import WORLDS, logs
from tests.support.worlds.loops import followed
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


def test_an_exposure_that_is_told_twice_changes_nothing():
    t, a = np.linspace(0.0, 1.0, 61), np.tile([0.3, 0.4], (61, 1))
    once = slip_force(t, a, FACTOR, 0.06)
    twice = slip_force(np.insert(t, 30, t[29]), np.insert(a, 30, a[29], axis=0), FACTOR, 0.06)
    np.testing.assert_array_equal(np.delete(twice, 30, axis=0), once)


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


def _asked() -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) [s] and steps (n,) that a servo takes."""
    t = SWING_STEP_S * np.arange(2000)
    asked = np.repeat(np.random.default_rng(3).uniform(-0.3, 0.3, 20), 100)
    asked[:100] = 0.0
    return t, asked


def test_another_plants_plate_swings_the_same():
    """Damped against the table it is both parts."""
    hz, damping, (t, asked) = 4.0, 0.1, _asked()
    plate, rate, each = np.zeros(len(t)), 0.0, 20
    for i in range(1, len(t)):
        plate[i] = plate[i - 1]
        for j in range(each):
            now = asked[i - 1] + (j + 1) / each * (asked[i] - asked[i - 1])
            rate = followed(rate, now - plate[i], hz, damping, SWING_STEP_S / each)
            plate[i] += rate * SWING_STEP_S / each
    told = sum(swung(t, asked, (hz, damping), damped=damped) for damped in (False, True))
    felt = plate - asked
    assert np.abs(told - felt).max() < 0.02 * np.abs(felt).max()


def test_impulses_at_the_exposures_move_a_ball_as_the_swing_does():
    """Where it is seen, though not evenly: it rolls, and the plate turns below it."""
    swing, k_g, radius_m, (t, asked) = (4.0, 0.1), 7.0, 0.013, _asked()
    later = np.random.default_rng(4).choice(t[100:-1], 60, replace=False)
    at = np.array([0.1, 0.15, *np.sort(later)])
    beyond = swung(t, asked, swing, damped=False)
    path = k_g * beyond
    for _ in range(2):
        path = cumulative_trapezoid(path, dx=SWING_STEP_S, initial=0.0)
    path -= radius_m * beyond
    force = swing_force(t, np.column_stack([asked, 2.0 * asked]), at, swing, k_g, radius_m)
    speed = np.cumsum(np.median(np.diff(at)) * force[:-1, 0])
    moved, felt = np.cumsum(speed * np.diff(at)), np.interp(at[1:], t, path)
    assert np.abs(moved - felt).max() < 1e-6 * np.abs(felt).max()
    np.testing.assert_allclose(force[:, 1], 2.0 * force[:, 0])


@pytest.mark.parametrize("hz", [0.7, 2.0, 4.0])
def test_residuals_answer_to_a_force_as_to_pushes_about_each_exposure(hz: float):
    """A rhythm, which a model can hold, is predicted by the model and by the answer to a push."""
    columns, _, _ = WORLDS["plain"](2)
    evidence = evidence_of(Log.from_columns(columns))
    state = released(evidence, ("viscous_drag", "xy"))
    size = 0.1
    rhythm = Discrepancy(ball_rhythm_x=(size, 0.0), ball_rhythm_hz=hz)
    model = state.nominal.with_unknown(rhythm).model(state.fit.setting)
    felt = (evidence.roll(model, BALL).z - state.fit.z(BALL))[::2]
    t = evidence.times(BALL)[0][::2]
    force = size * np.sin(2.0 * np.pi * hz * t)
    told = lfilter(_answer(state), [1.0], force)
    late = t > t[0] + 3.0  # what was before the log is not in the answer
    assert np.sqrt(np.mean((told - felt)[late] ** 2)) < 0.2 * np.sqrt(np.mean(felt[late] ** 2))


def test_the_frequency_is_told_of_the_axis_that_swings_alone():
    state = released(evidence_of(Log.from_columns(WORLDS["plain"](2)[0])), ("viscous_drag", "xy"))
    term = UnnamedTerm(BALL, "swinging", 9.0, Discrepancy(), state, rhythms_hz=(0.0, 4.5))
    assert describe(term).endswith("behind its servos, at about 4.5 Hz along y")


def test_a_plate_that_stays_does_not_swing():
    t = SWING_STEP_S * np.arange(100)
    still = np.full((100, 2), 0.7)
    assert not swing_force(t, still, t[::8], (3.0, 0.1), 7.0, 0.02).any()
    assert not swung(t, still[:, 0], (3.0, 0.1), damped=True).any()


def test_a_ball_that_rolled_once_round_looks_as_before():
    path = np.column_stack([np.linspace(0.0, 2.0 * np.pi * 0.02, 500), np.zeros(500)])
    turned = attitude(path, 0.02)
    np.testing.assert_allclose(turned[-1], np.eye(3), atol=1e-9)
    np.testing.assert_allclose(turned[len(turned) // 2] @ [0.0, 0.0, 1.0], [0, 0, -1], atol=0.02)


ANSWER = 2.0 * np.exp(-np.arange(60) / 12.0)  # of residuals to a push of one row, in deviations
ANSWERS = [np.convolve(ANSWER, np.ones(m)) for m in (20, 80)]
COST = 13.0


def residuals(seed: int, n: int = 2400) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, 1.0, (n, 2))


def test_pushes_are_found_where_they_are():
    z, w, told = residuals(1), np.ones((2400, 2)), {(400, 0): (0.5, 0.1), (1500, 1): (-0.2, 0.3)}
    for (i, j), size in told.items():
        z[i : i + len(ANSWERS[j])] += ANSWERS[j][:, None] * size
    found = pushes(z, w, np.zeros(2400), ANSWERS, COST)
    assert {(j, round(i, -1)) for i, j, _ in found} == {(j, i) for i, j in told}


def test_what_is_not_judged_tells_no_push():
    z, w = residuals(1), np.ones((2400, 2))
    z[400:] += 1.0
    w[400:] = 0.0
    assert not pushes(z, w, np.zeros(2400), ANSWERS, COST)


def test_a_push_does_not_leave_its_run():
    """One that would reach over the end of a run is a shorter one there."""
    z, w, run = residuals(1), np.ones((2400, 2)), np.repeat([0, 1], 1200)
    z[1150:1200] += 3.0
    found = pushes(z, w, run, ANSWERS, COST)
    assert found
    for i, j, _ in found:
        assert run[i] == run[i + len(ANSWERS[j]) - 1]


def test_a_push_of_another_length_than_those_tried_is_one():
    run, there, back = np.zeros(900), np.array([0.3, 0.1]), np.array([-0.3, 0.0])
    assert as_one([(100, 180, there), (182, 202, there)], 20, run) == [(100, 202)]
    assert as_one([(150, 230, there), (100, 180, there)], 20, run) == [(100, 230)]
    assert len(as_one([(100, 180, there), (182, 202, back)], 20, run)) == 2
    assert len(as_one([(100, 180, there), (210, 230, there)], 20, run)) == 2
    other = np.repeat([0, 1], [181, 719])
    assert len(as_one([(100, 180, there), (182, 202, there)], 20, other)) == 2


def test_noise_is_no_push():
    """A gain of 13 by 2 sizes at one place of about 2400/20 is exp(-13) times 120: 3 in 10 000."""
    w, run = np.ones((2400, 2)), np.zeros(2400)
    assert sum(bool(pushes(residuals(s), w, run, ANSWERS, COST)) for s in range(200)) == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("world", "seed", "told"),
    [
        ("slipping_ball", 2602, "slips"),
        ("mujoco_slipping_ball", 0, "slips"),
        ("fan", 2603, "pushes from"),
        ("swaying_floor", 3920, "along x and"),
        ("heavy_sided_ball", 2640, "turns with the ball"),
        ("elastic_plate", 3936, "swings behind its servos"),
        ("twisting_plate", 3939, "swings behind its servos"),
    ],
)
def test_what_has_no_name_is_told_as_what_it_is(world: str, seed: int, told: str, tmp_path):
    """What else they look like: a camera scale with drag and ripple; a ripple or a level."""
    if world.startswith("mujoco"):
        pytest.importorskip("mujoco", reason="uv sync --extra benchmark")
    columns, rig, _ = WORLDS[world](seed)
    (tmp_path / "rig.toml").write_text(rig, "utf-8")
    found = investigate([Log.from_columns(columns)], read_rig(tmp_path / "rig.toml")).findings
    assert found.verdict == "unknown-effect"
    assert told in found.sentence
