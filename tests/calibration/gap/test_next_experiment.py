"""The next experiment really tells two names apart, and says so only where it does."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.gap import next_experiment as nx
from calibration.gap.decision_rule import RIVAL_MARGIN
from experiments.gap.protocol_choices import experiment_menu
from experiments.runs.assemble import load_rig
from experiments.runs.protocol import course, read_protocol
from rig.parameters import Rig, Servo

TABLE = load_rig(None)
FRICTION = {"coulomb_friction": {"x": {"friction_V": 0.1}}}
DEAD_ZONE = {"dead_zone": {"x": {"half_width_V": 0.06}}}
PLAY = {"joint_backlash": {"x": {"play_rad": 0.04}}}
DELAY = {"camera_delay": {"xy": {"extra_s": 0.012}}}
DRAG = {"viscous_drag": {"xy": {"rate_1_s": 0.08}}}
ROLLING = {"rolling_resistance": {"xy": {"deceleration_m_s2": 0.006}}}
RIPPLE = {
    "transmission_ripple": {
        "x": {"amplitude_rad": 0.008, "phase_rad": 0.3, "periods_per_turn": 9.0}
    }
}
BENT = {"linkage_quadratic": {"x": {"coefficient_1_rad": 0.8}}}
PAIRS = [(FRICTION, DEAD_ZONE), (PLAY, DELAY), (DRAG, ROLLING), (RIPPLE, BENT)]


@pytest.mark.slow
@pytest.mark.parametrize(
    "pair",
    PAIRS,
    ids=lambda pair: " or ".join(next(iter(e)) for e in pair),
)
def test_the_proposal_tells_the_pair_apart_when_it_is_run(pair):
    plan = nx.propose(TABLE, pair, experiment_menu(TABLE))
    assert plan is not None
    assert plan.separates == tuple(next(iter(effects)) for effects in pair)
    assert plan.separation >= nx.CLEAR_SEPARATION
    protocol = read_protocol(plan.protocol)
    assert plan.seconds == protocol.duration_s + protocol.start.hold_s
    for own, other in (pair, pair[::-1]):  # other targets, pushes and noise than in the proposal
        way = course(protocol, TABLE, 71)
        run = nx.record(TABLE, own, way, np.random.default_rng(72))
        assert nx.separation(run.log, way, TABLE, own, other) > 2 * RIVAL_MARGIN


@pytest.mark.slow
def test_the_same_question_gives_the_same_answer():
    menu = [choice for choice in experiment_menu(TABLE) if choice[0] == "free-release"]
    first, again = (nx.propose(TABLE, (DRAG, ROLLING), menu, seed=3) for _ in range(2))
    assert first == again


def test_a_protocol_that_shows_neither_name_is_not_proposed():
    menu = [choice for choice in experiment_menu(TABLE) if choice[0] == "servo-squares"]
    (only,) = nx.prospects(TABLE, (DRAG, ROLLING), menu)  # nobody sees a ball
    assert only.separation == 0.0
    assert nx.propose(TABLE, (DRAG, ROLLING), menu) is None


def test_twins_get_no_experiment():
    level = {"level_offset": {"x": {"slope_rad": 0.004}}}
    menu = [choice for choice in experiment_menu(TABLE) if choice[0] == "free-release"]
    assert nx.propose(TABLE, (level, level), menu) is None


def test_a_protocol_beyond_the_rig_is_skipped_and_says_why():
    hill = {"plate_bowl": {"xy": {"stiffness_1_s2": -6.0}}}  # steeper than the controller
    weak = replace(TABLE, servo=replace(TABLE.servo, voltage_limit_V=0.3))
    menu = [c for c in experiment_menu(TABLE) if c[0] in ("free-release", "servo-squares")]
    held, free = nx.prospects(TABLE, (hill, ROLLING), menu)
    assert (held.protocol, held.cannot) == ("servo-squares", "")
    assert free.cannot == "ball lost"
    assert "limit of volts" in next(iter(nx.prospects(weak, (FRICTION, DEAD_ZONE), menu))).cannot
    assert nx.propose(TABLE, (hill, ROLLING), menu) is None


def test_the_shortest_clear_one_stands_first():
    some = [
        nx.Prospect("long", 60.0, 900.0, 800.0),
        nx.Prospect("none", 5.0, cannot="ball lost"),
        nx.Prospect("short", 20.0, 16.0, 40.0),
        nx.Prospect("dull", 10.0, 500.0, 4.0),
        nx.Prospect("better", 12.0, 12.0, 9.0),
    ]
    assert [one.protocol for one in nx.ranked(some)] == ["short", "long", "better", "dull", "none"]


def test_effects_join_those_that_are_nominal():
    both = nx.with_effects(TABLE, {"joint_backlash": {"x": {"offset_rad": 0.001}}})
    nominal = TABLE.effects["joint_backlash"]["x"]["play_rad"]
    assert both.effects["joint_backlash"]["x"] == {"play_rad": nominal, "offset_rad": 0.001}
    assert "offset_rad" not in TABLE.effects["joint_backlash"]["x"]
    with pytest.raises(ValueError, match="no effect 'moonlight'"):
        nx.propose(TABLE, ({"moonlight": {"x": {"lux": 1.0}}}, DRAG), experiment_menu(TABLE))


def test_the_menu_holds_what_the_rig_can_be_asked_for():
    names = [name for name, _, _ in experiment_menu(TABLE)]
    assert {"steps", "free-release", "servo-squares"} <= set(names)
    small = Rig(linkage=replace(TABLE.linkage, plate_side_m=0.1, arm_radius_m=0.01))
    assert "free-release" not in [name for name, _, _ in experiment_menu(small)]
    stiff = Rig(servo=Servo(angle_limit_rad=0.05))
    assert "servo-squares" not in [name for name, _, _ in experiment_menu(stiff)]
    assert {name for name, _, _ in experiment_menu(TABLE, ball=False)} == {"servo-squares"}
    one, other, *_ = (way.targets_m for name, way, _ in experiment_menu(TABLE) if name == "steps")
    assert not np.array_equal(one, other)
