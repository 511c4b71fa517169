"""`rig doctor` with boards and a camera plugged in: umockdev shows invented devices to the real
libusb, pyserial and file calls of a real program."""

import os
import subprocess
import sys
from pathlib import Path

from experiments.doctor.doctor import udev_rule
from tests.support import ROOT
from tests.support.exact_bundle import exact_bundle
from tests.support.parts import need
from vision.synthetic.synthetic import Scene, virtual_view

need("umockdev", "libusb")

HUB = "12010002090000406b1d020002050302010109021900010100e0000904000001090000000705810304000c"
ARDUINO = "12010002020000404123430001000102000109021900010100e0000904000001090000000705810304000c"
# One vendor-class interface, bulk endpoints 0x81 and 0x02, as usb_link.py wants it.
BOARD = (
    "120100020000004009120100000100000001"
    "0902200001010080320904000002ff0000000705810240000007050202400000"
)
USB_BUS = "/devices/pci0000:00/0000:00:14.0/usb1"
DEVICES = f"""\
P: {USB_BUS}
N: bus/usb/001/001
E: DEVNAME=/dev/bus/usb/001/001
E: DEVTYPE=usb_device
E: SUBSYSTEM=usb
A: busnum=1
A: devnum=1
A: speed=480
A: bConfigurationValue=1
H: descriptors={HUB}

P: {USB_BUS}/1-1
N: bus/usb/001/004
E: DEVNAME=/dev/bus/usb/001/004
E: DEVTYPE=usb_device
E: SUBSYSTEM=usb
A: busnum=1
A: devnum=4
A: speed=12
A: bConfigurationValue=1
H: descriptors={BOARD}

P: {USB_BUS}/1-2
N: bus/usb/001/005
E: DEVNAME=/dev/bus/usb/001/005
E: DEVTYPE=usb_device
E: SUBSYSTEM=usb
A: busnum=1
A: devnum=5
A: speed=12
A: bConfigurationValue=1
A: bNumInterfaces=2
A: idVendor=2341
A: idProduct=0043
A: product=Uno of umockdev
H: descriptors={ARDUINO}

P: {USB_BUS}/1-2/1-2:1.0
E: DEVTYPE=usb_interface
E: SUBSYSTEM=usb
A: bInterfaceNumber=00

P: {USB_BUS}/1-2/1-2:1.0/tty/ttyACM7
N: ttyACM7
E: SUBSYSTEM=tty
L: device=../../../1-2:1.0

P: {USB_BUS}/1-3/1-3:1.0/video4linux/video5
N: video5
E: SUBSYSTEM=video4linux
A: name=Global shutter
"""
SERIAL = '[table]\nkind = "serial"\nport = "/dev/ttyACM7"\ncamera = "5"\ncalibration = "c.json"\n'
USB = '[table]\nkind = "usb"\n'
# Root may open everything: without this capability even root is asked for permission.
ASKED = ["setpriv", "--bounding-set=-dac_override,-dac_read_search", "--"]


def doctor(folder: Path, rig: str, *shut: str) -> tuple[int, str]:
    """The program's exit code and words; `shut`: devices that its user may not open."""
    (folder / "all.umockdev").write_text(DEVICES)
    (folder / "lab.toml").write_text(rig)
    exact_bundle(virtual_view(), Scene()).save(folder / "c.json")
    take = "".join(f'chmod 000 "$UMOCKDEV_DIR/{device}" && ' for device in shut)
    asked = ASKED if os.geteuid() == 0 else []
    command = ["umockdev-run", "-d", "all.umockdev", "--", "sh", "-c", take + 'exec "$@"', "sh"]
    program = [sys.executable, "-m", "experiments.cli", "doctor", "--rig", "lab.toml"]
    said = subprocess.run(
        [*command, *asked, *program],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        env=os.environ | {"COLUMNS": "200", "PYTHONPATH": str(ROOT)},
    )
    assert "Traceback" not in said.stderr
    return said.returncode, said.stdout + said.stderr


def test_a_serial_board_and_a_camera_are_found(tmp_path: Path):
    code, said = doctor(tmp_path, SERIAL)
    assert code == 0, said
    assert "ok    serial port /dev/ttyACM7: Uno of umockdev" in said
    assert "ok    camera 5: Global shutter" in said


def test_a_usb_board_is_found_and_what_else_is_plugged_in_is_named(tmp_path: Path):
    code, said = doctor(tmp_path, USB)
    assert code == 0, said
    assert "ok    USB board 1209:0001: can be opened" in said
    assert "seen: /dev/ttyACM7: Arduino Uno of umockdev" in said
    assert "seen: /dev/video5: Global shutter" in said


def test_missing_permissions_for_a_serial_board_and_a_camera_are_named_with_their_cure(tmp_path):
    code, said = doctor(tmp_path, SERIAL, "dev/ttyACM7", "dev/video5")
    assert code == 1, said
    for what in ("serial port /dev/ttyACM7", "camera 5"):
        assert f"bad   {what}: may not be opened\n      -> sudo usermod -aG " in said


def test_a_missing_permission_for_a_usb_board_is_named_with_its_rule(tmp_path: Path):
    code, said = doctor(tmp_path, USB, "dev/bus/usb/001/004")
    assert code == 1, said
    assert "bad   USB board 1209:0001: may not be opened" in said
    assert udev_rule() in said
