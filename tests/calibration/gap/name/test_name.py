"""Hidden effects get their own names, on logs of a table that shares no code with the model."""

import re
from dataclasses import replace

import pytest

from calibration.gap.findings import Findings, Named
from calibration.gap.investigation import investigate
from calibration.gap.report.wording import _effect_words
from rig.effects import BY_NAME, effects_of
from rig.log import Log
from rig.rigfile import read_rig
from tests.support.gap.tables import RIG, foreign, foreign_table, without_columns
from tests.support.worlds import WORLDS

SECONDS = 20.0
Hidden = dict[str, dict[str, dict[str, float]]]
ONE: dict[str, Hidden] = {
    "coulomb_friction": {"coulomb_friction": {"x": {"friction_V": 0.08}}},
    "voltage_offset": {"voltage_offset": {"y": {"offset_V": 0.1}}},
    "input_delay": {"input_delay": {"x": {"delay_s": 0.006}}},
    "dead_zone": {"dead_zone": {"y": {"half_width_V": 0.06}}},
    "joint_backlash": {"joint_backlash": {"x": {"play_rad": 0.03}}},
    "level_offset": {"level_offset": {"y": {"slope_rad": 0.003}}},
    "camera_delay": {"camera_delay": {"xy": {"extra_s": 0.015}}},
    "rolling_resistance": {"rolling_resistance": {"xy": {"deceleration_m_s2": 0.012}}},
}
# The rest of the catalogue, of real size.
OTHERS: Hidden = {
    "stribeck_friction": {"x": {"extra_V": 0.3, "speed_rad_s": 0.15}},
    "gain_asymmetry": {"x": {"fraction": 0.1}},
    "viscous_asymmetry": {"y": {"fraction_1": 0.3}},
    "saturation": {"x": {"limit_V": 1.0}},
    "cogging": {"y": {"amplitude_V": 0.2, "periods_per_turn": 12.0}},
    "gain_drift": {"x": {"rate_1_s": 0.005}},
    "supply_sag": {"xy": {"drop_1_V": 0.04}},
    "gear_backlash": {"y": {"play_rad": 0.03}},
    "transmission_ripple": {"x": {"amplitude_rad": 0.02, "periods_per_turn": 12.0}},
    "linkage_quadratic": {"y": {"coefficient_1_rad": 0.8}},
    "linkage_cubic": {"x": {"coefficient_1_rad2": 4.0}},
    "cross_coupling": {"x": {"fraction": 0.15}},
    "level_drift": {"y": {"rate_rad_s": 5e-4}},
    "plate_bowl": {"xy": {"stiffness_1_s2": 2.0}},
    "viscous_drag": {"xy": {"rate_1_s": 0.5}},
    "camera_scale": {"xy": {"fraction": 0.1}},
    "camera_yaw": {"xy": {"angle_rad": 0.1}},
    "lens_distortion": {"xy": {"k1_1_m2": 5.0}},
}
USUAL = {"coulomb_friction", "joint_backlash", "camera_delay"}  # one of servo, shaft, camera
TURNED: Hidden = {"camera_yaw": {"xy": {"angle_rad": 0.05}}}
DRAG: Hidden = {"viscous_drag": {"xy": {"rate_1_s": 0.1}}}
LATE: Hidden = {"input_delay": {"x": {"delay_s": 0.008}}}
TWO = [("coulomb_friction", "rolling_resistance")]
TWINS = {
    "level_offset": {"encoder_zero", "asymmetric_play"},
    "camera_delay": {"delay_encoder_to_plate"},
}
STRANGERS = {"rhythm": 0.15, "bump": 0.008}


def answer(hidden: Hidden, seed: int = 3, stranger: str | None = None,
           seconds: float = SECONDS) -> Findings:  # fmt: skip
    odd = (stranger, STRANGERS[stranger]) if stranger else None
    log = foreign("steps", seed=seed, effects=hidden, stranger=odd, duration_s=seconds)
    return investigate([log], RIG, until="name", quick=True).findings


def by_name(found: Findings) -> dict[str, Named]:
    return {effect.name: effect for effect in found.effects}


def assert_named(found: Findings, hidden: Hidden) -> None:
    """Exactly these names on exactly these axes, at about these sizes, nothing left."""
    assert (found.verdict, found.unknown) == ("named", None), found.sentence
    named = by_name(found)
    assert set(named) == set(hidden)
    for name, by_axis in hidden.items():
        assert named[name].probability > 0.9
        assert set(named[name].parameters) == set(by_axis), name
        for axis, pairs in by_axis.items():
            for key, size in pairs.items():
                interval = named[name].parameters[axis][key]
                assert interval.value == pytest.approx(size, rel=0.15), (name, key)
                assert interval.low < interval.value < interval.high
        assert name in found.sentence


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n in USUAL else pytest.mark.slow) for n in ONE]
)
def test_one_hidden_effect_is_named_with_axis_size_twins_and_what_the_log_cannot_show(name: str):
    found = answer(ONE[name])
    assert_named(found, ONE[name])
    assert found.ranking[0].name == name
    axis = next(iter(ONE[name][name]))
    side = "servo" if BY_NAME[name].side == "servo" else "ball"
    channels = {where.channel for where in found.where}
    assert channels <= {f"{side}_{a}" for a in ("xy" if side == "ball" else axis)}
    twins = found.effects[0].twins
    assert set(twins) == TWINS.get(name, set())
    assert found.ranking[0].twins == twins
    missing = {u.name: u for u in found.untestable}
    assert 0 < missing["saturation"].smallest["limit_V"] < RIG.servo.voltage_limit_V
    assert not missing.keys() & {name, "coulomb_friction", "level_offset", "camera_delay"}


@pytest.mark.slow
@pytest.mark.slow
@pytest.mark.parametrize("name", OTHERS)
def test_every_other_effect_of_the_catalogue_is_named(name: str):
    found = answer({name: OTHERS[name]})
    assert list(by_name(found)) == [name], found.sentence
    assert set(found.effects[0].parameters) == set(OTHERS[name])


def test_the_catalogue_is_complete_here():
    assert {effect.name for effect in effects_of("voltage")} == {*ONE, *OTHERS}


@pytest.mark.parametrize("pair", TWO, ids=" and ".join)
def test_two_at_once_get_both_names_and_no_third(pair: tuple[str, str]):
    hidden = ONE[pair[0]] | ONE[pair[1]]
    assert_named(answer(hidden), hidden)


@pytest.mark.slow
def test_a_longer_delay_is_found_as_well_as_a_shorter_one():
    assert_named(answer(LATE), LATE)


@pytest.mark.parametrize(
    "seed", [10, *(pytest.param(n, marks=pytest.mark.slow) for n in range(11, 16))]
)
def test_nothing_hidden_gets_no_name(seed: int):
    found = answer({}, seed, seconds=15.0)
    assert found.verdict == "nothing-missing", found.sentence
    assert found.effects == ()
    assert found.unknown is None
    truth = foreign_table.hidden(effects={}, seed=seed, seconds=15.0)
    for i, axis in enumerate("xy"):
        gain = found.calibrated[f"gain_{axis}_rad_s_V"].value
        assert gain == pytest.approx(truth.gain[i], rel=0.015)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3])
def test_a_rhythm_has_no_name_but_a_frequency(seed: int):
    found = answer({}, seed, "rhythm")
    assert found.verdict == "unknown-effect", found.sentence
    assert found.effects == ()
    odd = foreign_table.hidden(
        effects={}, seed=seed, seconds=SECONDS, stranger=("rhythm", STRANGERS["rhythm"])
    ).odd
    assert found.unknown is not None
    assert found.unknown.channel == (
        "ball_x" if abs(odd.shake[0]) > abs(odd.shake[1]) else "ball_y"
    )
    told = re.search(r"rhythm of ([\d.]+) Hz", found.unknown.shape)
    assert told, found.unknown.shape
    assert float(told[1]) == pytest.approx(odd.shake_hz, abs=0.05)
    assert found.rig_after is not None
    assert found.rig_after.unknown.ball_rhythm_hz == pytest.approx(odd.shake_hz, abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3])
def test_a_bump_has_no_name_but_its_seconds(seed: int):
    found = answer({}, seed, "bump")
    assert found.verdict == "unknown-effect", found.sentence
    assert found.effects == ()
    odd = foreign_table.hidden(
        effects={}, seed=seed, seconds=SECONDS, stranger=("bump", STRANGERS["bump"])
    ).odd
    assert found.unknown is not None
    told = re.search(r"from ([\d.]+) to ([\d.]+) s", found.unknown.shape)
    assert told, found.unknown.shape
    begin, end = (float(text) for text in told.groups())
    assert found.unknown.channel == ("ball_x" if abs(odd.bump[0]) > abs(odd.bump[1]) else "ball_y")
    overlap = min(end, odd.bump_to) - max(begin, odd.bump_from)
    assert overlap > 0.75 * (max(end, odd.bump_to) - min(begin, odd.bump_from))


@pytest.mark.slow
def test_a_turned_camera_is_named_with_its_twin_beside_it():
    log = without_columns(foreign("steps", seed=3, effects=TURNED), "voltage")
    found = investigate([log], RIG, until="name").findings
    assert found.verdict == "named", found.sentence
    assert found.effects[0].twins == ("antisymmetric_cross_coupling",)


def test_probabilities_of_rivals_are_shares_of_one():
    """At a steady speed around a circle all that slows the ball looks alike."""
    log = foreign("circle", seed=3, duration_s=12.0, effects=DRAG)
    found = investigate([without_columns(log, "voltage")], RIG, until="name").findings
    assert found.verdict == "undecided"
    assert "viscous_drag" in by_name(found)
    assert sum(effect.probability for effect in found.effects) < 1.05


@pytest.mark.slow
def test_tolerances_of_the_rig_decide_what_is_missing_and_the_argument_goes_before_them():
    hidden = {"voltage_offset": {"y": {"offset_V": 0.08}}}
    log = foreign("steps", seed=7, duration_s=10.0, effects=hidden)
    log = without_columns(log, "ball", "target")
    loose = replace(RIG, tolerances={"voltage_offset": 0.1})
    for rig, tolerances, verdict in (
        (RIG, None, "named"),
        (loose, None, "nothing-missing"),
        (loose, {"voltage_offset": 0.02}, "named"),
    ):
        found = investigate([log], rig, until="name", tolerances=tolerances).findings
        assert found.verdict == verdict


@pytest.mark.slow
def test_a_healthy_servo_that_rests_between_its_moves_gets_no_name():
    found = investigate([foreign("squares", seed=7)], RIG, until="name").findings
    assert found.verdict == "nothing-missing", found.sentence


@pytest.mark.slow
def test_the_same_logs_give_the_same_answer_on_one_thread_and_on_two():
    log = foreign("steps", seed=3, duration_s=10.0, effects=ONE["voltage_offset"])
    answers = [investigate([log], RIG, until="name", threads=n).findings.to_json()
               for n in (1, 2)]  # fmt: skip
    assert answers[0] == answers[1]


def test_a_stage_that_is_none_is_refused():
    with pytest.raises(ValueError, match="known: locate, name, add, prove, next"):
        investigate([], RIG, until="guess")


@pytest.mark.slow
def test_a_limit_above_the_volts_that_last_is_told_untestable():
    log = foreign("corner", seed=70, duration_s=15.0)
    volts = abs(log["voltage_x_V"])
    assert volts.max() > 0.99 * RIG.servo.voltage_limit_V  # for a few ticks, at the release
    found = investigate([log], RIG, until="name", quick=True).findings
    told = {one.name: one for one in found.untestable}["saturation"]
    assert told.smallest["limit_V"] < 0.8 * volts.max()


def test_a_name_without_sizes_is_told_all_the_same():
    assert _effect_words(Named("dead_zone", 1.0, (), {"x": {}}), BY_NAME) == "dead_zone"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("world", "sizes"),
    [
        ("wide_dead_zone", {"dead_zone.half_width_V": 1.3}),
        (
            "asymmetric_viscous",
            {
                "coulomb_friction.friction_V": 0.58,
                "viscous_asymmetry.fraction_1": 0.26 * 0.69,
                "voltage_offset.offset_V": 0.09,
            },
        ),
    ],
)
def test_axes_of_another_generator_have_their_names_and_sizes(world: str, sizes: dict, tmp_path):
    """A dead zone of which the noise beside the wrong model is just below a tenth of a volt; and
    three frictions at once."""
    columns, rig, _ = WORLDS[world](1500)
    (tmp_path / "rig.toml").write_text(rig, encoding="utf-8")
    log = Log.from_columns(columns)
    found = investigate([log], read_rig(tmp_path / "rig.toml"), until="add", quick=True).findings
    assert {one.name for one in found.effects} == {name.split(".")[0] for name in sizes}
    for name, size in sizes.items():
        effect, key = name.split(".")
        one = by_name(found)[effect]
        assert one.probability > 0.9
        assert one.parameters["x"][key].value == pytest.approx(size, rel=0.02)


@pytest.mark.slow
def test_a_plate_that_falls_in_its_joint_is_play_and_not_a_bowl(tmp_path):
    """On a table without friction the ball's weight turns the plate to its own side, as a bowl does
    the other way about. Bounces that no log shows leave half of the size: the interval says so."""
    columns, rig, _ = WORLDS["falling_joint"](2102)
    (tmp_path / "rig.toml").write_text(rig, encoding="utf-8")
    log = Log.from_columns(columns)
    found = investigate([log], read_rig(tmp_path / "rig.toml"), until="add", quick=True).findings
    (one,) = found.effects
    assert (one.name, list(one.parameters)) == ("joint_backlash", ["x"])
    assert one.probability > 0.99
    play = one.parameters["x"]["play_rad"]
    assert play.low < 0.035 < play.high
    assert play.high < 0.06
