"""The proof: one floor for every row, judged on what the fit has not seen; a second ahead."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calibration.gap.investigation import Investigation, _farther, investigate
from calibration.gap.model.parameters import BALL, NominalModel
from calibration.gap.prove import model_of, on, prove, rms, split
from rig.parameters import CHANNELS, GRAVITY_M_S2, Rig
from rig.plant.plant_record import pack
from rig.prediction.innovations import Signals, ball_ahead, noise, servo_ahead
from tests.support.gap.tables import RIG, evidence_of, foreign, without_columns

PLAY = {"joint_backlash": {"x": {"play_rad": 0.035}}}
SECONDS = 15.0


@cache
def investigation() -> Investigation:
    """Play hidden in two runs of one table: the fit sees one, the proof the other."""
    logs = [foreign("steps", seed=seed, effects=PLAY, imperfect=False, duration_s=SECONDS)
            for seed in (3, 4)]  # fmt: skip
    return investigate(logs, RIG, until="prove")


def closed(before: float, after: float) -> float:
    """Share of the gap that was closed."""
    return (before - after) / (before - 1.0)


@pytest.mark.slow
def test_the_gap_of_a_hidden_play_closes_on_the_other_run():
    found = investigation().findings
    gap = found.gap
    assert found.verdict == "named"
    assert gap.held_out
    assert gap.floor == "fullest model"
    assert set(gap.before) == set(gap.after) == set(gap.floors) == set(CHANNELS)
    assert gap.before["ball_x"] > 1.15
    assert closed(gap.before["ball_x"], gap.after["ball_x"]) > 0.9
    for channel in ("servo_x", "servo_y", "ball_y"):  # nothing was hidden there
        assert gap.before[channel] == pytest.approx(1.0, abs=0.02)
        assert gap.after[channel] == pytest.approx(1.0, abs=0.02)


def test_floors_are_the_noise_that_was_put_in():
    floors = investigation().findings.gap.floors
    for axis in "xy":
        assert 3e-4 < floors[f"ball_{axis}"] < 4.5e-4  # the camera's 0.3 mm and the prediction's
        assert 0.9 < floors[f"servo_{axis}"] / (RIG.servo.encoder_step_rad / 12**0.5) < 1.5


def test_a_second_ahead_the_error_falls_to_the_floor():
    ahead = investigation().findings.gap.ahead_1s_mm
    assert ahead["before"] > 1.5 * ahead["after"]
    assert ahead["after"] < 1.25 * ahead["floor"]  # a fit on 15 s; on a minute it is 1.1
    assert 0.3 < ahead["floor"] < 5.0


def test_the_four_rows_stand_over_the_same_floors():
    found = investigation().findings
    labels = [row.model.split(":")[0] for row in found.proof]
    assert labels == ["nothing added", "best rival", "unnamed term", "named"]
    assert found.proof[-1].model == "named: joint_backlash"
    assert found.proof[0].gap == found.gap.before
    assert found.proof[-1].gap == found.gap.after
    best = min(found.proof, key=lambda row: row.gap["ball_x"])
    assert best.model == "named: joint_backlash"
    for row in found.proof:
        assert set(row.gap) == set(found.gap.floors)
        assert row.ahead_1s_mm is not None
    assert min(row.ahead_1s_mm or 0 for row in found.proof) == found.proof[-1].ahead_1s_mm


def test_before_and_after_are_residuals_over_one_floor_recomputed_by_hand():
    found, decision = investigation().findings, investigation().decision
    assert decision is not None
    after = decision.state
    before = replace(decision.naming.before, evidence=after.evidence)
    halves = split(after.evidence)

    def pooled(state, fitted_on) -> dict[str, float]:
        """RMS over both halves, which have about as many samples each."""
        of = [rms(h, model_of(on(state, f))) for h, f in zip(halves, fitted_on, strict=True)]
        return {c: float(np.hypot(of[0][c], of[1][c])) / 2**0.5 for c in of[0]}

    floors = pooled(after, halves)
    assert found.gap.floors == pytest.approx(floors, rel=1e-3)
    for state, gap in ((before, found.gap.before), (after, found.gap.after)):
        size = pooled(state, halves[::-1])
        assert {c: size[c] / floors[c] for c in floors} == pytest.approx(gap, rel=1e-3)


def test_the_floor_does_not_depend_on_what_it_is_compared_with():
    decision = investigation().decision
    assert decision is not None
    after, levels = decision.state, decision.state.evidence.levels
    alone = prove({"nothing added": after, "named": after}, "named", levels)
    assert alone.gap.floors == pytest.approx(investigation().findings.gap.floors)
    assert alone.gap.before == alone.gap.after


def test_the_steps_go_from_the_model_as_it_came_to_the_last_effect():
    steps = investigation().findings.steps
    assert [step.added for step in steps] == ["", "joint_backlash x"]
    assert steps[0].gap["ball_x"] > 1.1 > steps[1].gap["ball_x"]


def test_nothing_missing_has_no_gap():
    log = foreign("steps", seed=10, duration_s=8.0)
    found = investigate([without_columns(log, "ball", "target")], RIG).findings
    assert found.verdict == "nothing-missing"
    assert found.gap.before == found.gap.after == {"servo_x": 1.0, "servo_y": 1.0}
    assert not found.effects
    assert not found.gap.ahead_1s_mm
    for size in found.gap.ahead_1s_deg.values():
        assert list(size) == ["before"]
        assert 0.0 < size["before"] < 0.2
    assert set(found.gap.ahead_1s_deg) == {"servo_x", "servo_y"}
    assert all(floor > 0 for floor in found.gap.floors.values())


@pytest.mark.parametrize("runs", [1, 2, 3])
def test_the_two_parts_share_nothing_and_together_are_all(runs: int):
    logs = [foreign("steps", seed=seed, duration_s=4.0) for seed in range(runs)]
    whole = evidence_of(*logs)
    train, test = split(whole)
    for output in whole.outputs:
        mine, other = train.masks[output], test.masks[output]
        np.testing.assert_array_equal(mine + other, whole.masks[output])
        assert not (mine * other).any()
        assert mine.any()
        assert other.any()
        t, run = whole.times(output)
        if runs > 1:
            assert set(run[mine > 0]).isdisjoint(run[other > 0])
        else:
            assert t[mine > 0].max() < t[other > 0].min()


FRAME_S, LONG_S, ANGLE = 0.004, 4.0, np.array([0.02, -0.01])
LIVELY = noise(ball_process=5.0, ball_measured=1e-5)  # a filter that believes what it sees


def rolling(gain_m_s2: float) -> Signals:
    """A ball on a plate at rest: x = x0 + v0 t + a t^2/2 with a = k g (2R/L) sin(theta)."""
    t = np.arange(0, LONG_S + 0.002, 0.002)
    seen = np.arange(0.001, LONG_S, FRAME_S)
    away = gain_m_s2 * np.sin(ANGLE)[None, :] * seen[:, None] ** 2 / 2
    ball = np.array([-0.05, 0.06]) + np.array([0.01, -0.02]) * seen[:, None] + away
    return Signals(t, np.zeros((len(t), 2)), np.tile(ANGLE, (len(t), 1)), seen, ball)


def slope_error(horizon_s: float, slope_rad: float, known: Signals) -> np.ndarray:
    rig = Rig(effects={"level_offset": {"x": {"slope_rad": slope_rad}}} if slope_rad else {})
    errors, _ = ball_ahead(pack(rig), known, LIVELY, horizon_s=horizon_s)
    return errors[np.isfinite(errors).all(axis=1)]


def test_ahead_on_a_constant_slope_the_right_model_is_exact():
    known = rolling(RIG.ball_gain_m_s2)
    errors = slope_error(1.0, 0.0, known)
    assert len(errors) >= 5  # one every half second where a second is left
    np.testing.assert_allclose(errors, 0.0, atol=2e-6)


@pytest.mark.parametrize("horizon_s", [1.0, 0.5])
def test_ahead_a_wrong_slope_misses_by_half_its_acceleration_times_the_square(horizon_s: float):
    slope = 0.002
    errors = slope_error(horizon_s, slope, rolling(RIG.ball_gain_m_s2))
    factor = RIG.ball.rolling_factor * GRAVITY_M_S2
    expected = -factor * slope * horizon_s**2 / 2  # measured minus predicted
    np.testing.assert_allclose(errors[:, 0], expected, rtol=0.04)
    np.testing.assert_allclose(errors[:, 1], 0.0, atol=2e-5)


def test_no_window_crosses_a_fresh_start():
    known = rolling(RIG.ball_gain_m_s2)
    fresh = np.zeros(len(known.exposed_s), bool)
    fresh[::400] = True  # every 1.6 s: at most one whole window between two of them
    errors, _ = ball_ahead(pack(RIG), replace(known, fresh=fresh), LIVELY)
    ends = known.exposed_s[np.isfinite(errors[:, 0])]
    starts = known.exposed_s[fresh]
    for end in ends:
        assert end - starts[starts <= end].max() > 0.9
    everywhere, _ = ball_ahead(pack(RIG), known, LIVELY)
    assert 1 <= len(ends) < np.isfinite(everywhere[:, 0]).sum()


@pytest.mark.parametrize("missing_V", [0.0, 0.1])
def test_ahead_a_servo_misses_by_the_way_of_the_volts_that_the_model_lacks(missing_V: float):
    """theta = K V (t - tau (1 - exp(-t/tau))) from rest; the filter has found the speed."""
    gain, tau, volts = RIG.servo.gain_rad_s_V, RIG.servo.time_constant_s, 0.4
    t = np.arange(0.0, 8.0, 0.002)
    angle = gain * (volts + missing_V) * (t - tau * (1.0 - np.exp(-t / tau)))
    pair = np.column_stack([np.full(len(t), volts), np.zeros(len(t))])
    known = Signals(t, pair, np.column_stack([angle, 0 * t]), np.zeros(0), np.zeros((0, 2)))
    record = NominalModel(RIG, load_friction=False).model({}).record
    errors, spread = servo_ahead(record, known, LIVELY, (gain,) * 2, (tau,) * 2, 0)
    late = np.isfinite(errors) & (t > 3.0)
    assert late.sum() >= 6
    np.testing.assert_allclose(errors[late], gain * missing_V * 1.0, rtol=0.06, atol=1e-6)
    assert np.all(spread[late] > 0.0)


def test_rms_leaves_out_what_the_masks_leave_out():
    evidence = evidence_of(foreign("steps", seed=2, duration_s=4.0))
    model = investigation().decision
    assert model is not None
    nominal = model_of(model.state)
    whole = rms(evidence, nominal)
    half = (np.arange(len(evidence.masks[BALL])) // 2 % 2).astype(float)
    masks = [evidence.masks | {BALL: evidence.masks[BALL] * chosen} for chosen in (half, 1 - half)]
    part, rest = (rms(replace(evidence, masks=mask), nominal) for mask in masks)
    assert part["servo_x"] == whole["servo_x"]
    both = np.sqrt((part["ball_x"] ** 2 + rest["ball_x"] ** 2) / 2)
    assert both == pytest.approx(whole["ball_x"], rel=0.01)


def test_a_shape_without_a_name_that_predicts_worse_is_told_as_no_law():
    gap = investigation().findings.gap
    assert not _farther(gap)
    worse = replace(gap, ahead_1s_mm={"before": 1.0, "after": 1.2, "floor": 0.9})
    (note,) = _farther(worse)
    assert note.endswith("1 s ahead on data not used, the ball errs more with it")
