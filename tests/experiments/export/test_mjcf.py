"""MuJoCo's XML of a table moves as our simulator does, and says what it leaves out."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from experiments.export.export_model import export_model
from experiments.export.mjcf.left_out import NOT_CARRIED
from experiments.export.mjcf.model import mjcf
from experiments.runs.assemble import load_rig
from rig.discrepancy import Discrepancy
from rig.effects import BY_NAME
from rig.parameters import Rig
from tests.support.exported_models import (
    MOST,
    Motion,
    apart,
    course,
    in_mujoco,
    ours,
    with_effects,
)
from tests.support.parts import needs

DEFAULT = load_rig(Path("default"))
THREE_ARMS = load_rig(Path("three-arms"))
BUS = load_rig(Path("bus-servos"))
SLOW_MOTORS = replace(BUS, servo=replace(BUS.servo, motor_lag_s=0.02, dead_band_rad=0.0))
START = (0.01, -0.02)
ENGINE = needs("mujoco")
# arms and plate [mrad], ball [mm]; of 2 s, twice what was measured (experiments/export/README.md)
TABLES = {
    "default": (DEFAULT, (0.15, 0.04, 0.12)),
    "ideal": (replace(DEFAULT, effects={}), (0.06, 0.012, 0.04)),
    "most effects": (with_effects(DEFAULT, MOST), (13.0, 2.5, 7.0)),
    "hobby-two-servos": (load_rig(Path("hobby-two-servos")), (2.0, 3.0, 2.2)),
    "bus-servos": (BUS, (1.0, 0.2, 0.2)),
    "slow motors": (SLOW_MOTORS, (0.26, 0.045, 0.2)),
    "three-arms": (THREE_ARMS, (6.0, 12.0, 10.0)),  # its steppers throw the plate across the play
    "three-arms without play": (replace(THREE_ARMS, effects={}), (6.0, 3.0, 1.5)),
}


@ENGINE
@pytest.mark.parametrize("name", TABLES)
def test_the_same_drive_gives_the_same_motion(name: str, tmp_path: Path):
    rig, (arm, plate, ball) = TABLES[name]
    driven = course(rig)
    own, found = ours(rig, driven, START), in_mujoco(rig, driven, tmp_path, START)
    difference = apart(own, found)
    assert np.ptp(own.ball, axis=0).min() > 0.01  # 10 mm and more: the course moves the ball
    assert difference["arm_mrad"] < arm
    assert difference["plate_mrad"] < plate
    assert difference["ball_mm"] < ball


@ENGINE
def test_play_that_was_left_out_would_be_seen(tmp_path: Path):
    """The tolerance of the default table is far below what its play does."""
    driven = course(DEFAULT)
    rigid = replace(DEFAULT, effects={k: v for k, v in DEFAULT.effects.items() if "lash" not in k})
    found = in_mujoco(DEFAULT, driven, tmp_path, START)
    difference = apart(ours(rigid, driven, START), found)
    _, (arm, plate, ball) = TABLES["default"]
    assert difference["arm_mrad"] > 20 * arm
    assert difference["plate_mrad"] > 20 * plate
    assert difference["ball_mm"] > 5 * ball


@ENGINE
def test_volts_arrive_late_by_the_delay(tmp_path: Path):
    """A step of volts delayed by 20 ms moves the arm as an undelayed one does 20 ms before."""
    late = with_effects(DEFAULT, {"input_delay": {"x": {"delay_s": 0.02}, "y": {"delay_s": 0.02}}})
    driven = np.full((100, 2), 2.0)
    on_time = in_mujoco(with_effects(DEFAULT), driven, tmp_path)
    delayed = in_mujoco(late, driven, tmp_path)
    assert isinstance(delayed, Motion)
    assert np.abs(delayed.arms[:9]).max() < 1e-6
    assert delayed.arms[20:] == pytest.approx(on_time.arms[10:-10], abs=2e-4)


def test_mujoco_is_not_needed_to_write_it(tmp_path: Path, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "mujoco", None)  # an import of it would fail
    told = export_model(DEFAULT, "default", "mjcf", tmp_path / "t.xml")
    text = (tmp_path / "t.xml").read_text()
    assert all(line in text for line in told)


@pytest.mark.parametrize("name", [*NOT_CARRIED, "unknown"])
def test_what_mujoco_lacks_is_said_in_the_file_and_aloud(name: str):
    rig = DEFAULT
    if name == "unknown":
        rig = replace(rig, unknown=Discrepancy(servo_map_x=(0.1, 0.0, 0.0, 0.0)))
    else:
        effect = BY_NAME[name]
        rig = with_effects(rig, {name: {effect.axes[0]: {effect.parameters[0].key: 0.001}}})
    text, told = mjcf(rig, "t")
    line = next(one for one in told if name in one)
    assert line in text.partition("-->")[0]


def test_every_effect_is_carried_or_said():
    """No effect changes neither the model nor what is told of it."""
    plain, said = mjcf(with_effects(DEFAULT), "t")
    values = {"delay_s": 0.004, "limit_V": 1.0, "play_rad": 0.01, "lag_s": 0.01}
    for name, effect in BY_NAME.items():
        if "voltage" not in effect.servos:
            continue
        key = effect.parameters[0].key
        one = {name: {effect.axes[0]: {key: values.get(key, 0.01)}}}
        text, told = mjcf(with_effects(DEFAULT, one), "t")
        assert text.partition("-->")[2] != plain.partition("-->")[2] or told != said, name


@pytest.mark.parametrize("name", ["hobby-two-servos", "three-arms"])
def test_every_effect_of_position_servos_is_carried_or_said(name: str):
    base: Rig = load_rig(Path(name))
    plain = mjcf(with_effects(base), "t")
    for effect in BY_NAME.values():
        if "position" not in effect.servos:
            continue
        one = {effect.name: {effect.axes[0]: {effect.parameters[0].key: 0.01}}}
        assert mjcf(with_effects(base, one), "t") != plain, effect.name


@pytest.mark.parametrize(
    ("kind", "file", "said"),
    [
        ("urdf", "t.xml", "--as urdf: must be mjcf or fmu"),
        ("mjcf", "t.fmu", "must end in .xml"),
        ("fmu", "t.xml", "must end in .fmu"),
        ("mjcf", "no/such/t.xml", "no such folder"),
    ],
)
def test_bad_input_is_one_line(kind: str, file: str, said: str, tmp_path: Path):
    with pytest.raises(ValueError, match=said):
        export_model(DEFAULT, "t", kind, tmp_path / file)


def test_intervals_have_no_place_in_the_xml(tmp_path: Path):
    with pytest.raises(ValueError, match="no place for intervals"):
        export_model(DEFAULT, "t", "mjcf", tmp_path / "t.xml", intervals=tmp_path / "gap.json")


def test_a_name_from_elsewhere_leaves_the_file_xml(tmp_path: Path):
    """A parser by the book takes neither control characters nor -- in a comment."""
    out = tmp_path / "t.xml"
    export_model(DEFAULT, 'a"><b>\x01--->\n<!---->\ud800', "mjcf", out)
    root = ElementTree.parse(out).getroot()
    assert root.get("model") == 'a"><b>?---> <!---->?'
    assert 'a"><b>?- - -> <!- - - ->?' in out.read_text(encoding="utf-8")
