"""A board on a serial port, by pyserial."""

import errno
import os
import select
from contextlib import suppress

import serial

from rig.hardware.board.link import LINK_DEAD_S, LinkLost

# A vanished device shows by any of these, by call and by platform (termios.error is none of them).
_GONE = (OSError, serial.SerialException, TypeError)
try:
    from termios import error as _termios_error

    _GONE = (*_GONE, _termios_error)
except ImportError:  # Windows has no termios
    pass
_POSIX = os.name == "posix"
_WRITE_TIMEOUT_S = 0 if _POSIX else LINK_DEAD_S / 2  # 0: writes what there is room for
_CURES = {
    errno.ENOENT: "is it plugged in? `rig doctor` lists the ports",
    errno.EACCES: "your user may not open it: join the group dialout (rig doctor tells how)",
    errno.EBUSY: "another program holds it; close that one",
    errno.EAGAIN: "another program holds it; close that one",
    errno.EWOULDBLOCK: "another program holds it; close that one",
}


class SerialLink:
    """A board on a serial port, held alone; baud in bit/s; what: is on it, for messages.

    LinkLost: the port is not there, busy, gone or hung.
    """

    def __init__(self, port: str, baud: int = 500_000, what: str = "board") -> None:
        self.name = f"{what} on {port}"
        try:
            self._serial = serial.Serial(
                port, baud, timeout=0, write_timeout=_WRITE_TIMEOUT_S, exclusive=True
            )
            self._serial.reset_input_buffer()
            _keep_ready(self._serial)
            _hurry(self._serial)
        except _GONE as error:
            number = getattr(error, "errno", None)
            cure = _CURES.get(number or 0, "is it plugged in and free?")
            why = os.strerror(number) if number else _short(error)
            raise LinkLost(number or errno.EIO, f"{self.name}: {why}; {cure}") from None

    def send(self, data: bytes) -> None:
        """Hand all of `data` to the port. LinkLost: the port is gone or takes no bytes in time."""
        while data:
            try:
                sent = self._serial.write(data) if self._takes_bytes() else 0
            except serial.SerialTimeoutException:
                sent = 0
            except (*_GONE, ValueError) as error:
                raise self._lost(_short(error)) from None
            if not sent:
                raise self._lost("it takes no bytes any more")
            data = data[sent:]

    def _takes_bytes(self) -> bool:
        """Is there room in the device's buffer, within its patience? (pyserial's own time limit
        calls a write late whose program was late.)"""
        if not _POSIX:
            return True
        return bool(select.select([], [self._serial.fileno()], [], LINK_DEAD_S / 2)[1])

    def receive(self) -> bytes:
        """Return everything that is there now; b"" when nothing is. LinkLost: the port is gone."""
        try:
            return self._serial.read(max(self._serial.in_waiting, 1))
        except _GONE as error:
            raise self._lost(_short(error)) from None

    def wait(self, timeout_s: float) -> bool:
        """Wait at most `timeout_s` until bytes are there; return whether they are. LinkLost: it
        is gone.
        """
        try:
            if not _POSIX:  # select takes sockets only there
                return self._wait_by_reading(timeout_s)
            return bool(select.select([self._serial.fileno()], [], [], max(timeout_s, 0.0))[0])
        except (*_GONE, ValueError) as error:
            raise self._lost(_short(error)) from None

    def _wait_by_reading(self, timeout_s: float) -> bool:
        import time

        until = time.monotonic() + timeout_s
        while not self._serial.in_waiting and time.monotonic() < until:
            time.sleep(0.0005)
        return bool(self._serial.in_waiting)

    def close(self) -> None:
        """Let the port go; does nothing where it is closed or gone."""
        with suppress(*_GONE):
            self._serial.close()

    def _lost(self, why: str) -> LinkLost:
        return LinkLost(errno.EIO, f"{self.name} is lost: {why}")


def _keep_ready(port: serial.Serial) -> None:
    """Let DTR stand when the port closes: its fall and rise would reset an Arduino, and with it
    the counts that homing found, at the next opening."""
    try:
        import termios
    except ImportError:
        return
    settings = termios.tcgetattr(port.fileno())
    settings[2] &= ~termios.HUPCL
    termios.tcsetattr(port.fileno(), termios.TCSANOW, settings)


def _hurry(port: serial.Serial) -> None:
    """Have an adapter give on every byte at once: an FTDI keeps them back for 16 ms else."""
    with suppress(*_GONE, ValueError, NotImplementedError, AttributeError):  # not every one can
        port.set_low_latency_mode(True)


def _short(error: BaseException) -> str:
    """What an error says, in one line."""
    return " ".join(str(error).split()) or type(error).__name__
