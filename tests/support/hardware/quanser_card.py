"""A stand-in for the vendor's module: types, ranges, order of calls enforced; the plant behind."""

import sys
import time
from enum import IntEnum
from types import ModuleType

import numpy as np

STEP_RAD = 2 * np.pi / 4096
RAD_S_V = 1000 / 60 * 2 * np.pi / 1.5 / 70  # SRV02 manual, at the load shaft


class HILError(Exception):
    def get_error_message(self) -> str:
        return str(self.args[0])


class Clock(IntEnum):
    HARDWARE_CLOCK_0 = 0


class EncoderQuadratureMode(IntEnum):
    X4 = 4


class Bench:
    """What is screwed to the card: a table with its cables, an amplifier, and faults to come."""

    def __init__(self, table, *, gain=1.0, swap=False, volt_signs=(1, 1), count_signs=(1, 1)):
        self.table, self.gain, self.swap = table, gain, swap
        self.volt_signs, self.count_signs = volt_signs, count_signs
        self.offset = np.array([0, 0])
        self.calls: list[str] = []
        self.outputs = np.zeros(2)
        self.reading = table.read()  # what the first tick shows
        self.ticks = 0
        self.t_s = 0.0
        self.fails: dict[str, str] = {}  # call -> message
        self.hangs: set[str] = set()
        self.watchdog_s: float | None = None
        self.reloaded_s = 0.0
        self.expired = False
        self.motor_V = (0.0, 0.0)
        self.widest_rad = 0.0  # that an arm went, either way
        self.waiting: list[np.ndarray] = []  # samples that nobody read yet
        self.room = 0

    def clock(self) -> float:
        return self.t_s

    def tick(self) -> None:
        if self.watchdog_s is not None and self.t_s - self.reloaded_s > self.watchdog_s:
            self.expired, self.outputs = True, np.zeros(2)
        self.ticks += 1
        if self.ticks == 1:
            return
        a, b = np.array(self.volt_signs) * self.outputs * self.gain
        self.motor_V = (float(b), float(a)) if self.swap else (float(a), float(b))
        self.table.drive(self.motor_V)
        self.reading = self.table.read()
        self.t_s = self.reading.t_s
        self.widest_rad = max(self.widest_rad, *np.abs(self.table.truth()["arm_rad"]))

    def hold_up(self, ticks: int) -> None:
        """The program does nothing for so many ticks, while the card and the arms go on."""
        for _ in range(ticks):
            self.tick()
            self.waiting.append(self.counts())

    def sample(self) -> np.ndarray:
        """Counts of the oldest tick that nobody read; of the next one where there is none."""
        if len(self.waiting) > self.room:
            raise HILError("The buffer has overflowed")
        if not self.waiting:
            self.hold_up(1)
        return self.waiting.pop(0)

    def by_channel(self, xy) -> np.ndarray:
        return np.array(xy[::-1] if self.swap else xy)

    def counts(self) -> np.ndarray:
        turned = np.round(self.by_channel(self.reading.theta_rad) / STEP_RAD)
        return (np.array(self.count_signs) * turned).astype(int) + self.offset

    def latest(self, after_s: float):  # an eye
        ball = self.reading.ball
        return ball if ball is not None and ball.exposed_s > after_s else None


def _channels(channels, count) -> None:
    assert channels.dtype in (np.uint32, np.int32), "channels are 32-bit integers"
    assert count == len(channels)
    assert set(channels) <= {0, 1}


class Card:
    """`HIL` of the vendor's module, on one bench."""

    INFINITE = -1
    bench: Bench

    def __init__(self, card_type: str, identifier: str) -> None:
        self.opened = False
        self._note("open")
        assert (card_type, identifier) == ("q2_usb", "0")
        assert isinstance(identifier, str)
        self.opened, self.started, self.quadrature = True, None, False

    def _note(self, call: str) -> None:
        self.bench.calls.append(call)
        if call in self.bench.hangs:
            time.sleep(3.0)
        if call in self.bench.fails:
            raise HILError(self.bench.fails[call])
        assert self.opened or call == "open", f"{call} on a closed card"

    def is_valid(self) -> bool:
        self._note("is_valid")
        return True

    def set_card_specific_options(self, options: str, length: int) -> None:
        self._note("options")
        assert isinstance(options, str)
        assert len(options) <= length

    def set_encoder_quadrature_mode(self, channels, count, modes) -> None:
        self._note("quadrature")
        _channels(channels, count)
        assert modes.dtype == np.int32
        assert list(modes) == [4, 4]
        self.quadrature = True

    def set_encoder_counts(self, channels, count, counts) -> None:
        self._note("set_counts")
        _channels(channels, count)
        assert counts.dtype == np.int32
        assert np.abs(counts).max() < 2**23
        assert not self.bench.outputs.any(), "counters are set at rest"
        self.bench.offset = self.bench.offset + counts - self.bench.counts()

    def read_encoder(self, channels, count, counts) -> None:
        self._note("read_encoder")
        _channels(channels, count)
        assert counts.dtype == np.int32
        counts[:] = self.bench.counts()

    def read_analog(self, channels, count, volts) -> None:
        self._note("read_analog")
        _channels(channels, count)
        assert volts.dtype == np.float64
        assert len(volts) == count
        speeds = self.bench.by_channel(self.bench.reading.motor_speed_rad_s)
        volts[:] = np.array(self.bench.volt_signs) * speeds / RAD_S_V

    def write_analog(self, channels, count, volts) -> None:
        self._note("write_analog")
        _channels(channels, count)
        assert isinstance(volts, np.ndarray)
        assert volts.dtype == np.float64
        assert np.all(np.abs(volts) <= 10.0), "outputs reach 10 V"
        if not self.bench.expired:
            self.bench.outputs = volts.copy()

    def task_create_encoder_reader(self, room, channels, count) -> int:
        self._note("create")
        _channels(channels, count)
        assert isinstance(room, int)
        assert room >= 1
        self.bench.room = room
        assert self.quadrature
        return 7

    def task_start(self, task, clock, rate, samples) -> None:
        self._note("start")
        assert (task, clock, samples) == (7, Clock.HARDWARE_CLOCK_0, self.INFINITE)
        assert isinstance(rate, float)
        self.started = task

    def task_read_encoder(self, task, samples, counts) -> int:
        self._note("task_read")
        assert task == self.started
        assert counts.dtype == np.int32
        assert len(counts) == 2 * samples
        for i in range(samples):
            counts[2 * i : 2 * i + 2] = self.bench.sample()
        return samples

    def task_stop(self, task) -> None:
        self._note("stop")
        assert task == self.started

    def task_delete(self, task) -> None:
        self._note("delete")
        self.started = None

    def watchdog_set_analog_expiration_state(self, channels, count, volts) -> None:
        self._note("watchdog_state")
        _channels(channels, count)
        assert volts.dtype == np.float64
        assert not volts.any()

    def watchdog_start(self, seconds: float) -> None:
        self._note("watchdog_start")
        assert 0.01 <= seconds <= 1.0
        self.bench.watchdog_s, self.bench.reloaded_s = seconds, self.bench.t_s

    def watchdog_reload(self) -> bool:
        self._note("watchdog_reload")
        self.bench.reloaded_s = self.bench.t_s
        return not self.bench.expired

    def watchdog_clear(self) -> None:
        self._note("watchdog_clear")
        self.bench.expired = False

    def watchdog_stop(self) -> None:
        self._note("watchdog_stop")
        self.bench.watchdog_s = None

    def close(self) -> None:
        self._note("close")
        self.opened = False


def install(monkeypatch, bench: Bench, *, without: tuple[str, ...] = ()) -> Bench:
    """Put the stand-in where `import quanser.hardware` finds it."""
    package, module = ModuleType("quanser"), ModuleType("quanser.hardware")
    methods = dict.fromkeys(without)
    kept = {k: v for k, v in vars(Card).items() if k not in methods and not k.startswith("__")}
    kept |= {"__init__": Card.__init__, "bench": bench}
    vars(module).update(HIL=type("HIL", (), kept), HILError=HILError, Clock=Clock)
    vars(module).update(EncoderQuadratureMode=EncoderQuadratureMode, MAX_STRING_LENGTH=4096)
    package.hardware = module  # pyright: ignore[reportAttributeAccessIssue]
    monkeypatch.setitem(sys.modules, "quanser", package)
    monkeypatch.setitem(sys.modules, "quanser.hardware", module)
    return bench
