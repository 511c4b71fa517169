"""rig.toml: defaults, round trip, and one clear line for every mistake."""

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.runs.assemble import load_rig
from rig.effects import effects_of
from rig.parameters import Rig
from rig.rigfile import changes, from_dict, read_rig, refuse_own, to_dict, write_rig
from tests.support.srv02 import nominal_servo


def test_an_empty_file_is_the_default_rig(tmp_path: Path):
    path = tmp_path / "rig.toml"
    path.write_text("")
    assert read_rig(path) == Rig()


def test_the_contract_file_is_read_as_written(tmp_path: Path):
    path = tmp_path / "rig.toml"
    path.write_text(
        "[servo]\ngain_rad_s_V = 1.6\ntime_constant_s = 0.03\nencoder_counts_per_rev = 2048\n"
        "voltage_limit_V = 5.0\n[linkage]\narm_radius_m = 0.02\nplate_side_m = 0.3\n"
        "[ball]\nradius_m = 0.02\nmass_kg = 0.1\nhollow = false\n"
        "[camera]\nrate_hz = 30.0\ndelay_s = 0.02\nnoise_m = 0.001\n"
        "[effects.joint_backlash]\nx.play_rad = 0.035\ny.play_rad = 0.020\n"
    )
    rig = read_rig(path)
    assert rig.servo.gain_rad_s_V == 1.6
    assert rig.servo.encoder_counts_per_rev == 2048
    assert rig.linkage.plate_side_m == 0.3
    assert rig.ball.rolling_factor == pytest.approx(5 / 7)
    assert rig.camera.rate_hz == 30.0
    assert rig.effects["joint_backlash"]["y"]["play_rad"] == 0.020


def test_default_servo_is_the_manuals():
    gain, tau = nominal_servo()
    assert gain == pytest.approx(Rig().servo.gain_rad_s_V, rel=0.005)
    assert tau == pytest.approx(Rig().servo.time_constant_s, rel=0.01)


@given(st.floats(0.5, 3), st.floats(0.02, 0.1), st.booleans(), st.floats(0, 0.09))
def test_round_trip(gain: float, tau: float, hollow: bool, play: float):
    rig = from_dict(
        {
            "servo": {"gain_rad_s_V": gain, "time_constant_s": tau},
            "ball": {"hollow": hollow},
            "effects": {"gear_backlash": {"x": {"play_rad": play}}},
        }
    )
    assert from_dict(to_dict(rig)) == rig


def test_the_shipped_table_survives_writing(tmp_path: Path):
    rig = load_rig(None)
    write_rig(rig, tmp_path / "rig.toml")
    assert read_rig(tmp_path / "rig.toml") == rig
    write_rig(rig, f"{tmp_path}/named.toml")  # a path may be a string
    assert read_rig(f"{tmp_path}/named.toml") == rig


@pytest.mark.parametrize(("rate_hz", "camera_hz"), [(50, 50.0), (60, 60.0), (1000, 60.0)])
def test_a_camera_of_which_nothing_is_said_gives_a_slow_loop_a_frame_a_tick(
    rate_hz: int, camera_hz: float, tmp_path: Path
):
    path = tmp_path / "rig.toml"
    path.write_text(f"control_rate_hz = {rate_hz}\n[camera]\ndelay_s = 0.02\n")
    assert read_rig(path).camera.rate_hz == camera_hz


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[servo]\ngain = 1.5", ["servo.gain", "known", "gain_rad_s_V"]),
        ("[motor]\nx = 1", ["unknown key 'motor'", "servo"]),
        ("plate_side_m = 0.1", ["unknown key 'plate_side_m'", "it belongs in [linkage]"]),
        ("[servo]\nmass_kg = 0.1", ["unknown key 'servo.mass_kg'", "it belongs in [ball]"]),
        ("[gear_backlash]\nx.play_rad = 0.1", ["belongs in [effects.gear_backlash]"]),
        ("[linkage]\nplate_side_m = 0", ["plate_side_m = 0", "greater than 0.0001 m"]),
        ("[servo]\nrate_limit_rad_s = -1", ["rate_limit_rad_s = -1", "greater than 0 rad/s"]),
        ("[servo]\ngain_rad_s_V = -1", ["gain_rad_s_V = -1", "greater than 0 rad/s/V"]),
        ("[ball]\nradius_m = 0.2", ["radius_m", "0.1375", "does not fit"]),
        ("[ball]\nradius_m = -0.01", ["ball.radius_m = -0.01", "greater than 0"]),
        ("[ball]\nradius_m = 1e-300", ["ball.radius_m = 1e-300", "greater than 0.0001"]),
        ("[ball]\nmass_kg = true", ["ball.mass_kg", "number"]),
        ("[ball]\nmass_kg = '0.1'", ["ball.mass_kg = '0.1'", "number"]),
        ("[servo]\ngain_rad_s_V = 'fast'", ["servo.gain_rad_s_V", "number"]),
        ("[servo]\ngain_rad_s_V = nan", ["gain_rad_s_V", "finite"]),
        ("[servo]\ntachometer_scale = inf", ["servo.tachometer_scale", "finite"]),
        ("[servo]\nencoder_counts_per_rev = 0", ["encoder_counts_per_rev = 0", "greater than 0"]),
        ("[linkage]\nplate_side_m = 275", ["plate_side_m = 275", "less than or equal to 5 m"]),
        ("[linkage]\ny.arm_radius_m = 25", ["linkage.y.arm_radius_m = 25", "equal to 5 m"]),
        ("[ball]\nmass_kg = 12.0", ["ball.mass_kg = 12.0", "less than or equal to 10 kg"]),
        ("[camera]\ndelay_s = 12", ["camera.delay_s = 12", "less than or equal to 10 s"]),
        ("[servo]\ntime_constant_s = 25", ["servo.time_constant_s = 25", "equal to 10 s"]),
        ("[camera]\ndropout = 1.5", ["camera.dropout = 1.5", "less than or equal to 1"]),
        ("[play]\ngear_x_rad = -0.1", ["play.gear_x_rad = -0.1", "greater than or equal to 0"]),
        ("[servo]\ntime_constant_s = 0.0001", ["time_constant_s", "inertia"]),
        ("[linkage]\narm_radius_m = 0.2", ["arm_radius_m", "upright"]),
        ("[effects.backlash]\nx.play_rad = 1", ["unknown effect", "gear_backlash"]),
        ("[effects.joint_backlash]\nz.play_rad = 1", ["no axis 'z'", "x, y"]),
        ("[effects.joint_backlash]\nx.width = 1", ["no key 'width'", "play_rad"]),
        ("[effects.joint_backlash]\nplay_rad = 1", ["[effects.joint_backlash] x.play_rad"]),
        ("[effects.joint_backlash]\nx.play_rad = -1", [">= 0"]),
        ("control_rate_hz = 50\n[camera]\nrate_hz = 60", ["camera.rate_hz = 60 is above"]),
        ("control_rate_hz = 1", ["control_rate_hz", "10 to 5000"]),
        ("[servo", ["not a TOML file"]),
        ("[table]\nkind = 'board'", ["table.kind = 'board'", "quanser"]),
        ("[table]\nprt = 'COM3'", ["unknown key 'table.prt'", "port"]),
        ("[table]\nkind = 'serial'", ["needs table.port"]),
        ("[table]\nkind = 'remote'\naddress = 'a:1'", ["needs table.token_file"]),
        ("[table]\nsign_volts = [1, 0]", ["table.sign_volts = [1, 0]", "1 or -1"]),
        ("[table]\nsign_angle = [1]", ["table.sign_angle"]),
        ("[table]\namplifier_gain = 30", ["amplifier_gain = 30", "1, 3"]),
        ("[table]\nbaud = 9", ["table.baud = 9"]),
        ("[table]\nbaud = '9600'", ["table.baud = '9600'", "integer"]),
        ("[table]\nids = [true, 2]", ["table.ids.0 = True", "integer"]),
        ("[table]\nswap = 'yes'", ["table.swap = 'yes'", "boolean"]),
        ("[table]\nport = 1979-05-27", ["table.port", "string"]),
        ("[table]\ncamera = '0'", ["needs table.calibration"]),
    ],
)
def test_a_mistake_is_one_clear_line(tmp_path: Path, text: str, words: list[str]):
    path = tmp_path / "rig.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"rig\.toml") as caught:
        read_rig(path)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.parametrize("kind", ["voltage", "position"])
def test_every_catalogue_entry_can_be_switched_on_in_a_file(kind, tmp_path: Path):
    lines = ["[servo]", f"kind = '{kind}'"]
    for effect in effects_of(kind):
        lines.append(f"[effects.{effect.name}]")
        lines += [f"{axis}.{p.key} = {p.high}" for axis in effect.axes for p in effect.parameters]
    path = tmp_path / "rig.toml"
    path.write_text("\n".join(lines))
    assert set(read_rig(path).effects) == {effect.name for effect in effects_of(kind)}


def test_files_named_in_the_table_section_lie_beside_the_rig_file(tmp_path: Path):
    path = tmp_path / "rig.toml"
    path.write_text(
        "[table]\nkind = 'remote'\naddress = 'lab:7643'\ntoken_file = 'lab.token'\n"
        "camera = '0'\ncalibration = '/cal/calibration.json'\nsign_angle = [1, -1]\n"
    )
    table = read_rig(path).table
    assert table.token_file == str(tmp_path / "lab.token")
    assert table.calibration == "/cal/calibration.json"
    assert table.camera == "0"
    assert table.sign_angle == (1, -1)
    write_rig(read_rig(path), tmp_path / "again.toml")
    assert read_rig(tmp_path / "again.toml") == read_rig(path)


@pytest.mark.parametrize("file", ["mine.py", "/cameras/mine.py"])
def test_a_camera_of_ones_own_lies_beside_the_rig_file(tmp_path: Path, file: str):
    path = tmp_path / "lab.toml"
    path.write_text(
        "[table]\nkind = 'serial'\nport = 'a'\ncalibration = 'c.json'\n"
        f"camera = '{file}:MyCamera'\n"
    )
    assert read_rig(path).table.camera == f"{tmp_path / file}:MyCamera"


def test_stops_before_the_angle_limit_are_refused_and_never_assumed(tmp_path: Path):
    path = tmp_path / "lab.toml"
    path.write_text("[servo]\nangle_limit_rad = 0.5\nstop_rad = 0.4\n")
    told = r"stop_rad = 0\.4 is below servo\.angle_limit_rad = 0\.5: "
    with pytest.raises(ValueError, match=told):
        read_rig(path)
    path.write_text("servo.kind = 'position'\nservo.angle_limit_rad = 1.1\n")
    assert read_rig(path).servo.stop_rad == 1.1
    recorded = {"servo": {"angle_limit_rad": 0.5, "stop_rad": 0.4}}  # stays readable
    assert from_dict(recorded).servo.stop_rad == 0.4


ARMS = """
[servo]
kind = "position"
angle_limit_rad = {limit}
stop_rad = 1.2
[linkage]
kind = "three-arms"
arm_radius_m = 0.05
rod_length_m = {rod}
base_radius_m = 0.08
plate_radius_m = 0.1
height_m = 0.11
"""


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[servo]\nkind = 'angle'", "servo.kind = 'angle': .*'voltage' or 'position'"),
        (
            "[servo]\nkind = 'position'\nrate_limit_rad_s = 0",
            "servo.rate_limit_rad_s = 0: .*than 0",
        ),
        ("[servo]\nkind = 'position'\nx.lag = 0.1", "unknown key 'servo.x.lag'; known: lag_s"),
        ("[servo]\nkind = 'position'\ny.lag_s = -1", "servo.y.lag_s = -1: .*or equal to 0"),
        ("[servo]\nkind = 'position'\nx = 0.1", r"servo.x = 0.1: write servo.x.KEY = number"),
        ("[servo]\nx.lag_s = 0.1", "servo.x and servo.y need servo.kind = 'position'"),
        ("[servo]\nvoltage_limit_V = 6000.0", "voltage_limit_V = 6000.0: .*equal to 100 V"),
        ("[servo]\nangle_limit_rad = 1e300", "angle_limit_rad = 1e.300: .*equal to 10 rad"),
        ("[servo]\nstop_rad = 30.0", "stop_rad = 30.0: .*equal to 10 rad"),
        ("[linkage]\nz.rod_length_m = 0.1", "unknown key 'linkage.z'"),
        ("[linkage]\nrod_length_m = 0.1", "linkage.rod_length_m .*needs servos that take an angle"),
        ("[linkage]\nkind = 'three-arms'", "linkage.kind .*needs servos that take an angle"),
        ("[linkage]\nx.plate_side_m = 0.03", "the ball does not fit on the plate"),
        (
            "[servo]\nkind = 'position'\n[effects.coulomb_friction]\nx.friction_V = 0.1",
            "'coulomb_friction' is not one of position servos; known: servo_lag",
        ),
        (
            "[effects.servo_lag]\nx.lag_s = 0.1",
            "'servo_lag' is not one of voltage servos; known: coulomb_friction",
        ),
        (
            "[servo]\nkind = 'position'\nangle_limit_rad = 1.5\n[linkage]\nrod_length_m = 0.01",
            r"linkage.rod_length_m = 0.01 reaches 0\.\d+ rad of the servo, servo.angle_limit_rad",
        ),
        (ARMS.format(limit=0.5, rod=0.1), r"out of the three arms' reach \(both tilts .* 0\.2"),
        (ARMS.format(limit=0.2, rod=0.01), "linkage.height_m = 0.11 is out of reach or singular"),
        (ARMS.format(limit=0.9, rod=0.1), "servo.angle_limit_rad = 0.9 is the tilt of a plate"),
    ],
)
def test_what_a_table_with_position_servos_cannot_be_is_one_line(text, said, tmp_path: Path):
    path = tmp_path / "rig.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=said) as error:
        read_rig(path)
    assert "\n" not in str(error.value)


def test_values_by_axis_and_a_table_with_three_arms_come_back(tmp_path: Path):
    path, again = tmp_path / "rig.toml", tmp_path / "again.toml"
    path.write_text("[servo]\nkind = 'position'\nx.lag_s = 0.066\n[linkage]\ny.plate_side_m = 0.3")
    rig = read_rig(path)
    assert rig.servo.pair("lag_s") == (0.066, 0.05)
    assert rig.servo.on("x").lag_s == 0.066
    assert rig.linkage.half_sides_m == (0.1375, 0.15)
    assert rig.linkage.side_m == 0.3
    assert rig.linkage.ratios == (2 * 0.0254 / 0.275, 2 * 0.0254 / 0.3)
    write_rig(rig, again)
    assert read_rig(again) == rig
    path.write_text(ARMS.format(limit=0.2, rod=0.1))
    write_rig(read_rig(path), again)
    assert read_rig(again) == read_rig(path)
    assert read_rig(path).linkage.ratio == 1.0


def test_a_rig_file_of_ones_own_is_told_from_one_that_was_made(tmp_path: Path):
    own = tmp_path / "rig.toml"
    refuse_own(own)  # none is there
    write_rig(replace(Rig(), effects={"joint_backlash": {"x": {"play_rad": 0.04}}}), own)
    refuse_own(own)
    own.write_text(own.read_text().partition("\n")[2])  # as an earlier version wrote it
    refuse_own(own)
    own.write_text('# measured by hand in March\n[servo]\nkind = "voltage"\n')
    with pytest.raises(ValueError, match=r"rig\.toml: a rig file of yours"):
        refuse_own(own)


def test_what_differs_is_told_a_line_a_key():
    before = Rig(effects={"dead_zone": {"x": {"half_width_V": 0.1}}})
    after = replace(
        before,
        servo=replace(before.servo, gain_rad_s_V=1.71951234),
        effects={"joint_backlash": {"x": {"play_rad": 0.04}}},
        table=replace(before.table, camera="http://me:secret@camera", calibration="c.json"),
    )
    lines = changes(before, after)
    assert "servo.gain_rad_s_V = 1.71951 (was 1.53)" in lines
    assert "effects.joint_backlash.x.play_rad = 0.04 (new)" in lines
    assert "effects.dead_zone.x.half_width_V: taken out (was 0.1)" in lines
    assert len(lines) == 5
    assert "secret" not in " ".join(lines)
    assert changes(after, after) == []


def test_a_file_of_an_editor_that_marks_its_bytes_is_read(tmp_path: Path):
    file = tmp_path / "rig.toml"
    file.write_bytes(b"\xef\xbb\xbf[ball]\r\nmass_kg = 0.004\r\n")
    assert read_rig(file).ball.mass_kg == 0.004
