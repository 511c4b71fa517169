"""From [table] to a driver; the markers' tilt that homing believes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.hardware.board.link import LinkLost
from rig.hardware.camera.plate_tilt import MarkerTilt
from rig.hardware.choose import check_drive, host_and_port, open_table, usb_numbers
from rig.hardware.network.token_file import make_token
from rig.hardware.wiring import Wiring, file_wiring, level_counts, raw_wiring
from rig.loop.paced import Paced
from rig.parameters import Gains, Rig, Servo, TableChoice
from rig.plant.ball import plate_rotation
from rig.rigfile import from_dict, read_rig, to_dict
from rig.safety.late_watch import longest_round_trip_s
from tests.support import ROOT
from vision.frames import Frame
from vision.plate.markers import default_layout
from vision.synthetic.synthetic import Renderer, Scene, virtual_view

RIGS = ROOT / "experiments/rigs"


def test_wirings_of_a_rig_file():
    table = TableChoice(swap=True, crossed=True, sign_volts=(1, -1), sign_angle=(-1, 1))
    servo = replace(Rig().servo, encoder_counts_per_rev=2048)
    rig = Rig(table=table, servo=servo)
    assert file_wiring(rig) == Wiring((1, 0), (1, -1), (-1, 1), (0, 0), 2048, True)
    assert raw_wiring(rig) == Wiring(counts_per_rev=2048)


@pytest.mark.parametrize(
    ("address", "pair"),
    [("lab:7643", ("lab", 7643)), ("10.0.0.5:1", ("10.0.0.5", 1)), ("[::1]:80", ("::1", 80))],
)
def test_addresses(address: str, pair: tuple[str, int]):
    assert host_and_port(address) == pair


@pytest.mark.parametrize("address", ["lab", "lab:", ":80", "lab:99999", "a b:3", "::1:80", "lab:0"])
def test_what_is_no_address_is_refused(address: str):
    with pytest.raises(ValueError, match="host:port"):
        host_and_port(address)


@pytest.mark.parametrize(
    ("servo", "rate_hz", "said"),
    [
        (Servo(voltage_limit_V=24.0), 500.0, "voltage_limit_V = 24: at most 6.5"),
        (Servo(), 100.0, "control_rate_hz = 100: at least 200"),
        (Servo(encoder_counts_per_rev=64), 500.0, "encoder_counts_per_rev = 64: at least 400"),
    ],
)
def test_a_table_that_the_limiter_alone_cannot_guard_is_refused(servo, rate_hz: float, said: str):
    rig = Rig(servo=servo, control_rate_hz=rate_hz, table=TableChoice(kind="quanser"))
    with pytest.raises(ValueError, match=said):
        open_table(rig)
    check_drive(
        replace(rig, table=TableChoice(kind="serial", port="p"))
    )  # a board brakes by itself


def test_usb_numbers():
    assert usb_numbers("") == ()
    assert usb_numbers("1209:00aF") == (0x1209, 0xAF)
    with pytest.raises(ValueError, match="1209:0001"):
        usb_numbers("board")


def test_each_kind_is_opened_or_named():
    assert isinstance(open_table(Rig()), Paced)
    assert open_table(Rig(), homed=False).level_s == 0.0  # pyright: ignore
    for table in (
        TableChoice(kind="serial", port="/dev/no-such-port"),
        TableChoice(kind="quanser"),
    ):
        with pytest.raises(LinkLost, match=r"no-such-port|quanser\.hardware"):
            open_table(Rig(table=table))


@pytest.mark.parametrize(
    ("kind", "table"),
    [
        ("serial", "board.board.BoardTable"),
        ("usb", "board.board.BoardTable"),
        ("remote", "network.remote.RemoteTable"),
    ],
)
def test_a_link_may_be_as_late_as_the_rigs_servo_loop_stands(
    kind: str, table: str, tmp_path: Path, monkeypatch
):
    make_token(tmp_path / "rig.token")
    address = "lab:7643" if kind == "remote" else ""
    choice = TableChoice(kind=kind, port="/dev/no-such-port", address=address)
    choice = replace(choice, token_file=str(tmp_path / "rig.token"))
    servo, gains = Servo(time_constant_s=0.1), Gains(servo_proportional_V_rad=20.0)
    rig, told = Rig(servo=servo, gains=gains, table=choice), {}
    monkeypatch.setattr("rig.hardware.board.serial_link.SerialLink", lambda *_: None)
    monkeypatch.setattr("rig.hardware.board.usb_link.UsbLink", lambda *_: None)
    monkeypatch.setattr(f"rig.hardware.{table}", lambda *_, **settings: told.update(settings))
    open_table(rig)
    assert told["longest_trip_s"] == longest_round_trip_s(rig) != longest_round_trip_s(Rig())


@pytest.mark.parametrize(
    "table",
    [
        TableChoice(kind="serial", port="/dev/no-such-port"),
        TableChoice(kind="usb"),
        TableChoice(kind="quanser"),
        TableChoice(kind="remote", address="lab:7643", token_file="no-such-file"),
    ],
)
@pytest.mark.parametrize("homed", [True, False])
def test_no_volts_are_opened_for_servos_that_take_an_angle(table: TableChoice, homed: bool):
    rig = Rig(servo=Servo(kind="position"), table=table)
    with pytest.raises(ValueError, match="drives volts, which would be wrong"):
        open_table(rig, homed=homed)


BUS = TableChoice(kind="feetech", port="/dev/no-such-port", baud=1_000_000)
ANGLES = Rig(servo=Servo(kind="position", angle_measured=True), table=BUS, control_rate_hz=250.0)


def test_a_bus_is_opened_for_servos_that_take_an_angle_alone():
    with pytest.raises(LinkLost, match="servo bus on /dev/no-such-port"):
        open_table(ANGLES)
    wrong = {
        "set servo.kind = 'position'": replace(ANGLES, servo=Servo()),
        "servos take every goal as it comes; set 0": replace(
            ANGLES, servo=replace(ANGLES.servo, period_s=0.02)
        ),
        "have 4096": replace(ANGLES, servo=replace(ANGLES.servo, encoder_counts_per_rev=1024)),
        "control_rate_hz has 2.0 ms": replace(ANGLES, control_rate_hz=500.0),
    }
    for words, rig in wrong.items():
        with pytest.raises(ValueError, match=words):
            open_table(rig)


ARMS = read_rig(RIGS / "three-arms.toml")


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (replace(BUS, port="/dev/no-such-bus"), "servo bus on /dev/no-such-bus"),
        (TableChoice(kind="pulses", port="/dev/no-such-pulses"), "servo board on /dev/no-such"),
    ],
)
@pytest.mark.parametrize("homed", [True, False])
def test_three_arms_are_opened_by_each_table_that_is_told_angles(table, words: str, homed: bool):
    servo = replace(ARMS.servo, period_s=0.0 if table.kind == "feetech" else 0.02)
    slower = replace(ARMS, servo=servo, table=table, control_rate_hz=200.0)
    with pytest.raises(LinkLost, match=words):
        open_table(slower, homed=homed)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"ids": [1, 2]}, r"table.ids = \[1, 2\]: the linkage has 3 servos"),
        ({"ids": [1, 2, 1]}, "must be 3 different numbers"),
        ({"trim_rad": [0.0, 0.1]}, r"table.trim_rad = \[0.0, 0.1\]: the linkage has 3 servos"),
        ({"pulse_us_per_rad": [600, 600]}, "table.pulse_us_per_rad = .* the linkage has 3 servos"),
        ({"sign_angle": [1, 1]}, "table.sign_angle = .* the linkage has 3 servos"),
        ({"sign_angle": [1, 1, 2]}, "each must be 1 or -1"),
        ({"swap": True}, "3 servos have no x and y to swap"),
    ],
)
def test_lists_of_three_arms_that_cannot_be_are_one_line(keys: dict, words: str):
    table = {"kind": "feetech", "port": "/dev/ttyUSB0"} | keys
    with pytest.raises(ValueError, match=words) as caught:
        from_dict(to_dict(ARMS) | {"table": table})
    assert "\n" not in str(caught.value)


def test_what_a_file_does_not_list_is_usual():
    assert file_wiring(replace(ARMS, table=BUS)).zero_counts == (2048, 2048, 2048)
    assert file_wiring(ARMS).order == (0, 1, 2)
    assert file_wiring(Rig()) == Wiring()


def test_level_of_a_bus_is_the_middle_and_its_trim():
    table = replace(BUS, trim_rad=(0.1, -0.2))
    assert level_counts(replace(ANGLES, table=table)) == (2048 + 65, 2048 - 130)
    assert level_counts(Rig()) == (0, 0)
    assert file_wiring(replace(ANGLES, table=table)).zero_counts == (2113, 1918)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"ids": [3, 3]}, r"table.ids = \[3, 3\]: must be 2 different numbers"),
        ({"ids": [1, 254]}, "from 0 to 252"),
        ({"ids": [1, 2, 3]}, "table.ids"),
        ({"trim_rad": [0.0, 4.0]}, r"table.trim_rad = \[0.0, 4.0\]"),
        ({"port": ""}, r"table.kind = 'dynamixel' needs table.port"),
        ({"kind": "dynamxel"}, "table.kind = 'dynamxel'; known: .*feetech, dynamixel"),
    ],
)
def test_keys_of_a_bus_that_cannot_be_are_one_line(keys: dict, words: str):
    table = {"kind": "dynamixel", "port": "/dev/ttyUSB0"} | keys
    with pytest.raises(ValueError, match=words) as caught:
        from_dict({"servo": {"kind": "position"}, "table": table})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("tilt", [(0.05, 0.0), (-0.03, 0.06), (0.0, -0.09)])
def test_markers_tell_the_plates_tilt_and_are_found_again(tilt: tuple[float, float]):
    layout = default_layout(0.275)
    scene = Scene(plate_side_m=0.275, layout=layout, ball_radius_m=0.02)
    renderer = Renderer(scene, virtual_view(), np.random.default_rng(1))
    there, level = renderer.render(plate_rotation(tilt), None), np.eye(3)
    camera = MarkerTilt(virtual_view(), layout)
    for image, is_seen in ((there, True), (np.zeros_like(there), False), (there, True)):
        seen, track, _ = camera.step(Frame(image, 3.0, 0), level)
        assert (seen is not None) == is_seen
        assert track.state == ("track" if is_seen else "lost")
        if seen is not None:
            assert seen.xy_m == pytest.approx(tilt, abs=2e-3)
            assert seen.exposed_s == 3.0
