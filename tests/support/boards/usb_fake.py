# pyright: reportIncompatibleMethodOverride=false
# pyusb's own methods only raise, and are typed so.
"""A USB device in this process: pyusb's backend over a board's World. Stalls, hangs, unplugs."""

import errno
from array import array
from types import SimpleNamespace

from usb.backend import IBackend
from usb.core import USBError, USBTimeoutError

from tests.support.boards.world import World

IN, OUT = 0x81, 0x02


def _descriptor(kind: int, **fields) -> SimpleNamespace:
    return SimpleNamespace(bDescriptorType=kind, extra_descriptors=[], **fields)


class FakeUsb(IBackend):
    """One device with one vendor-class interface and two bulk endpoints.

    `stalls`: so many transfers of each endpoint stall before one goes through; `hung`: no transfer
    ends; `plugged` False: gone; `allowed` False: not this user's to open.
    """

    def __init__(self, world: World) -> None:
        super().__init__()
        self.world = world
        self.plugged, self.hung, self.allowed = True, False, True
        self.interface_class = 0xFF
        self.stalls, self.halted, self.cleared = {IN: 0, OUT: 0}, set(), 0
        self._sent: list[bytes] = []

    # --- what it is ---
    def enumerate_devices(self):
        return iter([self] if self.plugged else [])

    def get_device_descriptor(self, dev):
        return _descriptor(
            1, bLength=18, bcdUSB=0x200, bDeviceClass=0, bDeviceSubClass=0, bDeviceProtocol=0,
            bMaxPacketSize0=64, idVendor=0x1209, idProduct=1, bcdDevice=0x100, iManufacturer=0,
            iProduct=0, iSerialNumber=0, bNumConfigurations=1, address=1, bus=1, port_number=1,
            port_numbers=(1,), speed=2,
        )  # fmt: skip

    def get_configuration_descriptor(self, dev, config):
        if config:
            raise IndexError
        return _descriptor(
            2, bLength=9, wTotalLength=32, bNumInterfaces=1, bConfigurationValue=1,
            iConfiguration=0, bmAttributes=0x80, bMaxPower=50,
        )  # fmt: skip

    def get_interface_descriptor(self, dev, intf, alt, config):
        if intf or alt or config:
            raise IndexError
        return _descriptor(
            4, bLength=9, bInterfaceNumber=0, bAlternateSetting=0, bNumEndpoints=2,
            bInterfaceClass=self.interface_class, bInterfaceSubClass=0, bInterfaceProtocol=0,
            iInterface=0,
        )  # fmt: skip

    def get_endpoint_descriptor(self, dev, ep, intf, alt, config):
        address = (IN, OUT)[ep]
        return _descriptor(
            5, bLength=7, bEndpointAddress=address, bmAttributes=2, wMaxPacketSize=64, bInterval=0,
            bRefresh=0, bSynchAddress=0,
        )  # fmt: skip

    # --- opening ---
    def open_device(self, dev):
        self._there()
        if not self.allowed:
            raise USBError("Access denied", errno=errno.EACCES)
        return self

    def close_device(self, dev_handle):
        pass

    def set_configuration(self, dev_handle, config_value):
        self._there()

    def get_configuration(self, dev_handle):
        return 1

    def claim_interface(self, dev_handle, intf):
        self._there()

    def release_interface(self, dev_handle, intf):
        self._there()

    # --- transfers ---
    def bulk_write(self, dev_handle, ep, intf, data, timeout):
        self._ready(ep, timeout)
        self.world.board.receive(bytes(data))
        return len(data)

    def bulk_read(self, dev_handle, ep, intf, buff, timeout):
        self._ready(ep, timeout)
        for _ in range(timeout + 1):
            self._collect()
            if self._sent:
                data = self._sent.pop(0)
                buff[: len(data)] = array("B", data)
                return len(data)
            self.world.step()
        raise USBTimeoutError("Operation timed out", errno=errno.ETIMEDOUT)

    def clear_halt(self, dev_handle, ep):
        self._there()
        self.halted.discard(ep)
        self.cleared += 1

    def _collect(self) -> None:
        """Each frame is a transfer of its own; a device keeps but a few of them."""
        frames = self.world.board.take().split(b"\0")[:-1]
        self._sent = (self._sent + [frame + b"\0" for frame in frames])[-4:]

    def _there(self) -> None:
        if not self.plugged:
            raise USBError("No such device (it may have been disconnected)", errno=errno.ENODEV)

    def _ready(self, ep: int, timeout: int) -> None:
        self._there()
        if self.hung:
            self.world.run(timeout / 1000)
            raise USBTimeoutError("Operation timed out", errno=errno.ETIMEDOUT)
        if self.stalls[ep] > 0:
            self.stalls[ep] -= 1
            self.halted.add(ep)
        if ep in self.halted:
            raise USBError("Pipe error", errno=errno.EPIPE)
