"""The real firmware binary in libsimavr: an ATmega328P as `world.World` takes a board."""

import atexit
import ctypes
import subprocess
import tempfile
from functools import cache
from pathlib import Path

from tests.support import ROOT
from tests.support.parts import need

FIRMWARE = ROOT / "rig/firmware"
RUNNER = Path(__file__).with_name("simavr_runner.c")
SUPPLY_V = 12.0
CYCLES_MS = 16_000
_BUILT = tempfile.TemporaryDirectory(prefix="firmware")
atexit.register(_BUILT.cleanup)
NEEDED = ("avr-gcc", "make", "cc", "simavr")


@cache
def firmware(mcu: str = "atmega328p", baud: int = 500_000) -> Path:
    """The .elf, built by the shipped Makefile; skips the test loudly where that cannot be."""
    need(*NEEDED)
    folder = f"{_BUILT.name}/{baud}"
    arguments = ["make", "-s", f"MCU={mcu}", f"BUILD={folder}", f"BAUD={baud}"]
    subprocess.run(arguments, cwd=FIRMWARE, check=True, stdout=subprocess.DEVNULL)
    return Path(folder) / f"{mcu}.elf"


@cache
def library() -> ctypes.CDLL:
    firmware()
    path = Path(_BUILT.name) / "runner.so"
    flags = ["-O2", "-shared", "-fPIC", "-w", "-I/usr/include/simavr"]
    subprocess.run(["cc", *flags, str(RUNNER), "-o", str(path), "-lsimavr", "-lelf"], check=True)
    found = ctypes.CDLL(str(path))
    found.runner_new.restype = ctypes.c_void_p
    found.runner_duty.restype = ctypes.c_double
    found.runner_cycles.restype = ctypes.c_ulonglong
    return found


class Chip:
    """One ATmega328P with the shipped firmware. `pace`: its crystal's speed against the world's."""

    def __init__(self, *, baud: int = 500_000) -> None:
        self._c = library()
        self._runner = ctypes.c_void_p(self._c.runner_new(str(firmware(baud=baud)).encode()))
        assert self._runner.value, "libsimavr cannot load the firmware"
        self._out = ctypes.create_string_buffer(65536)

    def receive(self, data: bytes) -> None:
        self._c.runner_receive(self._runner, data, len(data))

    def run_ms(self, counts: tuple[int, int], tachometer_V=(0.0, 0.0), *, pace=1.0) -> None:
        state = self._c.runner_run(self._runner, ctypes.c_double(CYCLES_MS * pace), *counts)
        assert state < 6, f"the chip has crashed (state {state})"

    def take(self) -> bytes:
        return self._out.raw[:n] if (n := self._c.runner_take(self._runner, self._out)) else b""

    def volts(self) -> tuple[float, float]:
        duty = self._c.runner_duty
        return SUPPLY_V * duty(self._runner, 0), SUPPLY_V * duty(self._runner, 1)

    def reset(self) -> None:
        self._c.runner_reset(self._runner)

    @property
    def cycles(self) -> int:
        return self._c.runner_cycles(self._runner)

    def close(self) -> None:
        self._c.runner_free(self._runner)
