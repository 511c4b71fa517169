"""Where the model is wrong, in logs of a table that shares no code with the model."""

import re
from functools import cache

import numpy as np
import pytest

from calibration.gap.findings import Where
from calibration.gap.locate.channels import channel, present
from calibration.gap.locate.coordinates import by_run
from calibration.gap.locate.locate import NO_DEPARTURE, Located, locate, rms, sentence
from calibration.gap.model import data, parameters
from calibration.gap.model.state import State, with_levels
from calibration.gap.name import stepwise
from experiments.benchmark.engines.foreign.table import make_log
from rig.log import Log
from rig.parameters import CHANNELS, Rig
from rig.prediction import innovations

RIG = Rig()
SEED = 3
EFFECTS = {
    "joint_backlash": {"x": {"play_rad": 0.0436}},
    "dead_zone": {"x": {"half_width_V": 0.06}},
    "rolling_resistance": {"xy": {"deceleration_m_s2": 0.018}},
}
STRANGERS = {"rhythm": 0.15, "bump": 0.008, "dent": 0.05}


def test_the_sentence_tells_the_largest_gap():
    where = [Where("ball_x", "within 80 ms after the x servo reverses", 7.91)]
    assert sentence(where) == "ball x, within 80 ms after the x servo reverses: 7.9 times the noise"
    assert sentence([]) == NO_DEPARTURE


def state_of(columns: dict[str, np.ndarray], *more: dict[str, np.ndarray]) -> State:
    logs = [Log.from_columns(c) for c in (columns, *more)]
    runs = [data.usable(log, camera_delay_s=RIG.camera.delay_s) for log in logs]
    gathered = data.gather(runs, innovations.noise())
    return stepwise.settled_baseline(
        gathered, parameters.NominalModel(RIG, load_friction=False, coasts=False)
    )


def floors_of(state: State) -> dict[str, float]:
    there = [c for c in CHANNELS if present(state.evidence, c)]
    gaps = {c: channel(state, state.evidence, c, 1.0).gap for c in there}
    return {c: rms(g[np.isfinite(g)]) for c, g in gaps.items()}


@cache
def clean(seed: int, protocol: str = "steps") -> State:
    return state_of(make_log(protocol, seed=seed))


@cache
def hidden_log(what: str) -> dict[str, np.ndarray]:
    stranger = (what, STRANGERS[what]) if what in STRANGERS else None
    effects = {what: EFFECTS[what]} if what in EFFECTS else None
    return make_log("steps", seed=SEED, effects=effects, stranger=stranger)


@cache
def located_in(what: str) -> Located:
    return located(hidden_log(what))


def located(*columns: dict[str, np.ndarray]) -> Located:
    perfect = clean(SEED)
    state = state_of(*columns)
    final = state.evidence.with_levels(perfect.evidence.levels)
    floors = {c: f for c, f in floors_of(perfect).items() if present(state.evidence, c)}
    return locate(state, floors, evidence=final)


@pytest.mark.parametrize(
    ("what", "pattern"),
    [
        ("joint_backlash", r"ball x, .*after the x servo reverses"),
        ("dead_zone", r"servo x, at voltages below 0.\d V"),
        pytest.param(
            "rhythm", r"ball x, everywhere, with a rhythm of 1.6 Hz", marks=pytest.mark.slow
        ),
        ("bump", r"ball y, from (8.2|9.0) to (17.2|18.0) s"),
        pytest.param(
            "dent", r"ball y, where the ball is (on the plate )?at .* mm", marks=pytest.mark.slow
        ),
        pytest.param(
            "rolling_resistance",
            r"ball [xy], while the ball rolls .*against its motion",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_the_region_of_a_hidden_effect(what, pattern):
    found = located_in(what)
    assert re.match(pattern, found.sentence), found.sentence
    gaps = [w.gap for w in found.where]
    assert gaps == sorted(gaps, reverse=True)
    assert gaps[0] > 1.1
    assert {w.channel.split("_")[0] for w in found.where} == {found.sentence.split()[0]}


@pytest.mark.parametrize(
    "seed", [1, 2, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(3, 11))]
)
def test_nothing_hidden_nothing_stands_out(seed):
    state = clean(seed, ("steps", "pushed", "sweep", "circle", "corner")[seed % 5])
    found = locate(state, floors_of(state))
    assert found.sentence == NO_DEPARTURE, found.sentence
    assert not found.where


def mirrored(log: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The same table seen in a mirror that turns x around."""
    return {k: -v if k.startswith(("voltage_x", "theta_x", "ball_x", "target_x")) else v
            for k, v in log.items()}  # fmt: skip


def in_the_mirror(words: str) -> str:
    """A region with the places along x turned around."""
    words = re.sub(r"\bx between (-?\d+) and (-?\d+)",
                   lambda m: f"x between {-int(m[2])} and {-int(m[1])}", words)  # fmt: skip
    other = {"below": "above", "above": "below"}
    return re.sub(r"\bx (below|above) (-?\d+)", lambda m: f"x {other[m[1]]} {-int(m[2])}", words)


@pytest.mark.slow
def test_a_mirrored_log_has_mirrored_words():
    straight, turned = located_in("dent"), located(mirrored(hidden_log("dent")))
    assert any("x between" in where.region for where in straight.where)
    assert [in_the_mirror(w.region) for w in turned.where] == [w.region for w in straight.where]
    play = located(mirrored(hidden_log("joint_backlash")))
    assert play.sentence == located_in("joint_backlash").sentence


def test_profiles_and_map_hold_every_sample_that_is_used():
    found = located_in("dent")
    kinds = {(p.channel, p.quantity) for p in found.profiles}
    common = {"time", "position", "speed", "direction", "after reversal"}
    for c in CHANNELS:
        assert {q for n, q in kinds if n == c} == common | ({"voltage"} if "servo" in c else set())
    for p in found.profiles:
        assert len(p.edges) == len(p.gap) + 1 == len(p.count) + 1
        assert np.isfinite(p.edges).all()
        assert (np.diff(p.edges) > 0).all()
        assert np.isnan(p.gap[p.count < 8]).all()
    time = {p.channel: p for p in found.profiles if p.quantity == "time"}
    assert len(time["ball_y"].gap) == 40
    (place,) = found.maps
    assert place.mean.shape == (6, 6, 2)
    assert place.count.sum() == time["ball_x"].count.sum() > 500
    assert np.abs(place.mean[..., 1]).max() > 1.0


@pytest.mark.parametrize("starts", [[0.0], [0.0, 3.07], [0.0, 2.0, 2.02, 2.04, 9.99]])
def test_no_bin_of_time_spans_two_runs(starts):
    even = np.linspace(0.0, 10.0, 41)
    edges = by_run(even, np.array(starts))
    assert set(starts) | {10.0} <= set(edges)
    assert (np.diff(edges) > 0).all()
    assert np.diff(edges).max() < 1.6 * 0.25
    between = np.setdiff1d(edges, even)
    assert set(between) <= set(starts)


@pytest.mark.slow
def test_two_logs_and_missing_channels():
    log = hidden_log("bump")
    both = located(make_log("steps", seed=SEED), log)
    assert re.match(r"ball y, in log 2, from (8|9)\.\d to 1[678]\.\d s", both.sentence)
    over_time = [p for p in both.profiles if p.quantity == "time"]
    assert all(set(p.starts_s) - {0.0} < set(p.edges) for p in over_time)
    no_ball = {k: v for k, v in log.items() if not k.startswith(("ball", "target"))}
    found = located(no_ball)
    assert {p.channel for p in found.profiles} == {"servo_x", "servo_y"}
    assert found.maps == ()
    no_volts = {k: v for k, v in log.items() if not k.startswith("voltage")}
    found = located(no_volts)
    assert {p.channel for p in found.profiles} == {"ball_x", "ball_y"}
    assert found.sentence.startswith("ball y, from")


def test_a_floor_of_nothing_is_refused():
    with pytest.raises(ValueError, match="must be above 0"):
        locate(clean(SEED), {"ball_x": 0.0})


def test_without_the_final_levels_the_channel_is_still_right():
    state = state_of(hidden_log("dent"))
    same = with_levels(state, state.evidence.levels, state.evidence.outputs)
    found = locate(same, floors_of(clean(SEED)))
    assert {w.channel for w in found.where} == {"ball_x", "ball_y"}
