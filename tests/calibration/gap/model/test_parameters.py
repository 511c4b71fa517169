"""A parameter changes the model exactly as a rig file with the same number would."""

from dataclasses import replace
from itertools import product
from math import cos, hypot, inf, sin
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.gap.model.parameters import BALL, INNER_SHAPE, PERIODIC, SERVO, NominalModel
from calibration.gap.model.state import outputs_of
from experiments.runs.assemble import load_rig
from rig.effects import BY_NAME, Effect, effects_of
from rig.linkage import Linkage
from rig.parameters import Rig, Servo
from rig.plant.plant_record import pack
from tests.support.gap.tables import RIG, evidence_of, foreign

TABLE = load_rig(None)  # plays, friction, offsets and a slope are nominal
NAMES = [effect.name for effect in effects_of("voltage")]
# What no equation of the predictor reads: derived for a simulated table, or split by sides. And how
# a plate moves in its play, which is tried beside it.
IDLE = ("arm_stick", "plate_stick", "camera_delay", "dead_zone_half_width_V", "joint_fall")
RIGS = {"bare": RIG, "shipped": TABLE}
KEYS = [(e, axis) for e in effects_of("voltage") for axis in e.axes]
# Sizes at which every first parameter must show in its own output.
SIZES = {"limit_V": 1.0, "extra_V": 0.1, "sine": 0.02}


def without_load(rig: Rig) -> Rig:
    return replace(rig, drive=replace(rig.drive, arm_friction_nm=0.0, joint_friction_nm=0.0))


def with_effect(rig: Rig, name: str, axis: str, pairs: dict[str, float]) -> Rig:
    effects = {n: {a: dict(p) for a, p in by.items()} for n, by in rig.effects.items()}
    effects.setdefault(name, {}).setdefault(axis, {}).update(pairs)
    return replace(rig, effects=effects)


def turned(name: str, axis: str, pairs: dict[str, float]) -> dict[str, float]:
    """The parameters' setting that means the same as `pairs` of a rig file."""
    parameters = dict(pairs)
    if name in PERIODIC:
        size, phase = parameters.pop(PERIODIC[name]), parameters.pop("phase_rad")
        parameters |= {"sine": size * cos(phase), "cosine": size * sin(phase)}
    return {f"{name}.{key}.{axis}": value for key, value in parameters.items()}


def assert_same(one: np.record, other: np.record) -> None:
    for field in one.dtype.names or ():
        if field in ("unknown", "own"):
            assert one[field] == other[field]
        elif field not in IDLE:
            np.testing.assert_allclose(
                one[field], other[field], rtol=1e-12, atol=1e-15, err_msg=field
            )


def drawn(data: st.DataObject, effect: Effect) -> dict[str, float]:
    """Values of all keys of an effect within their sensible ranges; a play holds its middle."""
    pairs = {p.key: data.draw(st.floats(p.low, p.high), label=p.key) for p in effect.parameters}
    if effect.name in PERIODIC:
        pairs[PERIODIC[effect.name]] += 1e-3  # without an amplitude a phase is nothing
        pairs["phase_rad"] *= 0.999  # one turn, once
    if "play_rad" in pairs:
        pairs["offset_rad"] = data.draw(st.floats(-0.49, 0.49)) * pairs["play_rad"]
    return pairs


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("which", RIGS)
@settings(max_examples=12)
@given(data=st.data())
def test_a_setting_is_the_rig_file_with_the_same_numbers(
    name: str, which: str, data: st.DataObject
):
    effect, rig = BY_NAME[name], RIGS[which]
    axis = data.draw(st.sampled_from(effect.axes))
    pairs = drawn(data, effect)
    model = NominalModel(rig, load_friction=False).model(turned(name, axis, pairs))
    assert_same(model.record, pack(with_effect(without_load(rig), name, axis, pairs)))
    assert model.gain_rad_s_V == (rig.servo.gain_rad_s_V,) * 2


@pytest.mark.parametrize("rig", [RIG, TABLE], ids=["bare", "shipped"])
def test_no_setting_and_all_parameters_at_rest_are_the_nominal_rig(rig: Rig):
    nominal = NominalModel(rig, load_friction=False)
    assert_same(nominal.model({}).record, pack(without_load(rig)))
    rest = {name: parameter.nominal for name, parameter in nominal.parameters.items()}
    assert_same(nominal.model(rest).record, pack(without_load(rig)))


def test_gain_and_time_constant_belong_to_their_axis():
    model = NominalModel(RIG, load_friction=False).model(
        {".gain_rad_s_V.y": 1.9, ".time_constant_s.x": 0.04}
    )
    assert model.gain_rad_s_V == (RIG.servo.gain_rad_s_V, 1.9)
    assert model.time_constant_s == (0.04, RIG.servo.time_constant_s)
    assert_same(model.record, pack(without_load(RIG)))


@pytest.mark.parametrize(("told_s", "moved_s"), [(0.02, 0.009), (0.008, 0.006)])
def test_of_a_motors_lag_what_the_file_tells_as_dead_time_is_lag(told_s: float, moved_s: float):
    """Of what both hold: a larger share would move no more, and a fit would stay where it is."""
    servo = Servo(kind="position", angle_measured=True, lag_s=0.04, dead_time_s=told_s)
    nominal = NominalModel(replace(RIG, servo=servo), load_friction=False)
    model = nominal.model({".motor_lag_s.y": 0.012, ".as_dead_time_1.y": 0.75})
    slower = {"motor_lag_s": 0.012, "lag_s": 0.04 + moved_s, "dead_time_s": told_s - moved_s}
    rig = replace(RIG, servo=replace(servo, y=slower))
    assert_same(model.record, NominalModel(rig, load_friction=False).model({}).record)


def test_under_load_the_friction_stays_and_the_joint_feels_its_wound_up_shaft():
    nominal = NominalModel(TABLE, load_friction=True)
    model = nominal.model({"joint_backlash.play_rad.x": 0.04}).record
    truth = pack(with_effect(TABLE, "joint_backlash", "x", {"play_rad": 0.04}))
    drive = TABLE.drive
    wound = 2 * drive.joint_friction_nm / drive.joint_stiffness_nm_rad
    assert model["joint_friction"] == truth["joint_friction"] > 0
    assert model["arm_friction"] == truth["arm_friction"] > 0
    width, true_width = (r["joint_1"] - r["joint_2"] for r in (model, truth))
    np.testing.assert_allclose(width - true_width, wound, rtol=1e-9)
    np.testing.assert_allclose(model["gear_1"], truth["gear_1"])


def test_every_key_has_its_parameter_and_starts_where_the_rig_file_has_it():
    nominal = NominalModel(TABLE, load_friction=False)
    for effect, axis in KEYS:
        keys = {parameter.key for parameter in nominal.of(effect.name, axis)}
        catalogue = {p.key for p in effect.parameters}
        if effect.name in PERIODIC:
            catalogue = catalogue - {PERIODIC[effect.name], "phase_rad"} | {"sine", "cosine"}
        catalogue |= set(INNER_SHAPE.get(effect.name, []))  # not in rig files
        assert keys == catalogue
    assert len(nominal.parameters) == 6 + sum(len(nominal.of(e.name, a)) for e, a in KEYS)
    for name, by_axis in TABLE.effects.items():
        for axis, pairs in by_axis.items():
            for key, value in pairs.items():
                assert nominal.parameters[f"{name}.{key}.{axis}"].nominal == value
    ripple = {"amplitude_rad": 0.01, "phase_rad": 0.7, "periods_per_turn": 9.0}
    rippled = NominalModel(
        with_effect(RIG, "transmission_ripple", "y", ripple), load_friction=False
    )
    parameters = [
        rippled.parameters[f"transmission_ripple.{k}.y"].nominal for k in ("sine", "cosine")
    ]
    assert hypot(*parameters) == pytest.approx(0.01)
    assert parameters[0] == pytest.approx(0.01 * cos(0.7))


def test_boxes_hold_the_nominal_value_and_lie_within_tolerance_and_range():
    for rig in (RIG, TABLE):
        for parameter in NominalModel(rig, load_friction=False).parameters.values():
            (low, high), (least, most) = parameter.box, parameter.range
            assert least <= low <= parameter.nominal <= high <= most, parameter.name
            assert parameter.nominal == inf or high - low <= 2.0001 * parameter.tolerance
            assert parameter.step > 0
    play = NominalModel(RIG, load_friction=False).parameters["joint_backlash.play_rad.x"]
    assert play.box == (0.0, BY_NAME["joint_backlash"].tolerance)  # a play has no negative side


def test_tolerances_are_the_catalogues_or_those_given():
    usual = NominalModel(RIG, load_friction=False)
    wide = NominalModel(RIG, load_friction=False, tolerances={"voltage_offset": 0.3})
    for effect, axis in KEYS:
        first, *rest = usual.of(effect.name, axis)
        assert first.tolerance == effect.tolerance or effect.name in PERIODIC
        assert all(parameter.tolerance == 0 for parameter in rest)
    assert wide.parameters["voltage_offset.offset_V.x"].box == (-0.3, 0.3)
    assert (
        wide.parameters["level_offset.slope_rad.x"] == usual.parameters["level_offset.slope_rad.x"]
    )
    setting = {"voltage_offset.offset_V.x": 0.1}
    assert usual.exceeds_minimum("voltage_offset", "x", setting)
    assert not usual.exceeds_minimum("voltage_offset", "y", setting)
    assert not wide.exceeds_minimum("voltage_offset", "x", setting)


def test_friction_that_a_file_tells_of_the_load_may_be_the_motors_where_it_is_refuted():
    told = replace(RIG, drive=replace(RIG.drive, joint_friction_nm=0.004, arm_friction_nm=0.006))
    usual = BY_NAME["coulomb_friction"].tolerance
    for rig, more_nm in ((RIG, 0.0), (told, 0.01)):
        friction = NominalModel(rig, load_friction=False).parameters[
            "coulomb_friction.friction_V.x"
        ]
        more_V = more_nm / rig.servo.torque_per_volt_nm
        assert friction.tolerance == pytest.approx(usual + more_V)


def test_of_twins_the_one_that_is_tried_may_have_what_all_of_them_may():
    """A servo beside its zero by its tolerance, and the plate off level by its own, is healthy."""
    tolerance = {name: effect.tolerance for name, effect in BY_NAME.items()}
    arm_m, lever_m = {"x": 0.02, "y": 0.03}, 0.1
    linkage = Linkage(plate_side_m=2 * lever_m, x={"arm_radius_m": 0.02}, y={"arm_radius_m": 0.03})
    rig = Rig(servo=Servo(kind="position"), linkage=linkage)
    told = NominalModel(rig, load_friction=False)
    for axis in "xy":
        size = told.parameters[f"level_offset.slope_rad.{axis}"].tolerance
        zero = arm_m[axis] / lever_m * tolerance["angle_zero"]
        assert size == pytest.approx(tolerance["level_offset"] + zero)
        assert told.tolerance("angle_scale", axis) == pytest.approx(
            tolerance["angle_scale"] + tolerance["camera_scale"]
        )
        assert told.tolerance("servo_lag", axis) == tolerance["servo_lag"]
    learned = NominalModel(rig, load_friction=False, tolerances={"level_offset": 0.001})
    assert learned.tolerance("level_offset", "x") == 0.001
    read_back = replace(rig, servo=replace(rig.servo, angle_measured=True))
    measured = NominalModel(read_back, load_friction=False)
    assert measured.tolerance("level_offset", "x") == tolerance["level_offset"]


def test_what_a_servo_between_command_and_angle_lacks_shows_where_its_angle_is_read():
    for measured, arms in product((True, False), (True, False)):
        rig = load_rig(Path("three-arms" if arms else "bus-servos"))
        rig = replace(rig, effects={}, servo=replace(rig.servo, angle_measured=measured))
        nominal = NominalModel(rig, load_friction=False)
        tried = {effect.name for effect in nominal.effects}
        assert ("angle_zero" in tried) == measured
        assert "servo_lag" in tried
        assert ("camera_delay" in tried) == measured
        for name in tried & {"servo_lag", "rate_limit", "angle_zero"}:
            own = ("servo_x",) if measured else (BALL,)
            if measured and arms and name != "angle_zero":  # each arm takes part in both tilts
                own = SERVO
            assert nominal.of(name, "x")[0].outputs == own
            assert outputs_of(nominal.catalogue[name], ("x",)) == own


def test_a_rate_limit_is_known_no_better_than_a_gain():
    rig = replace(load_rig(Path("bus-servos")), effects={})
    nominal = NominalModel(rig, load_friction=False)
    for share, beyond in ((0.96, False), (0.94, True)):
        setting = {"rate_limit.limit_rad_s.x": share * rig.servo.rate_limit_rad_s}
        assert nominal.exceeds_minimum("rate_limit", "x", setting) == beyond
    assert not nominal.exceeds_minimum("rate_limit", "x", {})


@pytest.fixture(scope="module")
def evidence():
    return evidence_of(foreign("steps", seed=2, duration_s=5.0))


@pytest.mark.parametrize(("effect", "axis"), KEYS, ids=lambda v: getattr(v, "name", v))
def test_a_parameter_is_felt_in_its_own_parts_alone(evidence, effect: Effect, axis: str):
    nominal = NominalModel(RIG, load_friction=False)
    first = nominal.of(effect.name, axis)[0]
    size = SIZES.get(first.key, first.nominal + 3 * first.step)
    model, bare = nominal.model({first.name: size}), nominal.model({})
    for output in (*SERVO, BALL):
        same = np.array_equal(evidence.roll(model, output).z, evidence.roll(bare, output).z)
        assert same == (output not in first.outputs), (output, first.outputs)
