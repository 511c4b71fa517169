"""The doctor: what is missing and the cure, from told facts and on this very machine."""

from dataclasses import replace
from pathlib import Path

import pytest

from experiments.cli import application
from experiments.doctor.doctor import BAD, NOTE, OK, Device, Facts, examine, udev_rule, usable
from experiments.doctor.facts import gather
from rig.parameters import Rig, Servo, TableChoice
from tests.support.command import told

WELL = Facts(
    user="eva",
    serial=(Device("/dev/ttyACM0", True, "dialout", "Arduino Uno", 0x2341, 0x43),),
    usb=(Device("/dev/bus/usb/001/004", True, "plugdev", "", 0x1209, 0x0001),),
    sdk="",
    cameras=(Device("/dev/video0", True, "video", "Global shutter"),),
    rtprio=90,
    memlock_bytes=2**40,
    packages={"numpy": "2.4"},
)
SERIAL = TableChoice(kind="serial", port="/dev/ttyACM0", camera="0", calibration="c.json")
TABLES = {
    "simulated": TableChoice(),
    "serial": SERIAL,
    "usb": TableChoice(kind="usb"),
    "quanser": TableChoice(kind="quanser"),
    "remote": TableChoice(kind="remote", address="lab:7643", token_file="t"),
}


def bad(facts: Facts, table: TableChoice) -> dict[str, str]:
    findings = examine(facts, Rig(table=table))
    assert usable(findings) == (not [f for f in findings if f.state == BAD])
    assert all("\n" not in f.text + f.cure for f in findings)
    return {f.what: f"{f.text} -> {f.cure}" for f in findings if f.state == BAD}


@pytest.mark.parametrize("kind", TABLES)
def test_where_everything_is_there_nothing_is_bad(kind: str):
    assert bad(WELL, TABLES[kind]) == {}


def bus(**keys) -> Rig:
    """A rig on a bus of Feetech servos."""
    table = TableChoice(kind="feetech", port=WELL.serial[0].path, baud=1_000_000)
    servo = Servo(kind="position", angle_measured=True)
    return replace(Rig(servo=servo, table=table, control_rate_hz=250.0), **keys)


def test_the_kinds_of_real_tables_are_those_that_its_servos_can_be_of():
    for rig, kinds in ((Rig(), '"serial", "usb"'), (bus(table=TableChoice()), '"feetech", ')):
        (table,) = [f for f in examine(WELL, rig) if f.what == "table"]
        assert f"[table] kind = {kinds}" in table.text


def test_a_bus_of_servos_is_looked_at_without_asking_them():
    found = {f.what: f for f in examine(WELL, bus())}
    assert usable(list(found.values()))
    assert "1000000 baud is fast enough for 250 Hz" in found["servo bus, ids 1, 2"].text
    slow = {f.what: f for f in examine(WELL, bus(control_rate_hz=500.0)) if f.state == BAD}
    assert "control_rate_hz has 2.0 ms" in slow["servo bus, ids 1, 2"].text
    volts = {f.what: f for f in examine(WELL, bus(servo=Servo())) if f.state == BAD}
    assert "set servo.kind = 'position'" in volts["servos"].text
    gone = {f.what: f for f in examine(replace(WELL, serial=()), bus()) if f.state == BAD}
    assert list(gone) == [f"serial port {WELL.serial[0].path}"]


@pytest.mark.parametrize("kind", [kind for kind in TABLES if kind != "simulated"])
def test_a_table_of_volts_whose_servos_take_an_angle_cannot_be_used(kind: str):
    rig = Rig(table=TABLES[kind], servo=Servo(kind="position"))
    found = {f.what: f for f in examine(WELL, rig) if f.state == BAD}
    assert "drives volts, which would be wrong" in found["servos"].text
    virtual = Rig(servo=Servo(kind="position"))
    assert usable(examine(WELL, virtual))


@pytest.mark.parametrize(
    ("kind", "change", "words"),
    [
        ("serial", {"serial": ()}, ["is not there", "ports here: none"]),
        (
            "serial",
            {"serial": (replace(WELL.serial[0], usable=False, group="uucp"),)},
            ["may not be opened", "usermod -aG uucp eva"],
        ),
        ("serial", {"cameras": ()}, ["camera 0", "is not there"]),
        (
            "serial",
            {"cameras": (replace(WELL.cameras[0], usable=False),)},
            ["camera 0", "usermod -aG video eva"],
        ),
        ("serial", {"missing_files": ("c.json",)}, ["c.json", "no such file"]),
        ("serial", {"packages": {"pyserial": None}}, ["missing: pyserial", "uv sync"]),
        ("usb", {"usb_library": False}, ["libusb-1.0-0"]),
        ("usb", {"usb": ()}, ["1209:0001", "is not there"]),
        (
            "usb",
            {"usb": (replace(WELL.usb[0], usable=False),)},
            ["may not be opened", udev_rule(), "/etc/udev/rules.d"],
        ),
        ("quanser", {"sdk": "No module named 'quanser'"}, ["No module named", "rig serve"]),
        ("remote", {"remote": "silent for 90 ms"}, ["silent for 90 ms", "same token"]),
    ],
)
def test_what_is_missing_is_bad_and_has_its_cure(kind: str, change: dict, words: list[str]):
    found = bad(replace(WELL, **change), TABLES[kind])
    assert len(found) == 1
    text = " ".join(f"{what}: {said}" for what, said in found.items())
    for word in words:
        assert word in text
    if kind != "simulated" and "packages" not in change:  # and it is nobody else's trouble
        assert bad(replace(WELL, **change), TABLES["simulated"]) == {} or "missing_files" in change


def test_real_time_is_asked_for_but_not_required():
    findings = examine(replace(WELL, rtprio=0, memlock_bytes=8 * 2**20), Rig(table=SERIAL))
    assert usable(findings)
    cures = {f.what: f.cure for f in findings if f.state == NOTE}
    assert 'eva - rtprio 50" to /etc/security/limits.d' in cures["real-time priority"]
    assert "memlock unlimited" in cures["locked memory"]
    windows = replace(WELL, platform="win32", rtprio=None, memlock_bytes=None)
    assert usable(examine(windows, Rig(table=TABLES["quanser"])))


def test_a_missing_homing_is_told_with_its_command():
    findings = examine(replace(WELL, homing="has not been homed"), Rig(table=SERIAL))
    (one,) = [f for f in findings if f.what == "homing"]
    assert one.state == NOTE
    assert "rig home" in one.cure


def test_other_boards_and_cameras_that_are_plugged_in_are_named():
    findings = examine(WELL, Rig())
    told = {f.what: f"{f.text} {f.cure}" for f in findings if f.what.startswith("seen")}
    assert "Arduino" in told["seen: /dev/ttyACM0"]
    assert 'port = "/dev/ttyACM0"' in told["seen: /dev/ttyACM0"]
    assert "Global shutter" in told["seen: /dev/video0"]


def test_facts_of_this_machine_can_be_gathered(tmp_path: Path):
    table = TableChoice(kind="remote", address="127.0.0.1:9", token_file=str(tmp_path / "none"))
    facts = gather(Rig(table=table), tmp_path / "rig.toml")
    assert facts.packages["numpy"]
    assert facts.missing_files == (str(tmp_path / "none"),)
    assert "token file" in (facts.remote or "")
    assert "not been homed" in (facts.homing or "")
    assert any(f.state == OK for f in examine(facts, Rig(table=table)))


def doctor(rig: Path) -> tuple[int, str]:
    return told("doctor", "--rig", rig)[:2]


def test_the_command_exits_0_or_1(tmp_path: Path):
    rig = tmp_path / "rig.toml"
    rig.write_text("")
    code, out = doctor(rig)
    assert code == 0
    assert f"nothing that {rig} needs is missing" in out
    rig.write_text('[table]\nkind = "serial"\nport = "/dev/no-such-port"\n')
    code, out = doctor(rig)
    assert code == 1
    assert "/dev/no-such-port" in out
    assert "-> plug the board in" in out


@pytest.mark.parametrize("words", [["run", "servo-squares", "--out", "out"], ["home"]])
def test_a_port_that_is_not_there_is_one_line(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = '[table]\nkind = "serial"\nport = "/dev/ttyACM77"\n'
    (tmp_path / "serial.toml").write_text(text)
    monkeypatch.setattr("sys.argv", ["rig", *words, "--rig", "serial.toml", "--yes"])
    with pytest.raises(SystemExit) as end:
        application.main()
    said = capsys.readouterr()
    assert end.value.code == 2
    assert said.err.count("\n") == 1
    assert "'/dev/ttyACM77' is not there: plug the board in" in said.err
    assert not list((tmp_path / "out").glob("runs/*"))


def test_a_cache_that_cannot_be_written_is_a_note_with_its_cure():
    why = "compiled functions cannot be kept in /x: each compiles anew; let XDG_CACHE_HOME ..."
    findings = examine(replace(WELL, cache=why), Rig())
    (found,) = [f for f in findings if f.what == "cache of compiled functions"]
    assert (found.state, found.cure) == (NOTE, "let XDG_CACHE_HOME ...")
    assert found.text.endswith("each compiles anew")
    assert not any(f.what == found.what for f in examine(WELL, Rig()))
