"""rig.toml: defaults, round trip, and one clear line for every mistake."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.runs.assemble import load_rig
from rig.effects import CATALOGUE
from rig.parameters import Rig, nominal_servo
from rig.rigfile import from_dict, read_rig, to_dict, write_rig


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


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[servo]\ngain = 1.5", ["servo.gain", "known", "gain_rad_s_V"]),
        ("[motor]\nx = 1", ["unknown key 'motor'", "servo"]),
        ("[ball]\nradius_m = 0.2", ["radius_m", "0.1375", "does not fit"]),
        ("[ball]\nradius_m = -0.01", ["ball.radius_m = -0.01", "greater than 0"]),
        ("[servo]\ngain_rad_s_V = 'fast'", ["servo.gain_rad_s_V", "number"]),
        ("[servo]\ngain_rad_s_V = nan", ["gain_rad_s_V", "finite"]),
        ("[servo]\ntachometer_scale = inf", ["servo.tachometer_scale", "finite"]),
        ("[servo]\nencoder_counts_per_rev = 0", ["encoder_counts_per_rev = 0", "greater than 0"]),
        ("[camera]\ndropout = 1.5", ["camera.dropout = 1.5", "less than or equal to 1"]),
        ("[play]\ngear_x_rad = -0.1", ["play.gear_x_rad = -0.1", "greater than or equal to 0"]),
        ("[servo]\ntime_constant_s = 0.0001", ["time_constant_s", "inertia"]),
        ("[linkage]\narm_radius_m = 0.2", ["arm_radius_m", "upright"]),
        ("[effects.backlash]\nx.play_rad = 1", ["unknown effect", "gear_backlash"]),
        ("[effects.joint_backlash]\nz.play_rad = 1", ["no axis 'z'", "x, y"]),
        ("[effects.joint_backlash]\nx.width = 1", ["no key 'width'", "play_rad"]),
        ("[effects.joint_backlash]\nplay_rad = 1", ["[effects.joint_backlash] x.play_rad"]),
        ("[effects.joint_backlash]\nx.play_rad = -1", [">= 0"]),
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


def test_every_catalogue_entry_can_be_switched_on_in_a_file(tmp_path: Path):
    lines = []
    for effect in CATALOGUE:
        lines.append(f"[effects.{effect.name}]")
        lines += [f"{axis}.{p.key} = {p.high}" for axis in effect.axes for p in effect.parameters]
    path = tmp_path / "rig.toml"
    path.write_text("\n".join(lines))
    assert set(read_rig(path).effects) == {effect.name for effect in CATALOGUE}


def test_files_named_in_the_table_section_lie_beside_the_rig_file(tmp_path: Path):
    path = tmp_path / "rig.toml"
    path.write_text(
        "[table]\nkind = 'remote'\naddress = 'lab:7643'\ntoken_file = 'lab.token'\n"
        "camera = '0'\ncalibration = '/cal/calibration.json'\nsign_angle = [1, -1]\n"
    )
    table = read_rig(path).table
    assert table.token_file == str(tmp_path / "lab.token")
    assert table.calibration == "/cal/calibration.json"
    assert table.sign_angle == (1, -1)
    write_rig(read_rig(path), tmp_path / "again.toml")
    assert read_rig(tmp_path / "again.toml") == read_rig(path)
