"""A homing is kept and believed for the same table and power-up only."""

import json
import re
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from math import inf, nan
from pathlib import Path
from types import SimpleNamespace

import pytest

from rig.hardware.homing.home import Homing
from rig.hardware.homing.homed import Homed, NotHomed, home_file, load, power_up
from rig.hardware.wiring import Wiring, file_wiring
from rig.parameters import Rig, Servo, TableChoice

RIG = Rig(table=TableChoice(kind="serial", port="/dev/ttyACM0"))
ODD = Wiring((1, 0), (1, -1), (-1, 1), (300, -20), crossed=True)
FOUND = Homing(ODD, (1.2, 1.1), (0.4, 0.5), level=(0.0, 0.0))


def homed(boot_id: str | None) -> Homed:
    return Homed.of(FOUND, RIG, boot_id)


def test_it_is_read_back_as_written(tmp_path: Path):
    path = home_file(tmp_path / "lab.toml")
    assert path.name == "lab.home.json"
    one = homed("id ab")
    one.save(path)
    assert load(path) == one


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"kind": "serial"}', "nonsense"])
def test_what_is_no_homing_is_refused_with_the_cure(tmp_path: Path, text: str):
    path = tmp_path / "rig.home.json"
    with pytest.raises(NotHomed, match=r"not been homed.*run rig home"):
        load(path)
    path.write_text(text)
    with pytest.raises(NotHomed, match=r"is no homing.*run rig home"):
        load(path)


def test_a_file_that_tells_the_channels_in_other_words_is_refused(tmp_path: Path):
    path = home_file(tmp_path / "lab.toml")
    homed("id ab").save(path)
    told = json.loads(path.read_text())
    told["wiring"]["swap"] = told["wiring"].pop("order") == [1, 0]
    path.write_text(json.dumps(told))
    with pytest.raises(NotHomed, match=r"is no homing.*run rig home"):
        load(path)


def test_one_damaged_bit_is_another_homing(tmp_path: Path):
    """Of 300 counts 700 are a digit's: the plate was levelled 35 degrees aside."""
    path = tmp_path / "rig.home.json"
    one = homed("id ab")
    one.save(path)
    content = path.read_bytes()
    kept = 0
    for bit in range(0, 8 * len(content), 5):
        bad = bytearray(content)
        bad[bit // 8] ^= 1 << bit % 8
        path.write_bytes(bad)
        with suppress(NotHomed):
            assert load(path) == one  # a blank between values
            kept += 1
    assert kept < 40  # of 760


def test_a_homing_of_an_earlier_version_has_no_checksum_and_is_read(tmp_path: Path):
    path = tmp_path / "rig.home.json"
    one = homed("id ab")
    one.save(path)
    told = json.loads(path.read_text())
    del told["checksum"]
    path.write_text(json.dumps(told))
    assert load(path) == one
    for key in ("voltage_limit_V", "breakaway_V"):  # which the first versions did not write
        del told[key]
    path.write_text(json.dumps(told))
    assert load(path).voltage_limit_V == inf


@pytest.mark.parametrize("left", [set(), {"order", "sign_volts", "sign_angle", "counts_per_rev"}])
def test_a_homing_that_leaves_out_what_a_channel_means_is_refused(tmp_path: Path, left: set):
    """Without a checksum an empty wiring was taken for signs and zeros that homing had found."""
    path = tmp_path / "rig.home.json"
    homed("id ab").save(path)
    told = json.loads(path.read_text())
    del told["checksum"]
    told["wiring"] = {key: value for key, value in told["wiring"].items() if key in left}
    path.write_text(json.dumps(told))
    with pytest.raises(NotHomed, match=r"wiring.c\w+ is missing.*run rig home"):
        load(path)


@pytest.mark.parametrize(
    ("key", "value", "why"),
    [
        ("sign_volts", [1], "2 servos have as many signs each"),
        ("sign_angle", [1, 1, -1], "2 servos have as many signs each"),
        ("zero_counts", ["far", 0], "wiring.zero_counts.0"),
        ("zero_counts", [1 << 31, 0], "wiring.zero_counts = [2147483648, 0]"),
        ("swap", True, "wiring.swap = True"),
        ("travel_rad", [1e308, 1.1], "travel_rad = (1e+308, 1.1) is no way between stops"),
        ("voltage_limit_V", nan, "voltage_limit_V = nan"),
        ("voltage_limit_V", -6.0, "voltage_limit_V = -6.0"),
        ("travel_rad", [1.2, 1.1, 1.0], "travel_rad or breakaway_V is not of 2 servos"),
        ("breakaway_V", [[0.1, 0.1]], "travel_rad or breakaway_V is not of 2 servos"),
        ("voltage_limits_V", 6.0, "voltage_limits_V = 6.0"),
    ],
)
def test_a_homing_without_a_checksum_is_refused_by_its_values(
    tmp_path: Path, key: str, value: object, why: str
):
    path = tmp_path / "rig.home.json"
    homed("id ab").save(path)
    told = json.loads(path.read_text())
    del told["checksum"]
    (told if key.endswith(("_V", "_rad")) else told["wiring"])[key] = value
    path.write_text(json.dumps(told))
    with pytest.raises(NotHomed, match=rf"{re.escape(why)}.*run rig home"):
        load(path)


@pytest.mark.parametrize("at", ["2026-11-22T10:00:00", "yesterday", ""])
def test_a_homing_whose_time_is_none_is_refused(tmp_path: Path, at: str):
    path = tmp_path / "rig.home.json"
    replace(homed("id ab"), at=at).save(path)
    with pytest.raises(NotHomed, match=r"is no homing.*run rig home"):
        load(path)


@pytest.mark.parametrize("travel", [nan, inf, -1.0, 0.0])
def test_a_way_between_stops_that_is_none_is_refused(tmp_path: Path, travel: float):
    path = tmp_path / "rig.home.json"
    replace(homed("id ab"), travel_rad=(1.1, travel)).save(path)
    with pytest.raises(NotHomed, match=r"is no homing.*run rig home"):
        load(path)


@pytest.mark.parametrize("volts", [nan, inf, -0.1])
def test_volts_that_move_no_arm_are_refused(tmp_path: Path, volts: float):
    path, moves = tmp_path / "rig.home.json", ((0.3, 0.1), (0.2, 0.0))
    replace(homed("id ab"), breakaway_V=moves).save(path)
    assert load(path).breakaway_V == moves
    assert Homed.of(replace(FOUND, breakaway_V=moves), RIG, "id ab").breakaway_V == moves
    replace(homed("id ab"), breakaway_V=((0.3, 0.1), (volts, 0.2))).save(path)
    with pytest.raises(NotHomed, match=r"is no homing.*run rig home"):
        load(path)


def test_limits_wider_than_at_the_homing_are_refused():
    """FOUND: 1.1 rad between the stops of one arm, at 6 V."""
    one = homed("id ab")
    for servo, say in (
        (replace(RIG.servo, angle_limit_rad=1.5), r"angle_limit_rad = 1.5 .* 0.55"),
        (replace(RIG.servo, angle_limit_rad=0.56), r"angle_limit_rad = 0.56"),
        (replace(RIG.servo, voltage_limit_V=24.0), r"voltage_limit_V = 24 .* 6"),
    ):
        with pytest.raises(NotHomed, match=say):
            one.check(replace(RIG, servo=servo), "id ab")
    one.check(replace(RIG, servo=replace(RIG.servo, angle_limit_rad=0.3)), "id ab")
    one.check(replace(RIG, servo=replace(RIG.servo, voltage_limit_V=3.0)), "id ab")


def test_another_table_another_power_up_another_encoder_are_refused():
    one = homed("id ab")
    one.check(RIG, "id ab")
    for other in ("id cd", None):
        with pytest.raises(NotHomed, match=r"off or reset .* another rig file: run rig home"):
            one.check(RIG, other)
    with pytest.raises(
        NotHomed, match="switched off or reset"
    ):  # of a version that compared clocks
        homed("up 10.000 at 1000.000").check(RIG, "id ab")
    assert power_up(SimpleNamespace(boot_id="ab")) == "id ab"  # pyright: ignore
    assert power_up(SimpleNamespace()) is None  # pyright: ignore
    elsewhere = replace(RIG, table=replace(RIG.table, port="/dev/ttyACM1"))
    with pytest.raises(NotHomed, match="another table"):
        one.check(elsewhere, "id ab")
    coarse = replace(RIG, servo=replace(RIG.servo, encoder_counts_per_rev=1024))
    with pytest.raises(NotHomed, match="counts_per_rev"):
        one.check(coarse, "id ab")


def test_other_pulses_than_at_the_homing_are_refused():
    """Level and direction would be others: 100 us are 0.16 rad."""
    rig = replace(RIG, table=replace(RIG.table, kind="pulses"), servo=Servo(kind="position"))
    one = Homed.of(FOUND, rig, "id absolute")
    one.check(rig, "id absolute")
    for changed in (
        {"pulse_range_us": (1000.0, 2200.0)},
        {"pulse_us_per_rad": (-637.0, 637.0)},
        {"pulse_us_per_rad": (637.0, 500.0)},
    ):
        other = replace(rig, table=replace(rig.table, **changed))
        with pytest.raises(NotHomed, match=r"another table .*run rig home"):
            one.check(other, "id absolute")


def test_another_amplifier_than_at_the_homing_is_refused():
    """A card homed behind an amplifier of 3, told 1, would put three times the volts on."""
    rig = replace(RIG, table=replace(RIG.table, kind="quanser", amplifier_gain=3.0))
    one = Homed.of(FOUND, rig, None)
    one.check(rig, None)
    with pytest.raises(NotHomed, match=r"another table .*amplifier gain 3.*run rig home"):
        one.check(replace(rig, table=replace(rig.table, amplifier_gain=1.0)), None)


def test_a_table_that_cannot_tell_is_believed_for_twelve_hours_and_inside_its_stops():
    one, now = homed(None), datetime.now(UTC)
    one.check(RIG, None, now + timedelta(hours=11))
    for late in (timedelta(hours=13), timedelta(hours=-1)):
        with pytest.raises(NotHomed, match="older than 12 hours"):
            one.check(RIG, None, now + late)
    one.check_angles((0.65, -0.6))
    for lost in ((0.75, 0.0), (0.0, -14.0), (float("nan"), 0.0)):
        with pytest.raises(NotHomed, match="beyond its stops"):
            one.check_angles(lost)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"swap": True}, "swap or sign_angle"),
        ({"sign_angle": (-1, 1)}, "swap or sign_angle"),
        ({"trim_rad": (0.1, 0.0)}, "trim_rad"),
    ],
)
def test_what_the_rig_file_alone_told_a_homing_may_not_change_after_it(change: dict, said: str):
    """Corrected by a person without a camera, it was not heeded, without a word."""
    table = TableChoice(kind="feetech", port="/dev/ttyUSB0")
    rig = Rig(servo=Servo(kind="position", angle_measured=True), table=table)
    after = replace(rig, table=replace(table, **change))
    told = Homing(file_wiring(rig), (3.0, 3.0), (0.0, 0.0))
    Homed.of(told, rig, "id ab").check(rig, "id ab")
    with pytest.raises(NotHomed, match=f"{said} has changed since the homing: run rig home"):
        Homed.of(told, rig, "id ab").check(after, "id ab")
    seen = replace(told, level=(0.0, 0.0))
    Homed.of(seen, rig, "id ab").check(after, "id ab")  # the markers told it


def test_the_trim_of_arms_that_volts_move_is_nothing():
    told = Homing(replace(file_wiring(RIG), zero_counts=(300, -20)), (1.2, 1.1), (0.4, 0.5))
    Homed.of(told, RIG, "id ab").check(RIG, "id ab")
