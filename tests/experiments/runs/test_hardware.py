"""A table's first reading is held against its homing before anything is armed."""

import errno
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from experiments.records import run_folder
from experiments.runs import hardware
from experiments.runs.hardware import Checked, home_table
from experiments.runs.hardware_run import measured
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import RunRequest, start_record, truth_record
from rig.hardware.homing.home import Homing
from rig.hardware.homing.homed import Homed, NotHomed
from rig.hardware.homing.homing_moves import HomingRefused
from rig.hardware.wiring import Wiring
from rig.parameters import Rig, TableChoice
from rig.rigfile import from_dict
from rig.table import ArmingStoppedError, Reading, watch_arming
from tests.support import ROOT

RIG = Rig(table=TableChoice(kind="quanser"))  # its card cannot tell a power-up


class Card:
    """What `Checked` uses of a table; notes what is done to it."""

    period_s, voltage_limit_V = 0.002, 6.0

    def __init__(self, theta_rad: tuple[float, float]) -> None:
        self.theta_rad, self.done = theta_rad, []

    def read(self) -> Reading:
        self.done.append("read")
        return Reading(0.0, self.theta_rad)

    def close(self) -> None:
        self.done.append("closed")

    def __enter__(self) -> "Card":
        self.done.append("armed")
        return self

    def __exit__(self, *error: object) -> None:
        self.done.append("left")


def test_angles_that_no_homed_arm_can_have_are_refused_before_arming():
    homed = Homed.of(Homing(Wiring(), (1.2, 1.2), (0.4, 0.4)), RIG, None)
    right, lost = Card((0.1, 0.0)), Card((0.1, -14.0))
    with Checked(right, RIG, homed):  # pyright: ignore[reportArgumentType]
        pass
    assert right.done == ["read", "armed", "left"]
    with pytest.raises(NotHomed, match="beyond its stops"), Checked(lost, RIG, homed):  # pyright: ignore[reportArgumentType]
        pass
    assert lost.done == ["read", "closed"]


def test_a_board_that_was_reset_is_refused_before_arming():
    homed = Homed.of(Homing(Wiring(), (1.2, 1.2), (0.4, 0.4)), RIG, "id 8f3a0c11")
    board = Card((0.1, 0.0))
    board.boot_id = "00000000"  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(NotHomed, match="or reset since"), Checked(board, RIG, homed):  # pyright: ignore[reportArgumentType]
        pass
    assert board.done == ["read", "closed"]


CONSENT = """
from experiments.runs.hardware import consent
import time
time.sleep(0.5)  # as the program's imports take
consent("Run 1 of 2.", False)
print("armed", flush=True)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="a terminal of POSIX")
def test_keys_typed_ahead_or_held_down_do_not_arm_the_table():
    import pty

    here, there = pty.openpty()
    os.write(here, b"\n\n\n")
    command = [sys.executable, "-c", CONSENT]
    program = subprocess.Popen(command, cwd=ROOT, stdin=there, stdout=subprocess.PIPE, text=True)
    try:
        assert program.stdout is not None
        first = program.stdout.readline()
        assert first == "Run 1 of 2.\n"
        os.write(here, b"\n")  # nobody reads so fast
        time.sleep(1.0)
        assert program.poll() is None
        os.write(here, b"\n")
        assert program.stdout.read().endswith("armed\n")
        assert program.wait(10) == 0
    finally:
        program.kill()
        program.wait()
        program.stdout.close()
        os.close(here)
        os.close(there)


def test_a_stop_while_the_table_is_opened_and_read_keeps_it_unarmed():
    homed = Homed.of(Homing(Wiring(), (1.2, 1.2), (0.4, 0.4)), RIG, None)
    card = Card((0.1, 0.0))
    table = Checked(card, RIG, homed)  # pyright: ignore[reportArgumentType]
    watch_arming(table, lambda: "read" in card.done)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ArmingStoppedError), table:
        pass
    assert card.done == ["read", "closed"]


@pytest.mark.parametrize("room", [True, False])
def test_a_run_is_what_it_was_where_there_is_no_room_for_its_notes(tmp_path, monkeypatch, room):
    """Half a file would make the run's end unreadable; no file is no notes."""
    homed = Homed.of(Homing(Wiring(), (1.2, 1.2), (0.4, 0.4)), RIG, None)
    table, path = Card((0.1, 0.0)), tmp_path / "table.json"
    table.notes = lambda: {"ticks_missed": 3}  # pyright: ignore[reportAttributeAccessIssue]

    def full(path: Path, content: bytes, **_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    if not room:
        monkeypatch.setattr(run_folder, "write_whole", full)
    with Checked(table, RIG, homed, notes_file=path):  # pyright: ignore[reportArgumentType]
        pass
    assert table.done == ["read", "armed", "left"]
    assert path.exists() == room
    if room:
        assert json.loads(path.read_text()) == {"ticks_missed": 3}
    assert [one.name for one in tmp_path.iterdir()] == ["table.json"] * room


def test_an_earlier_homing_is_gone_before_anything_moves(tmp_path, monkeypatch):
    """A homing that was begun and not finished leaves a table that is not homed; one that never
    reached the table leaves it to whoever uses it."""
    file, found = tmp_path / "lab.toml", Homing(Wiring(), (1.2, 1.2), (0.4, 0.4))
    kept = tmp_path / "lab.home.json"

    def taken(*_: object, **__: object):
        raise OSError("somebody else controls this table")

    def refused(*_: object, **__: object):
        assert not kept.exists()
        raise HomingRefused("x", "the arm did not move")

    Homed.of(found, RIG, None).save(kept)
    monkeypatch.setattr(hardware, "open_table", taken)
    with pytest.raises(OSError, match="somebody else"):
        home_table(RIG, file)
    assert kept.exists()
    unplugged = Rig(table=TableChoice(kind="serial", port=str(tmp_path / "nothing")))
    with pytest.raises(FileNotFoundError, match="plug the board in"):
        home_table(unplugged, file)
    assert kept.exists()
    monkeypatch.setattr(hardware, "open_table", lambda *_, **__: Card((0.1, 0.0)))
    monkeypatch.setattr(hardware, "home", refused)
    with pytest.raises(HomingRefused, match="did not move"):
        home_table(RIG, file)
    assert not kept.exists()


def test_no_secret_of_the_rig_file_reaches_a_recording(tmp_path):
    table = TableChoice(
        kind="remote",
        address="10.0.0.5:7643",
        token_file="/home/anna/secrets/rig.token",
        camera="http://operator:hunter2@cam/video?pwd=hunter2",
        calibration="/home/anna/calibration.json",
    )
    request = RunRequest(Rig(table=table), read_protocol("steps"), "with", 1, tmp_path)
    record = start_record(request) | measured(request.rig)
    text = json.dumps(record) + json.dumps(truth_record(request))
    assert "hunter2" not in text
    assert "secrets" not in text
    assert record["camera"] == "http://cam/video?pwd=..."
    assert record["calibration"] == "calibration.json"
    assert from_dict(record["rig"]).table.token_file == "rig.token"
