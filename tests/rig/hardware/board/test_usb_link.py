"""A board on USB through pyusb: found, opened, stalled, hung, unplugged. The device is a fake."""

import pytest

from rig.hardware.board.board import BoardTable
from rig.hardware.board.link import LINK_DEAD_S, LinkLost
from rig.hardware.board.usb_link import UsbLink
from rig.parameters import Rig
from tests.support.boards.host import HostBoard
from tests.support.boards.usb_fake import IN, OUT, FakeUsb
from tests.support.boards.world import World, WorldLink


@pytest.fixture
def fake() -> FakeUsb:
    return FakeUsb(World(HostBoard(), Rig()))


def link_to(fake: FakeUsb) -> UsbLink:
    return UsbLink(backend=fake, clock=lambda: fake.world.now_s)


def table_on(fake: FakeUsb) -> BoardTable:
    return BoardTable(link_to(fake), clock=lambda: fake.world.now_s)


def test_a_missing_device_is_named(fake: FakeUsb):
    fake.plugged = False
    with pytest.raises(LinkLost, match="USB 1209:0001: not found; is it plugged in"):
        link_to(fake)


def test_a_device_of_other_numbers_is_not_ours(fake: FakeUsb):
    with pytest.raises(LinkLost, match="USB 1209:0002: not found"):
        UsbLink(0x1209, 0x0002, backend=fake)


def test_a_forbidden_device_says_the_cure(fake: FakeUsb):
    fake.allowed = False
    with pytest.raises(LinkLost, match=r"Access denied; .* udev rule"):
        link_to(fake)


def test_a_device_without_a_vendor_interface_is_refused(fake: FakeUsb):
    fake.interface_class = 3  # a keyboard
    with pytest.raises(LinkLost, match="no vendor-class interface"):
        link_to(fake)


def test_without_libusb_it_says_so(monkeypatch: pytest.MonkeyPatch):
    import usb.core

    def no_backend(**_):
        raise usb.core.NoBackendError("No backend available")

    monkeypatch.setattr(usb.core, "find", no_backend)
    with pytest.raises(LinkLost, match=r"install libusb-1\.0"):
        UsbLink()


@pytest.mark.parametrize("end", [IN, OUT])
def test_a_stall_is_cleared_and_costs_no_run(fake: FakeUsb, end: int):
    table = table_on(fake)
    with table:
        for k in range(100):
            table.read()
            table.drive((0.1, 0.1))
            if k % 20 == 10:
                fake.stalls[end] = 1
    assert fake.cleared == 5


@pytest.mark.parametrize("end", [IN, OUT])
def test_an_end_that_stalls_for_ever_is_lost(fake: FakeUsb, end: int):
    table = table_on(fake)
    table.arm()
    fake.stalls[end] = 10**6

    def work() -> None:
        for _ in range(10):
            table.read()
            table.drive((0.1, 0.1))

    with pytest.raises(LinkLost, match="Pipe error"):
        work()


def test_a_hung_device_takes_no_bytes(fake: FakeUsb):
    link = link_to(fake)
    fake.hung = True
    begin = fake.world.now_s
    with pytest.raises(LinkLost, match="takes no bytes"):
        link.send(b"\1\0")
    assert fake.world.now_s - begin <= LINK_DEAD_S
    assert not link.wait(0.01)


def test_what_was_waiting_in_the_device_is_passed_over(fake: FakeUsb):
    """After a slow tick the newest telemetry is read, not the oldest of those in the device."""
    table = table_on(fake)
    table.arm()
    reading = table.read()
    for k in range(50):
        reading = table.read()
        table.drive((0.1, 0.1))
        if k == 25:
            fake.world.run(0.008)
    assert table.newest is not None
    assert fake.world.now_s - 1e-6 * table.newest.clock_us < 0.004
    assert reading.t_s > 0.1
    assert 2 <= table.ticks_missed <= 5


def test_unplugging_ends_by_name_and_closing_is_quiet(fake: FakeUsb):
    table = table_on(fake)
    table.arm()
    fake.plugged = False
    with pytest.raises(LinkLost, match=r"USB 1209:0001 is lost: No such device"):
        table.read()
    table.close()
    table.close()
    assert WorldLink(fake.world).clock() > 0
