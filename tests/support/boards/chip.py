"""The real firmware binary in libsimavr: a chip as `world.World` takes a board."""

import atexit
import ctypes
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from typing import NamedTuple

from tests.support import ROOT
from tests.support.parts import need

FIRMWARE = ROOT / "rig/firmware"
RUNNER = Path(__file__).with_name("simavr_runner.c")
SUPPLY_V = 12.0
CYCLES_MS = 16_000
MOST_EDGES = 4096
UNO, MEGA = "atmega328p", "atmega2560"
PULSE_PINS = {UNO: ("B1", "B2"), MEGA: ("H3", "H4", "H5")}
_BUILT = tempfile.TemporaryDirectory(prefix="firmware")
atexit.register(_BUILT.cleanup)
NEEDED = ("avr-gcc", "make", "cc", "simavr")


@cache
def firmware(mcu: str = UNO, baud: int = 500_000, kind: str = "all") -> Path:
    """The .elf, built by the shipped Makefile; skips the test loudly where that cannot be.

    kind: "all" (H-bridges) or "servo", the Makefile's words.
    """
    need(*NEEDED)
    folder = f"{_BUILT.name}/{baud}"
    arguments = ["make", "-s", kind, f"MCU={mcu}", f"BUILD={folder}", f"BAUD={baud}"]
    subprocess.run(arguments, cwd=FIRMWARE, check=True, stdout=subprocess.DEVNULL)
    return Path(folder) / (f"{mcu}-servo.elf" if kind == "servo" else f"{mcu}.elf")


@cache
def library() -> ctypes.CDLL:
    need(*NEEDED)
    path = Path(_BUILT.name) / "runner.so"
    flags = ["-O2", "-shared", "-fPIC", "-w", "-I/usr/include/simavr"]
    subprocess.run(["cc", *flags, str(RUNNER), "-o", str(path), "-lsimavr", "-lelf"], check=True)
    found = ctypes.CDLL(str(path))
    found.runner_new.restype = ctypes.c_void_p
    found.runner_duty.restype = ctypes.c_double
    found.runner_cycles.restype = ctypes.c_ulonglong
    return found


class _Simulated:
    """One chip with a firmware. `pace`: its crystal's speed against the world's."""

    def __init__(self, elf: Path, mcu: str) -> None:
        self._c = library()
        self._runner = ctypes.c_void_p(self._c.runner_new(str(elf).encode(), mcu.encode()))
        assert self._runner.value, "libsimavr cannot load the firmware"
        self._out = ctypes.create_string_buffer(65536)

    def receive(self, data: bytes) -> None:
        self._c.runner_receive(self._runner, data, len(data))

    def _run(self, counts: tuple[int, int], pace: float) -> None:
        state = self._c.runner_run(self._runner, ctypes.c_double(CYCLES_MS * pace), *counts)
        assert state < 6, f"the chip has crashed (state {state})"

    def take(self) -> bytes:
        return self._out.raw[:n] if (n := self._c.runner_take(self._runner, self._out)) else b""

    def reset(self) -> None:
        self._c.runner_reset(self._runner)

    @property
    def cycles(self) -> int:
        return self._c.runner_cycles(self._runner)

    def close(self) -> None:
        self._c.runner_free(self._runner)


class Chip(_Simulated):
    """An ATmega328P with the firmware of two H-bridges."""

    def __init__(self, *, baud: int = 500_000) -> None:
        super().__init__(firmware(baud=baud), UNO)

    def run_ms(self, counts: tuple[int, int], tachometer_V=(0.0, 0.0), *, pace=1.0) -> None:
        self._run(counts, pace)

    def volts(self) -> tuple[float, float]:
        duty = self._c.runner_duty
        return SUPPLY_V * duty(self._runner, 0), SUPPLY_V * duty(self._runner, 1)


class Pulse(NamedTuple):
    """A pulse at a pin: servo, when it began [us on the chip's clock], how long it was [us]."""

    servo: int
    begin_us: float
    us: float


class PulseChip(_Simulated):
    """A chip with the firmware of hobby servos; every pulse is measured at its pin."""

    def __init__(self, mcu: str = UNO) -> None:
        super().__init__(firmware(mcu, kind="servo"), mcu)
        for servo, (port, bit) in enumerate(PULSE_PINS[mcu]):
            self._c.runner_watch(self._runner, ctypes.c_char(port.encode()), int(bit), servo)
        self._edges = (ctypes.c_ulonglong * (3 * MOST_EDGES))()
        self._began_us: dict[int, float] = {}
        self.pulses: list[Pulse] = []

    def run_ms(self, *, pace=1.0) -> None:
        self._run((0, 0), pace)
        edges = self._edges[: 3 * self._c.runner_edges(self._runner, self._edges)]
        for cycle, servo, level in zip(edges[::3], edges[1::3], edges[2::3], strict=True):
            at_us = cycle / 16
            if level:
                self._began_us[servo] = at_us
            else:
                begin_us = self._began_us.pop(servo)
                self.pulses.append(Pulse(servo, begin_us, at_us - begin_us))

    def is_high(self) -> bool:
        """Whether a pulse is on now."""
        return bool(self._began_us)

    def pulses_us(self) -> tuple[float, ...]:
        """The newest pulse of each servo [us]; 0 where none came within the longest two frames."""
        newest = dict.fromkeys(range(3), 0.0)
        for pulse in self.pulses[-12:]:
            if self.cycles / 16 - pulse.begin_us < 43_000:
                newest[pulse.servo] = pulse.us
        return tuple(newest.values())
