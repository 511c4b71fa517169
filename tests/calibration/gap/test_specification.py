"""Is a named model complete, and are its sizes constants: the regressions on made data, and both
tests on logs of a table where the right name is known and where there is none."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial.legendre import legvander

from calibration.gap import investigate
from calibration.gap.constancy import TREND_ORDERS, inconstancy, trend_of_one_run
from calibration.gap.decision_rule import (
    FAMILY_P,
    MAX_INCONSTANCY,
    MAX_UNEVENNESS,
    MIN_COMPLETENESS,
)
from calibration.gap.model.flexible import Regressors, observer, with_hats
from calibration.gap.model.intervals import Spread
from calibration.gap.model.parameters import BALL, FALL_KEY, NominalModel
from calibration.gap.model.state import State, drop_effects, refit, settle
from calibration.gap.name.decide import Decision, decide
from calibration.gap.name.stepwise import Accepted, name_effects, settled_baseline
from calibration.gap.specification import (
    FOLDS,
    LEADS_S,
    _advanced,
    another_response,
    completeness,
    misfit_of_a_fall,
    part_of_what_is_left,
    untimely,
    weaker_at_centre,
)
from calibration.gap.unnamed.term import UnnamedTerm
from rig.discrepancy import Discrepancy
from rig.log import Log
from rig.rigfile import read_rig
from tests.support.gap.tables import RIG, evidence_of, foreign, released, without_columns
from tests.support.worlds import WORLDS
from tests.support.worlds.logs import table_log

N, STEP_S = 2000, 0.05


def made(seed: int, size: float) -> tuple[Regressors, np.ndarray, np.ndarray]:
    """Regressors, innovations that one of them causes by `size`, and folds of a second."""
    from scipy.signal import lfilter

    rng = np.random.default_rng(seed)
    rows = Regressors((rng.standard_normal((N, 6)),), 2, STEP_S, np.inf)
    b, a = observer(STEP_S, 0.01, 3e-4)
    answer = lfilter(b, a, rows.runs[0][:, 3])
    z = rng.standard_normal(N) + size * answer / answer.std()
    return rows, z, np.arange(N) // 20 % FOLDS


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("size", [0.0, 0.5, 2.0])
def test_what_other_folds_tell_is_predicted_and_nothing_else(seed: int, size: float):
    rows, z, fold = made(seed, size)
    said = rows.predicted(z, np.ones(N), fold, 0.01, 3e-4)
    gain = np.mean(z**2) - np.mean((z - said) ** 2)
    assert gain == pytest.approx(size**2, abs=0.02 + 0.05 * size**2)


@pytest.mark.parametrize("seed", range(3))
def test_what_few_samples_tell_foretells_nothing(seed: int):
    """Regressors with seldom but large values: plain least squares loses 0.5 to 40 times the
    innovations' own power on the seconds that it has not seen."""
    rng = np.random.default_rng(seed)
    rows = Regressors((rng.standard_t(1.2, (N, 40)),), 2, STEP_S, np.inf)
    z, fold = rng.standard_normal(N), np.arange(N) // 20 % FOLDS
    said = rows.predicted(z, np.ones(N), fold, 0.01, 3e-4)
    assert np.mean((z - said) ** 2) < 1.02 * np.mean(z**2)


def test_no_fold_is_predicted_from_itself():
    rows, z, fold = made(1, 1.0)
    other = z.copy()
    other[fold == 0] = 1e3
    said = [rows.predicted(x, np.ones(N), fold, 0.01, 3e-4) for x in (z, other)]
    np.testing.assert_array_equal(said[0][fold == 0], said[1][fold == 0])


def test_hats_add_up_to_one_in_every_run():
    times = [np.arange(n) * STEP_S for n in (300, 500)]
    rows = Regressors(tuple(np.zeros((len(t), 3)) for t in times), 1, STEP_S, np.inf)
    with_them = with_hats(rows, times)
    for run in with_them.runs:
        np.testing.assert_allclose(run[:, :-3].sum(axis=1), 1.0)
        assert (run[:, -3:] == 0.0).all()


def judged(effects: dict, *, runs: int = 1, protocol: str = "steps") -> Decision:
    """The names of logs of 20 s, before any veto."""
    logs = [foreign(protocol, seed=3 + i, effects=effects, duration_s=20.0) for i in range(runs)]
    nominal = NominalModel(RIG, load_friction=False)
    return decide(settled_baseline(evidence_of(*logs), nominal))


def complete(decision: Decision, output: str) -> float:
    keys = [(one.name, axis) for one in decision.accepted for axis in one.axes]
    return completeness(drop_effects(decision.state, keys), decision.state, output)


@pytest.mark.slow
def test_the_right_name_is_complete_and_its_size_a_constant():
    decision = judged({"camera_delay": {"xy": {"extra_s": 0.1}}})
    assert {one.name for one in decision.accepted} == {"camera_delay"}
    assert complete(decision, BALL) > 0.98
    assert not any(inconstancy(decision.state, one, BALL) for one in decision.accepted)


RIPPLE = {"amplitude_rad": 0.01, "phase_rad": 0.4, "periods_per_turn": 20.0}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("protocol", "effects"),
    [
        ("steps", {"transmission_ripple": {"x": RIPPLE}}),
        ("circle", {"transmission_ripple": {"x": RIPPLE}}),
        ("steps", {"joint_backlash": {"x": {"play_rad": 0.03}}}),
        ("steps", {"plate_bowl": {"xy": {"stiffness_1_s2": 1.0}}}),
    ],
)
def test_the_right_name_is_in_time(protocol: str, effects: dict):
    decision = judged(effects, protocol=protocol)
    assert {one.name for one in decision.accepted} == set(effects)
    assert not any(untimely(decision.state, one, BALL) for one in decision.accepted)


@pytest.mark.slow
def test_what_a_controller_answers_comes_before_its_answer():
    """Gusts of a fan, told as a function of the angles by which the controller holds against it."""
    columns, _, _ = WORLDS["fan"](1701)
    nominal = NominalModel(RIG, load_friction=False)
    found = name_effects(settled_baseline(evidence_of(Log.from_columns(columns)), nominal))
    ripple = [one for one in found.accepted if one.name == "transmission_ripple"]
    assert ripple
    assert "before its cause" in untimely(found.after, ripple[0], BALL)


def test_a_response_is_advanced_by_axis_and_run():
    logs = [foreign("steps", seed=i, effects={}, duration_s=5.0) for i in (1, 2)]
    state = released(evidence_of(*logs))
    t, run = state.evidence.times(BALL)
    axis = np.arange(len(t)) % 2
    line = 3.0 * t + 100.0 * run + 7.0 * axis
    for lead_s in LEADS_S:
        moved = _advanced(state, BALL, line, lead_s)
        last = np.array([t[run == r].max() for r in (0, 1)])[run]
        wanted = 3.0 * np.minimum(t + lead_s, last) + 100.0 * run + 7.0 * axis
        np.testing.assert_allclose(moved, wanted, rtol=0, atol=1e-9)


@pytest.mark.parametrize("friction_V", [0.05, 0.2])
def test_friction_that_is_constant_is_not_said_to_fall_with_speed(friction_V: float):
    """Cut by the measured speed, which shares the innovation's noise, it seems to."""
    effects = {"coulomb_friction": {"x": {"friction_V": friction_V}}}
    evidence = evidence_of(foreign("steps", seed=6, effects=effects, duration_s=20.0))
    state = released(evidence, ("coulomb_friction", "x"))
    state = refit(settle(state, ["servo_x"]), state.bounds(["servo_x"]))
    assert state.fit.setting["coulomb_friction.friction_V.x"] == pytest.approx(friction_V, abs=0.01)
    one = Accepted("coulomb_friction", ("x",), 100.0, ())
    assert inconstancy(state, one, "servo_x") == ""
    assert untimely(state, one, "servo_x") == ""


def test_a_constant_does_not_begin_before_its_cause(monkeypatch: pytest.MonkeyPatch):
    """Beside friction the response to an offset has edges, at which the residuals came first."""
    monkeypatch.setattr("calibration.gap.specification.is_certain", lambda falls: True)
    state = released(evidence_of(foreign("steps", seed=6, effects={}, duration_s=5.0)))
    for name, key, told in (
        ("voltage_offset", "offset_V", False),
        ("coulomb_friction", "friction_V", True),
    ):
        size = state.fit.setting | {f"{name}.{key}.x": 0.1}
        moved = replace(state, fit=replace(state.fit, setting=size))
        assert bool(untimely(moved, Accepted(name, ("x",), 100.0, ()), "servo_x")) == told


def drifting(level: str, seed: int) -> tuple[State, Accepted]:
    """40 s of a ball on an independent table whose level goes a straight or a random way of 5 mrad
    (RMS), which is explained by a drift alone."""
    rng, t = np.random.default_rng(seed), np.linspace(0.0, 1.0, 20000)
    way = t if level == "straight" else np.cumsum(rng.standard_normal(len(t)))
    push = 5.9 * 0.005 * (way - way[0]) / way.std()  # of a hollow ball, k g a rad
    columns = table_log(rng, {}, {}, {}, push=np.column_stack([push, np.zeros(len(push))]))
    evidence = evidence_of(without_columns(Log.from_columns(columns), "voltage"))
    one = Accepted("level_drift", ("x",), 100.0, ())
    state = released(evidence, ("level_drift", "x"))
    return refit(settle(state, [BALL]), state.bounds([BALL])), one


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("level", ["straight", "random"])
def test_a_trend_of_one_run_is_certain_where_it_is_straight(level: str, seed: int):
    state, one = drifting(level, seed)
    assert abs(state.fit.setting["level_drift.rate_rad_s.x"]) > 1e-4
    assert ("record another" in trend_of_one_run(state, one)) == (level == "random")


def test_one_in_a_hundred_random_walks_is_as_straight_as_a_drift_has_to_be():
    rng, n = np.random.default_rng(11), 800
    along = legvander(2.0 * (np.arange(n) + 0.5) / n - 1.0, TREND_ORDERS)
    walks = np.cumsum(rng.standard_normal((n, 20000)), axis=0)
    power = np.linalg.lstsq(along, walks)[0] ** 2 / (2.0 * np.arange(len(along.T)) + 1.0)[:, None]
    share = np.sqrt(power[2:].sum(axis=0) / power[1])
    assert 0.007 < np.mean(share < MAX_UNEVENNESS) < 0.013


@pytest.mark.slow
def test_a_trend_that_two_runs_have_is_certain():
    decision = judged({"level_drift": {"x": {"rate_rad_s": 0.0008}}}, runs=2)
    (drift,) = [one for one in decision.accepted if one.name == "level_drift"]
    assert inconstancy(decision.state, drift, BALL) == ""
    assert trend_of_one_run(decision.state, drift) == ""


@pytest.mark.parametrize(
    ("name", "kind", "output", "doubted"),
    [
        ("level_offset", "map", BALL, True),
        ("level_offset", "rhythm", BALL, False),
        ("level_offset", "map", "servo_x", False),
        ("rolling_resistance", "map", BALL, False),
        ("dead_zone", "speed", "servo_x", True),
        ("stribeck_friction", "speed", "servo_x", False),  # the rest of one law
        ("dead_zone", "speed", "servo_y", False),
        ("cogging", "speed", "servo_x", False),
        ("dead_zone", "map", "servo_x", False),
    ],
)
def test_a_part_of_what_is_left_without_a_name_is_not_certain(
    name: str, kind: str, output: str, doubted: bool
):
    state = released(evidence_of(foreign("steps", seed=6, duration_s=5.0)))
    left = UnnamedTerm(output, kind, 100.0, Discrepancy(), state)
    one = Accepted(name, ("x",), 100.0, ())
    acts_on = (BALL,) if one.name in ("level_offset", "rolling_resistance") else ("servo_x",)
    assert bool(part_of_what_is_left(one, acts_on, left)) == doubted
    assert not part_of_what_is_left(one, acts_on, None)


@pytest.mark.parametrize(
    ("name", "score", "falls", "doubted"),
    [
        ("plate_bowl", 25.0, 1.0, True),  # 0.3 of 100 may be what bounces leave
        ("plate_bowl", 40.0, 1.0, False),
        ("plate_bowl", 25.0, 0.0, False),
        ("coulomb_friction", 25.0, 1.0, False),  # of the servo
    ],
)
def test_a_small_name_on_the_ball_is_not_certain_beside_a_plate_that_falls_in_its_joint(
    name: str, score: float, falls: float, doubted: bool
):
    state = released(evidence_of(foreign("steps", seed=6, duration_s=5.0)))
    setting = {**state.fit.setting, f"joint_backlash.{FALL_KEY}.x": falls}
    state = replace(state, fit=replace(state.fit, setting=setting))
    joint = Accepted("joint_backlash", ("x",), 100.0, ())
    one = Accepted(name, ("xy",) if name == "plate_bowl" else ("x",), score, ())
    assert bool(misfit_of_a_fall(state, one, (joint, one))) == doubted
    assert not misfit_of_a_fall(state, joint, (joint, one))


@pytest.mark.slow
def test_what_stands_in_for_a_cable_is_incomplete():
    columns, _, _ = WORLDS["cable"](7)
    nominal = NominalModel(RIG, load_friction=False)
    decision = decide(settled_baseline(evidence_of(Log.from_columns(columns)), nominal))
    assert not decision.accepted or complete(decision, "servo_x") < MIN_COMPLETENESS


def test_the_thresholds_are_those_of_their_error_rate():
    assert pytest.approx(0.01) == 100 * FAMILY_P
    assert 0.0 < MAX_INCONSTANCY < 1.0


LATE = "servo_dead_time.delay_s.x"
LAG = "servo_lag.lag_s.x"


@pytest.mark.parametrize(
    ("dead_s", "lag_s", "doubted"),
    [
        (0.03, 0.0, False),
        (0.03, 0.02, False),
        (0.03, -0.004, False),  # within the tolerance, as a healthy servo may be
        (0.03, -0.005, False),  # at its end, and little of 30 ms
        (0.012, -0.005, True),
        (0.03, -0.03, True),
        (-0.006, 0.03, True),
        (-0.006, 0.003, False),
    ],
)
def test_a_servo_that_is_later_and_faster_at_once_answers_otherwise(
    dead_s: float, lag_s: float, doubted: bool, tmp_path: Path
):
    columns, file, _ = WORLDS["healthy_rc_servos"](1)
    (tmp_path / "rig.toml").write_text(file, "utf-8")
    rig = read_rig(tmp_path / "rig.toml")
    log = Log.from_columns(columns)
    state = released(evidence_of(log, rig=rig), ("servo_dead_time", "x"), rig=rig)
    setting = state.fit.setting | {LATE: dead_s, LAG: lag_s}
    state = replace(state, fit=replace(state.fit, setting=setting))
    one = Accepted("servo_dead_time", ("x",), 100.0, ())
    assert bool(another_response(state, one)) == doubted
    assert another_response(state, replace(one, name="angle_scale")) == ""


@pytest.mark.parametrize(
    ("delay_s", "faster_s", "doubted"),
    [
        (0.027, 0.0, False),
        (0.027, -0.003, False),  # 12 %, more than its tolerance of 10 %, but little of 27 ms
        (0.027, -0.018, True),
        (0.027, 0.018, False),
        (0.004, -0.002, False),  # half of the delay, but within the tolerance
    ],
)
def test_a_motor_that_is_later_and_faster_at_once_answers_otherwise(
    delay_s: float, faster_s: float, doubted: bool
):
    columns, _, _ = WORLDS["healthy_axis"](1)
    log = Log.from_columns(columns)
    state = released(evidence_of(log), ("input_delay", "x"))
    tau = ".time_constant_s.x"
    tau_s = state.nominal.parameters[tau].nominal
    setting = state.fit.setting | {"input_delay.delay_s.x": delay_s, tau: tau_s + faster_s}
    state = replace(state, fit=replace(state.fit, setting=setting))
    one = Accepted("input_delay", ("x",), 100.0, ())
    assert bool(another_response(state, one)) == doubted


@pytest.mark.parametrize(
    ("phases_rad", "std", "beside", "doubted"),
    [
        ((3.1,), 0.001, "rolling_resistance", True),
        ((-3.1,), 0.001, "rolling_resistance", True),
        ((3.1,), 0.00001, "rolling_resistance", False),  # known not to be pi
        ((2.2,), 0.001, "rolling_resistance", False),
        ((0.0,), 0.001, "rolling_resistance", False),  # it adds tilt about level
        ((3.1,), 0.001, "viscous_drag", False),  # by chance, 4 times in 100
        ((3.1, -3.1), 0.001, "viscous_drag", True),
        ((3.1, 0.0), 0.001, "viscous_drag", False),
        ((0.0, 0.0), 0.001, "viscous_drag", False),
        ((2.95, 3.1), 0.001, "viscous_drag", True),  # not known to be pi, but too near to it
        ((2.4, 3.1), 0.001, "viscous_drag", False),
        ((3.1, 3.1), 0.006, "viscous_drag", False),  # the phases are hardly known
    ],
)
def test_a_ripple_that_takes_tilt_away_about_level_is_no_certain_one(
    phases_rad: tuple[float, ...], std: float, beside: str, doubted: bool
):
    state = released(evidence_of(foreign("steps", seed=1, effects={}, duration_s=5.0)))
    setting, spread = dict(state.fit.setting), {}
    for axis, phase_rad in zip("xy", phases_rad, strict=False):
        along, across = (k.name for k in state.nominal.of("transmission_ripple", axis)[:2])
        setting |= {along: 0.02 * np.cos(phase_rad), across: 0.02 * np.sin(phase_rad)}
        spread[across] = Spread(std, 30, 30.0)
    state = replace(state, fit=replace(state.fit, setting=setting))
    ripple = Accepted("transmission_ripple", tuple("xy"[: len(phases_rad)]), 100.0, ())
    names = [ripple, Accepted(beside, ("xy",), 100.0, ())]
    assert bool(weaker_at_centre(state, ripple, names, spread)) == doubted
    assert weaker_at_centre(state, names[1], names, {}) == ""


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3934, 3935])
def test_an_elastic_belt_is_no_certain_name(seed: int, tmp_path: Path):
    columns, file, _ = WORLDS["elastic_belt"](seed)
    (tmp_path / "rig.toml").write_text(file, "utf-8")
    found = investigate([Log.from_columns(columns)], read_rig(tmp_path / "rig.toml"), quick=True)
    assert found.findings.verdict in ("unknown-effect", "undecided")
    assert all(one.probability <= 0.5 for one in found.findings.effects)
