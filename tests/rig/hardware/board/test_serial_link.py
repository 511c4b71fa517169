"""A board on a real serial device (a pty): the contract, vanished, hung, foreign, taken.

Time passes while the host waits; `tests/rig/firmware/test_firmware_pty.py` has it in real time.
"""

import os
import time

import numpy as np
import pytest

from rig.hardware.board import session
from rig.hardware.board.board import BoardTable
from rig.hardware.board.link import LinkLost
from rig.hardware.board.serial_link import SerialLink
from rig.hardware.board.session import BoardStopped
from rig.parameters import Rig
from tests.support.boards.host import HostBoard
from tests.support.boards.pty import PtyBoard, SteppedLink
from tests.support.boards.world import World
from tests.support.hardware import contract

pytestmark = pytest.mark.realtime

SLACK_S = 1.0  # what a busy machine's scheduler may add


@pytest.fixture
def served():
    world = World(HostBoard(), Rig())
    peer = PtyBoard(world, thread=False)
    yield peer
    peer.close()


def table_on(peer: PtyBoard) -> BoardTable:
    link = SteppedLink(peer, SerialLink(peer.port))
    return BoardTable(link, clock=link.clock)


@pytest.mark.parametrize("how", ["vanished", "hung"])
def test_a_dead_link_raises_by_name(served: PtyBoard, how: str):
    table = table_on(served)
    table.arm()

    def kill() -> None:
        if how == "hung":
            served.hung = True
        else:
            served.unplug()

    contract.a_dead_link_raises_by_name(
        table, kill, lambda: served.world.now_s, LinkLost, f"{served.port} is lost"
    )
    table.close()
    served.world.run(0.7)  # what the board does alone
    assert served.world.volts == (0.0, 0.0)
    assert np.all(np.abs(served.world.arms_rad) < 0.03)


def test_a_port_is_held_alone(served: PtyBoard):
    link = SerialLink(served.port)
    with pytest.raises(LinkLost, match=r"another program holds it"):
        SerialLink(served.port)
    link.close()
    link.close()


def test_a_port_that_is_not_there_is_named():
    with pytest.raises(LinkLost, match=r"board on /dev/ttyNONE.*plugged in"):
        SerialLink("/dev/ttyNONE")


def test_a_board_without_our_firmware_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(session, "ANSWER_S", 0.3)
    master, slave = os.openpty()
    with pytest.raises(LinkLost, match="does not answer: is our firmware on it"):
        BoardTable(SerialLink(os.ttyname(slave)))
    os.close(master)
    os.close(slave)


def test_a_device_that_takes_no_bytes_is_lost_in_time():
    master, slave = os.openpty()
    link = SerialLink(os.ttyname(slave))
    begin = time.monotonic()

    def fill() -> None:
        for _ in range(1000):
            link.send(bytes(1000))

    with pytest.raises(LinkLost, match="takes no bytes"):
        fill()
    assert time.monotonic() - begin < 0.1 + SLACK_S
    link.close()
    os.close(master)
    os.close(slave)


def test_a_halted_host_finds_the_board_stopped(served: PtyBoard):
    """As after SIGSTOP and SIGCONT: its stale commands move nothing, and it is told why."""
    table = table_on(served)
    table.arm()
    for _ in range(20):
        table.read()
        table.drive((1.0, 0.0))
    for _ in range(300):
        served.step()

    def go_on() -> None:
        for _ in range(20):
            table.drive((3.0, 3.0))
            table.read()

    with pytest.raises(BoardStopped, match="had no command for 100 ms"):
        go_on()
    table.close()
    served.world.run(0.6)
    assert served.world.volts == (0.0, 0.0)
