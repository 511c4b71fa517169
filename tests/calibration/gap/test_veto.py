"""Names that data which were not fitted refute: the rule on plain numbers, and on a whole log."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calibration.gap import veto
from calibration.gap.decision_rule import DOUBTED_PROBABILITY, MIN_WINDOWS
from calibration.gap.findings import Findings
from calibration.gap.harm import _proven
from calibration.gap.held_out import Prediction, gained
from calibration.gap.investigation import investigate
from calibration.gap.model.intervals import Spread
from calibration.gap.model.parameters import NominalModel
from calibration.gap.model.state import State
from calibration.gap.name.decide import Decision, decide
from calibration.gap.name.load_friction import friction_models
from calibration.gap.name.stepwise import Accepted, Naming, settled_baseline
from calibration.gap.report.findings_of_decision import named
from calibration.gap.sizes import axes_with_size, faint, not_a_size
from calibration.gap.veto import _better, decide_by_proof, judge
from rig.log import Log
from rig.parameters import Drive, Rig
from tests.support.gap.tables import RIG, evidence_of, foreign, released
from tests.support.worlds import WORLDS
from tests.support.worlds.healthy import rubbing_joints

COUNT = 200


def errors(size: float, seed: int = 1, count: int = COUNT) -> Prediction:
    """Normal errors of this size."""
    drawn = size * np.random.default_rng(seed).standard_normal(count)
    return Prediction(drawn, np.zeros(1))


@pytest.mark.parametrize(("with_it", "sign"), [(0.5, 1), (1.0, 0), (2.0, -1)])
def test_the_gain_has_the_sign_of_what_falls(with_it: float, sign: int):
    base = errors(1.0)
    d, se = gained(base, replace(base, errors=with_it * base.errors))
    assert np.sign(d) == sign
    assert abs(d) >= 3.0 * se or sign == 0


def test_one_push_does_not_decide():
    base = errors(1.0)
    pushed = base.errors.copy()
    pushed[7] = 300.0
    better = replace(base, errors=np.append(0.5 * pushed[:7], [310.0, *(0.5 * pushed[8:])]))
    d, se = gained(replace(base, errors=pushed), better)
    assert d > 3.0 * se


def test_too_few_windows_say_nothing():
    few = errors(1.0, count=MIN_WINDOWS - 1)
    assert gained(few, replace(few, errors=9.0 * few.errors)) == (0.0, 0.0)


def test_where_no_log_lasts_a_second_the_model_that_costs_less_stands():
    """The mean of no error is no number: the first of two was taken, with a warning."""
    dear, cheap = (Prediction(np.zeros(0), np.array([cost])) for cost in (2.0, 1.0))
    assert dear.rms == np.inf
    assert _better({"ball": dear}, {"ball": cheap})["ball"] is cheap
    assert _better({"ball": cheap}, {"ball": dear})["ball"] is cheap


@pytest.mark.slow
def test_nothing_is_missing_where_all_names_do_harm_and_nothing_more_is_predictable():
    """A healthy axis that rests within encoder counts looks like Stribeck friction, sample by
    sample. On other logs of it nothing is certain: the test below."""
    columns, _, _ = WORLDS["healthy_axis"](4201)
    nominal = NominalModel(RIG, load_friction=False)
    decision = decide(settled_baseline(evidence_of(Log.from_columns(columns)), nominal))
    assert decision.accepted
    left, _, reasons = judge(decision)
    assert (left.verdict, left.accepted) == ("nothing-missing", ())
    assert [reason.split(":")[:2] for reason in reasons] == [
        ["not named", f" {one.name}"] for one in decision.accepted
    ]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [4200, 4202, 4205])
def test_no_name_of_a_healthy_axis_is_certain(seed: int):
    columns, _, _ = WORLDS["healthy_axis"](seed)
    nominal = NominalModel(RIG, load_friction=False)
    decision, _ = decide_by_proof(settled_baseline(evidence_of(Log.from_columns(columns)), nominal))
    assert decision.verdict in ("nothing-missing", "undecided")
    assert all(one.explained <= DOUBTED_PROBABILITY for one in decision.accepted)


def test_the_rig_files_friction_that_stiff_shafts_do_not_explain_is_not_certain(monkeypatch):
    """Beside a worn tooth, in a log of another engine, the friction was named with stiff shafts,
    too, on motors that feel no load, and for certain."""
    columns, _, _ = rubbing_joints(3600, seconds=4.0)
    evidence = evidence_of(Log.from_columns(columns))
    before = settled_baseline(evidence, friction_models(Rig())[-1])
    accepted = Accepted("coulomb_friction", ("x", "y"), 100.0, ())
    other = Accepted("camera_delay", ("xy",), 100.0, ())
    setting = {f"coulomb_friction.friction_V.{axis}": 0.18 for axis in "xy"}
    fit = replace(before.fit, setting=before.fit.setting | setting)
    named = replace(before, fit=fit, named=tuple(("coulomb_friction", axis) for axis in "xy"))
    naming = Naming(before, named, (accepted, other), (), (("", before),), [])
    found = Decision("named", naming, (accepted, other), None, named)
    coasting = replace(named, nominal=friction_models(Rig(drive=Drive(joint_friction_nm=0.0)))[1])
    assert coasting.nominal.coasts
    again = replace(found, state=coasting)
    asked = []

    def proved(state, tell):
        asked.append(state.nominal)
        return again if state.nominal.load_friction else found, ()

    monkeypatch.setattr(veto, "_proved", proved)
    decision, reasons = decide_by_proof(before)
    assert [nominal.load_friction for nominal in asked] == [False, True]
    assert [one.explained for one in decision.accepted] == [DOUBTED_PROBABILITY, 1.0]
    assert [reason.split(":")[:2] for reason in reasons] == [["not certain", " coulomb_friction"]]


@cache
def decision_on_a_late_camera() -> Decision:
    """A camera 0.1 s late; the delay itself is barred, so whatever is named imitates it."""
    log = foreign(
        "steps", seed=3, effects={"camera_delay": {"xy": {"extra_s": 0.1}}}, duration_s=20.0
    )
    nominal = NominalModel(RIG, load_friction=False)
    return decide(settled_baseline(evidence_of(log), nominal), barred=["camera_delay"])


@pytest.mark.slow
def test_what_imitates_a_delay_is_refuted_or_told_beside_an_unknown_effect():
    decision = decision_on_a_late_camera()
    judged, _, reasons = judge(decision)
    lost = {one.name for one in decision.accepted} - {one.name for one in judged.accepted}
    assert bool(lost) == bool(reasons)
    assert all(any(name in reason for reason in reasons) for name in lost)
    if not judged.accepted:
        assert judged.verdict in ("unknown-effect", "undecided")
        assert not judged.state.named
    else:
        assert judged.unnamed is not None


@pytest.mark.parametrize("delay_s", [0.1, pytest.param(0.25, marks=pytest.mark.slow)])
def test_a_delay_far_from_nominal_is_found_from_the_start(delay_s: float):
    """A search that begins near zero takes such a delay for a scale or for backlash."""
    log = foreign(
        "steps", seed=4, effects={"camera_delay": {"xy": {"extra_s": delay_s}}}, duration_s=20.0
    )
    found: Findings = investigate([log], RIG, until="add", quick=True).findings
    assert "camera_delay" in {one.name for one in found.effects}
    one = next(one for one in found.effects if one.name == "camera_delay")
    assert one.parameters["xy"]["extra_s"].value == pytest.approx(delay_s, rel=0.1)


COSTS = np.sin(np.arange(60.0))


@pytest.mark.parametrize(
    ("errors_times", "cost_falls", "proven"),
    [(0.5, 0.0, True), (0.999, 1.0, True), (0.999, 0.0, False), (1.001, 1.0, False)],
)
def test_what_is_certain_on_data_not_used(errors_times: float, cost_falls: float, proven: bool):
    """Far better 1 s ahead; a little, and clearly one sample ahead; a little alone; not at all."""
    base = replace(errors(1.0), costs=COSTS)
    others = np.roll(base.errors, COUNT // 2)  # as large, in other windows
    with_it = Prediction(errors_times * others, COSTS[::-1] - cost_falls)
    assert _proven(base, with_it) == proven


@cache
def with_friction() -> State:
    """A released, unfitted coulomb_friction of 0.1 V on x and of 0.5 V on y."""
    log = foreign("steps", seed=2, duration_s=6.0)
    state = released(evidence_of(log), ("coulomb_friction", "x"), ("coulomb_friction", "y"))
    sizes = {f"coulomb_friction.friction_V.{a}": v for a, v in (("x", 0.1), ("y", 0.5))}
    return replace(state, fit=replace(state.fit, setting=state.fit.setting | sizes))


@pytest.mark.parametrize(
    ("deviation_V", "no_size", "by_chance"),
    [(0.01, False, False), (0.04, False, True), (0.2, True, True)],
)
def test_a_size_counts_beyond_its_interval_and_is_certain_beyond_chance(
    deviation_V: float, no_size: bool, by_chance: bool
):
    one = Accepted("coulomb_friction", ("x",), 50.0, ())
    spread = {"coulomb_friction.friction_V.x": Spread(deviation_V, 40, 40.0)}
    assert bool(not_a_size(with_friction(), one, spread)) == no_size
    assert bool(faint(with_friction(), one, spread)) == by_chance


def test_an_axis_without_a_size_is_not_told_beside_one_that_has_it():
    one = Accepted("coulomb_friction", ("x", "y"), 50.0, ())
    state, all_axes = with_friction(), ("x", "y")
    for deviation_V, axes in ((0.01, all_axes), (0.2, ("y",)), (2.0, ())):
        spread = {f"coulomb_friction.friction_V.{a}": Spread(deviation_V, 40, 40.0) for a in "xy"}
        assert axes_with_size(state, one, spread) == axes
        assert bool(not_a_size(state, one, spread)) != bool(axes)
        decision = Decision("named", None, (one,), None, state)
        assert tuple(named(decision, one, spread).parameters) == (axes or all_axes)


def test_a_limit_that_is_no_longer_infinite_is_a_size():
    state, one = with_friction(), Accepted("saturation", ("x",), 50.0, ())
    cut = state.fit.setting | {"saturation.limit_V.x": 2.0}
    state = replace(state, fit=replace(state.fit, setting=cut))
    spread = {"saturation.limit_V.x": Spread(float("nan"), 40, 40.0)}
    assert not_a_size(state, one, spread) == faint(state, one, spread) == ""


@pytest.mark.parametrize(("share", "known"), [(0.1, True), (2.0, False)])
def test_a_limit_has_to_be_known_as_well_as_from_0_and_within_its_range(share: float, known: bool):
    """A servo that let go of its arm was told as a rate limit of 2.9 degrees/s, -66 to 71, the
    least of its range, at > 99 %: infinity less infinity is no number that a test sees."""
    state, one = with_friction(), Accepted("saturation", ("x",), 50.0, ())
    name = "saturation.limit_V.x"
    low = state.nominal.parameters[name].range[0]
    for limit, at_end in ((2.0, False), (low, True)):
        cut = replace(state, fit=replace(state.fit, setting=state.fit.setting | {name: limit}))
        spread = {name: Spread(share * limit, 40, 40.0)}
        assert bool(not_a_size(cut, one, spread)) == (at_end or not known)
        assert bool(faint(cut, one, spread)) != known


def test_a_size_at_the_end_of_its_range_on_one_axis_is_none():
    state, one = with_friction(), Accepted("coulomb_friction", ("x", "y"), 50.0, ())
    spread = {f"coulomb_friction.friction_V.{a}": Spread(1e-3, 40, 40.0) for a in "xy"}
    assert not_a_size(state, one, spread) == ""
    top = state.nominal.parameters["coulomb_friction.friction_V.y"].range[1]
    sizes = state.fit.setting | {"coulomb_friction.friction_V.y": top}
    at_end = replace(state, fit=replace(state.fit, setting=sizes))
    assert "end of its range" in not_a_size(at_end, one, spread)


@pytest.mark.parametrize(("cost", "certain"), [(-1.0, True), (1.0, False)])
def test_beside_a_refuted_name_that_predicts_better_none_is_certain(monkeypatch, cost, certain):
    """`cost`: of the refuted model above that of the name."""
    state = with_friction()
    first, later = (Decision("named", None, (), None, replace(state)) for _ in range(2))
    costs = {id(later.state): cost}
    monkeypatch.setattr(
        veto,
        "held_out",
        lambda s, outputs: {
            o: Prediction(np.ones(9), np.full(9, costs.get(id(s), 0.0))) for o in outputs
        },
    )
    later = replace(later, accepted=(Accepted("coulomb_friction", ("x",), 50.0, ()),))
    told, reasons = veto._beside_refuted(later, first)
    assert (told.accepted[0].probability > 0.9) == certain
    assert bool(reasons) != certain


@pytest.mark.parametrize("falls", [False, True])
def test_what_a_refuted_name_leaves_has_to_stand_without_it(monkeypatch, falls: bool):
    """A saturation is refuted at once; whether the friction falls, too, is asked without it."""
    friction, saturation = (
        Accepted(n, ("x",), 50.0, ()) for n in ("coulomb_friction", "saturation")
    )
    decision = Decision("named", None, (friction, saturation), None, with_friction())
    asked: list[set[str]] = []

    def refuted(one: Decision, tried: object):
        asked.append({name.name for name in one.accepted})
        gone = [name for name in one.accepted if name.name == "saturation"]
        gone = gone or list(one.accepted if falls else ())
        return gone, [], [f"not named: {name.name}" for name in gone]

    monkeypatch.setattr(veto, "_try", lambda decision: veto._Tried(None, {}, {}, {}, {}))
    monkeypatch.setattr(veto, "_refuted", refuted)
    monkeypatch.setattr(veto, "_doubted", lambda decision, tried: (list(decision.accepted), []))
    monkeypatch.setattr(
        veto,
        "_without",
        lambda decision, lost, all_harm: replace(
            decision, accepted=tuple(one for one in decision.accepted if one not in lost)
        ),
    )
    told, barred, reasons = judge(decision)
    assert asked == [{"coulomb_friction", "saturation"}, {"coulomb_friction"}]
    assert [one.name for one in told.accepted] == ([] if falls else ["coulomb_friction"])
    # The naming is repeated without what was refuted at once alone.
    assert barred == (["saturation"] if falls else [])
    assert len(reasons) == 1 + falls
