"""What is drawn lies where it is said to lie, and the seed alone decides."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.blind import sizes
from experiments.blind.draws import ALL_EFFECTS, TrialPlan, _kinds, draw_trial, plan_trials
from experiments.blind.hidden_tables import KNOWN
from experiments.blind.trial import BlindTrial, from_plain, to_plain
from rig.effects import BY_NAME, check

PLAN = TrialPlan(40, 10, 7, protocols=("steps",))


@pytest.fixture(scope="module")
def trials() -> list[BlindTrial]:
    return plan_trials(PLAN)


def of_kind(kind: str, count: int = 30, effects: tuple[str, ...] = ALL_EFFECTS) -> list[BlindTrial]:
    plan = replace(PLAN, effects=effects)
    return [draw_trial(plan, number, kind) for number in range(1, count + 1)]


def test_the_seed_decides_and_the_order_hides_the_kinds(trials: list[BlindTrial]):
    assert plan_trials(PLAN) == trials
    assert plan_trials(replace(PLAN, seed=8)) != trials
    kinds = [trial.kind for trial in trials]
    assert kinds.count("nothing") == 10
    assert kinds.count("single") == 20
    assert kinds != sorted(kinds)
    assert len({trial.name for trial in trials}) == 50
    assert [from_plain(to_plain(trial)) for trial in trials] == trials


def test_the_rig_file_knows_nothing_of_what_is_hidden(trials: list[BlindTrial]):
    for trial in trials:
        known = set(trial.believed["effects"])
        assert known == (set(KNOWN) if trial.kind == "realistic" else set())
        assert not known & set(trial.hidden)
        for name, by_axis in trial.hidden.items():
            for axis, values in by_axis.items():
                assert trial.plant["effects"][name][axis] == values
        check(trial.plant["effects"])


@pytest.mark.parametrize("name", [n for n in ALL_EFFECTS if n != "saturation"])
def test_sizes_lie_between_1_5_and_6_times_the_smallest(name: str):
    first, rng = BY_NAME[name].parameters[0], np.random.default_rng(7)
    for _ in range(40):
        drawn, times = sizes.draw_effect(name, rng)
        for values in drawn.values():
            size = abs(values[first.key])
            assert 1.5 <= size / max(sizes.SMALLEST[name], BY_NAME[name].tolerance) <= 6.0
            assert size <= first.high
        assert 1.5 <= times <= 6.0
    weak = [sizes.draw_effect(name, rng, within=sizes.WEAK_FACTORS)[1] for _ in range(40)]
    assert 0.15 <= min(weak) < max(weak) <= 1.5


def test_a_saturation_lies_below_the_volts_used():
    for trial in of_kind("single", 3, ("saturation",)):
        for values in trial.hidden["saturation"].values():
            assert 0.2 < values["limit_V"] < 6 / 1.15


def test_imperfections_stay_inside_the_tolerances(trials: list[BlindTrial]):
    for trial in trials:
        if trial.kind != "nothing":
            continue
        for name, by_axis in trial.plant["effects"].items():
            key, tolerance = BY_NAME[name].parameters[0].key, BY_NAME[name].tolerance
            assert all(abs(values[key]) <= tolerance for values in by_axis.values())
        ratio = trial.plant["servo"]["gain_rad_s_V"] / trial.believed["servo"]["gain_rad_s_V"]
        assert abs(ratio - 1) < 0.05


def test_a_realistic_rig_file_errs_within_the_tolerances():
    for trial in of_kind("realistic", 12):
        for name in KNOWN:
            key = BY_NAME[name].parameters[0].key
            for axis, values in trial.believed["effects"][name].items():
                error = values[key] - trial.plant["effects"][name][axis][key]
                assert abs(error) <= BY_NAME[name].tolerance
        assert len(trial.hidden) == int(trial.variant.split()[0])


def test_other_shapes_are_other_and_pairs_can_be_told_apart():
    for trial in of_kind("shape"):
        (name, by_axis) = next(iter(trial.hidden.items()))
        for values in by_axis.values():
            if name == "dead_zone":
                assert abs(values["positive_V"] / values["negative_V"] - 1) > 0.3
            else:
                key, usual, _ = sizes.SHAPES[name]
                assert abs(values[key] / usual - 1) > 0.2
    for trial in of_kind("pair"):
        assert len(trial.hidden) == 2
        assert set(trial.hidden) != {"camera_yaw", "cross_coupling"}


def test_the_counts_add_up_and_mistakes_are_named():
    for hidden in (0, 1, 7, 100):
        assert len(_kinds(replace(PLAN, hidden=hidden))) == hidden
    with pytest.raises(ValueError, match="unknown effect 'dirt'"):
        plan_trials(replace(PLAN, effects=("dirt",)))
    with pytest.raises(ValueError, match="needs two effects"):
        plan_trials(replace(PLAN, effects=("dead_zone",), kinds=("pair",)))
    with pytest.raises(ValueError, match="unknown protocol 'nix'"):
        plan_trials(replace(PLAN, protocols=("nix",)))


def test_axes_of_a_cross_coupling_have_one_sign():
    rng = np.random.default_rng(0)
    for _ in range(40):
        values, _ = sizes.draw_effect("cross_coupling", rng)
        assert len({np.sign(v["fraction"]) for v in values.values()}) == 1
