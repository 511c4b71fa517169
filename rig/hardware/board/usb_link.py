"""A board on USB: packets over two bulk endpoints of a vendor-class interface, by pyusb."""

import errno
import time
from collections.abc import Callable
from functools import partial

import usb.core
import usb.util

from rig.hardware.board.link import LINK_DEAD_S, LinkLost

VENDOR, PRODUCT = 0x1209, 0x0001  # pid.codes' number for experiments
VENDOR_CLASS = 0xFF
_READ_SIZE = 4096
_AT_ONCE_S = 2e-4  # a transfer that came faster was waiting in the device: more may be there
_NO_PERMISSION = "your user may not open it: add the udev rule (rig doctor tells how)"


class UsbLink:
    """A board on USB: the first device with the numbers `vendor` and `product`, its vendor-class
    interface held alone.

    backend: pyusb's, by default libusb; clock: monotonic [s]. LinkLost: there is no such device, it
    may not be opened, is gone or hangs. A stalled endpoint is cleared once; stalled again, the
    device counts as lost.
    """

    def __init__(
        self,
        vendor: int = VENDOR,
        product: int = PRODUCT,
        *,
        backend=None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.name = f"board on USB {vendor:04x}:{product:04x}"
        self._clock, self._arrived = clock, bytearray()
        try:
            found = usb.core.find(idVendor=vendor, idProduct=product, backend=backend)
        except usb.core.NoBackendError:
            raise LinkLost(
                errno.ENOSYS, f"{self.name}: no libusb here; install libusb-1.0"
            ) from None
        if found is None:
            raise LinkLost(errno.ENODEV, f"{self.name}: not found; is it plugged in?")
        self._device: usb.core.Device = found  # pyright: ignore[reportAttributeAccessIssue]
        try:
            self._open()
        except usb.core.USBError as error:
            cure = (
                _NO_PERMISSION if error.errno == errno.EACCES else "does another program hold it?"
            )
            raise LinkLost(
                error.errno or errno.EIO, f"{self.name}: {error.strerror}; {cure}"
            ) from None

    def _open(self) -> None:
        """Find the interface, claim it, keep its endpoints."""
        self._device.set_configuration()
        for interface in self._device.get_active_configuration():
            if interface.bInterfaceClass != VENDOR_CLASS:
                continue
            ends = {}
            for end in interface:
                if usb.util.endpoint_type(end.bmAttributes) == usb.util.ENDPOINT_TYPE_BULK:
                    ends[usb.util.endpoint_direction(end.bEndpointAddress)] = end
            if len(ends) == 2:
                usb.util.claim_interface(self._device, interface)
                self._in, self._out = ends[usb.util.ENDPOINT_IN], ends[usb.util.ENDPOINT_OUT]
                return
        raise LinkLost(
            errno.ENXIO,
            f"{self.name}: no vendor-class interface with two bulk endpoints; another device?",
        )

    def send(self, data: bytes) -> None:
        """Hand all of `data` to the device. LinkLost: it is gone or takes no bytes in time."""
        sent = self._transfer(self._out, partial(self._out.write, data, _ms(LINK_DEAD_S / 2)))
        if sent != len(data):
            raise self._lost("it takes no bytes any more")

    def receive(self) -> bytes:
        """Return everything that is there within 1 ms; b"" when nothing is. LinkLost: the device
        is gone.
        """
        if not self._arrived:
            self._read(0.001)
        data = bytes(self._arrived)
        self._arrived.clear()
        return data

    def wait(self, timeout_s: float) -> bool:
        """Wait at most `timeout_s` until bytes are there; return whether they are. LinkLost: it
        is gone.
        """
        return bool(self._arrived) or self._read(timeout_s)

    def _read(self, timeout_s: float) -> bool:
        """Take what comes within the time, and whatever was waiting behind it."""
        while True:
            begin = self._clock()
            patience_ms = _ms(timeout_s)
            data = self._transfer(self._in, partial(self._in.read, _READ_SIZE, patience_ms))
            if data is None:
                return bool(self._arrived)
            self._arrived += bytes(data)
            if self._clock() - begin > _AT_ONCE_S:
                return True
            timeout_s = 0.001

    def _transfer(self, endpoint, move):
        """A transfer's result, None where it took too long; a stall is cleared once."""
        for tries_left in (1, 0):
            try:
                return move()
            except usb.core.USBTimeoutError:
                return None
            except usb.core.USBError as error:
                if error.errno != errno.EPIPE or not tries_left:
                    raise self._lost(error.strerror or str(error)) from None
                self._clear(endpoint)
        return None

    def _clear(self, endpoint) -> None:
        try:
            endpoint.clear_halt()
        except usb.core.USBError as error:
            raise self._lost(error.strerror or str(error)) from None

    def close(self) -> None:
        """Let the device go, also where it has vanished."""
        usb.util.dispose_resources(self._device)  # swallows what a vanished device says

    def _lost(self, why: str) -> LinkLost:
        return LinkLost(errno.EIO, f"{self.name} is lost: {why}")


def _ms(seconds: float) -> int:
    """A time-out as libusb takes it; 0 would mean for ever."""
    return max(int(1000 * seconds), 1)
