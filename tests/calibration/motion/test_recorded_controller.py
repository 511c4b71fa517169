"""A controller is read from its commands: gains, filter, rate, targets and when they changed."""

import numpy as np
import pytest

from calibration.motion.recorded_controller import RecordedController, identify
from calibration.motion.recorded_law import KD, KI, KP, OF_TARGET, RATE, follow, started
from calibration.motion.target_changes import recorded_changes, stretches
from rig.log import Log

TICK_S = 0.01
LAW = np.array([3.0, 0.5, 2.4, 0.1, 1.0, 3.3, np.inf])
PLACES = np.array([[0.0, 0.0], [0.06, 0.04], [0.0, 0.0], [-0.05, 0.03], [0.02, -0.04]])
SECTION = 800  # ticks


def closed_loop(law: np.ndarray, *, seed: int = 1) -> dict[str, np.ndarray]:
    """Ball, commands and targets of a double integrator that is steered by the law, its input late
    by 5 ticks."""
    rng = np.random.default_rng(seed)
    n = SECTION * len(PLACES)
    targets = np.repeat(PLACES, SECTION, axis=0)
    ball, told = np.zeros((n, 2)), np.zeros((n, 2))
    for a in range(2):
        state, x, v = started(0.0, 0.0), 0.0, 0.0
        for k in range(n):
            ball[k, a] = x + 3e-4 * rng.standard_normal()
            follow(
                law, state, targets[k : k + 1, a], ball[k : k + 1, a], TICK_S, told[k : k + 1, a]
            )
            v += TICK_S * told[max(k - 5, 0), a]
            x += TICK_S * v
    columns = {"t_s": np.arange(n) * TICK_S}
    for a, axis in enumerate("xy"):
        columns[f"ball_{axis}_m"], columns[f"command_{axis}_rad"] = ball[:, a], told[:, a]
        columns[f"target_{axis}_m"] = targets[:, a]
    return columns


def found(columns: dict[str, np.ndarray], *, targets: bool = False) -> RecordedController:
    kept = {k: v for k, v in columns.items() if targets or not k.startswith("target")}
    controller = identify(Log.from_columns(kept))
    assert controller is not None
    return controller


@pytest.mark.parametrize("of_target", [1.0, 0.0])
def test_gains_and_targets_come_back_from_commands_and_ball(of_target: float):
    law = LAW.copy()
    law[OF_TARGET] = of_target
    columns = closed_loop(law)
    controller = found(columns)
    assert controller.explained.min() > 0.99
    for one in controller.laws:
        np.testing.assert_allclose(one[[KP, KI, KD]], law[[KP, KI, KD]], rtol=0.05)
        assert one[OF_TARGET] == of_target
    for k, true in zip(controller.changes, range(SECTION, 5 * SECTION, SECTION), strict=True):
        assert abs(k - true) <= 1
    late = np.arange(SECTION // 2, 5 * SECTION, SECTION)
    np.testing.assert_allclose(controller.targets_m[late], PLACES, atol=1e-3)


def test_a_limit_of_the_rate_is_seen():
    assert found(closed_loop(LAW)).laws[0, RATE] == pytest.approx(3.3, rel=1e-6)
    slow = LAW.copy()
    slow[RATE] = np.inf
    assert np.isinf(found(closed_loop(slow)).laws[:, RATE]).all()


def test_recorded_targets_are_believed():
    controller = found(closed_loop(LAW), targets=True)
    assert controller.changes == tuple(range(SECTION, 5 * SECTION, SECTION))
    np.testing.assert_allclose(controller.laws[0, [KP, KI, KD]], [3.0, 0.5, 2.4], rtol=0.02)


def test_the_state_at_a_row_goes_on_as_the_recording_does():
    columns = closed_loop(LAW)
    controller = found(columns, targets=True)
    row = SECTION + 40
    states = controller.states(row)
    for a, axis in enumerate("xy"):
        told, part = np.empty(20), slice(row, row + 20)
        r, x = controller.targets_m[part, a], controller.ball_m[part, a]
        follow(controller.laws[a], states[a], r, x, TICK_S, told)
        assert abs(told - columns[f"command_{axis}_rad"][part]).max() < 0.01


def test_commands_that_do_not_follow_the_ball_tell_no_controller():
    columns = closed_loop(LAW)
    rng = np.random.default_rng(3)
    for axis in "xy":
        columns[f"command_{axis}_rad"] = np.repeat(0.1 * rng.standard_normal(400), 10)
    assert identify(Log.from_columns(columns)) is None


def test_a_target_that_never_changes_tells_none_and_neither_does_a_log_without_ball():
    columns = {k: v[:SECTION] for k, v in closed_loop(LAW).items()}
    assert identify(Log.from_columns(columns)) is None
    blind = {k: v for k, v in closed_loop(LAW).items() if not k.startswith("ball")}
    assert identify(Log.from_columns(blind)) is None


def test_stretches_end_where_the_ball_is_gone_or_commands_stand_still():
    t = np.arange(3000) * TICK_S
    ball, told = np.zeros((3000, 2)), np.sin(t)[:, None] * np.ones(2)
    ball[1000:1100] = np.nan
    told[2000:2100] = told[2000]
    assert [(s.start, s.stop) for s in stretches(t, ball, told)] == [
        (0, 1000),
        (1100, 2001),
        (2100, 3000),
    ]


def test_a_target_that_glides_changes_once():
    still = np.zeros((100, 2))
    glide = np.linspace([0.0, 0.0], [0.05, 0.05], 400)
    for digits in (9, 3):  # written with few digits it stands still between two of them
        targets = np.round(np.concatenate([still, glide, still + 0.05, still]), digits)
        found = recorded_changes(np.arange(len(targets)) / 50.0, targets)
        assert found == [int(np.argmax(targets.any(axis=1))), 600]
