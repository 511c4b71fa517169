"""A table on a Quanser Q2-USB card, through the vendor's own Python module. NOT YET RUN ON A CARD:

what is known of the module comes from the vendor's published examples; the test is a stand-in that
enforces their types, ranges and order of calls. The card's driver exists for Windows only, the
module `quanser.hardware` comes with the vendor's SDK.
"""

import math
import time
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np

from rig.hardware.board.link import LinkLost
from rig.hardware.observations import ObservationFeed, ObservationSource, TickClock
from rig.hardware.quanser.daemon_executor import OneThread
from rig.hardware.wiring import Wiring
from rig.parameters import GEAR_RATIO_HIGH, Rig
from rig.safety.levelling import LevelOnExit
from rig.safety.limits import CATCH_TAUS
from rig.table import Reading

CARD = "q2_usb"
OUTPUT_LIMIT_V = 10.0  # of the card's analog outputs
# As the boards drop a command (COMMAND_TTL_S): full volts that stayed for 50 ms beyond their tick
# throw an arm into its stop, after 20 ms it can still be braked. The card gives 0 V then, by which
# an arm is not braked but coasts on: a program that was late and is there again brakes it.
WATCHDOG_S = 0.02
REST_S = 1.0  # chosen: so long after that, and the arms' own time, they have come to rest
BUFFER_S = 1.0  # of samples; the card fails where more of them wait, as after a longer pause
PATIENCE_S = 0.09  # a call that takes longer: the card is gone
OPEN_PATIENCE_S = 15.0  # the driver may load firmware first
# SRV02 manual: 1.50 V per 1000 rpm of the motor's shaft.
TACHOMETER_RAD_S_V = 1000 / 60 * 2 * math.pi / 1.50
_SHORT = ("set_analog_expiration_state", "start", "reload", "clear", "stop")
WATCHDOG_CALLS = tuple(f"watchdog_{name}" for name in _SHORT)
EXPIRED = (
    f"its watchdog expired (the loop was silent for {1000 * WATCHDOG_S:.0f} ms): the motors are at "
    "0 V; run again"
)


class _ExpiredError(Exception):
    """The card's watchdog had run out before this command."""


class QuanserTable(LevelOnExit):
    """A table on a Quanser Q2-USB card: encoders and, where wired, tachometers in, two amplifiers
    out.

    `read` waits for the card's hardware clock. Motor volts are clamped at the servo's limit and
    divided by the amplifier's gain. The card's own watchdog gives 0 V when the program hangs for
    20 ms. One that is there again has the card take volts once more, until its arms have had time
    to come to rest; every reading tells meanwhile that the table is `lost`. Every call is made from
    one thread and given up after 90 ms. homed False: it is never levelled. LinkLost: the vendor's
    module is missing, or the card is not there, without a watchdog, or gone.
    """

    boot_id: str | None = None  # the card has none: `shift_counts` marks its counters instead

    def __init__(
        self,
        rig: Rig,
        wiring: Wiring,
        *,
        eye: ObservationSource | None = None,
        homed: bool = True,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.period_s = 1 / rig.control_rate_hz
        self._gain = rig.table.amplifier_gain
        self.voltage_limit_V = min(rig.servo.voltage_limit_V, OUTPUT_LIMIT_V * self._gain)
        self._wiring, self._tachometer = wiring, rig.servo.tachometer
        self._name = f"Quanser card {CARD} {rig.table.address or '0'}"
        self._clock, self._time, self._feed = clock, TickClock(), ObservationFeed(eye)
        self._channels = np.array([0, 1], np.uint32)
        self._counts, self._inputs = np.zeros(2, np.int32), np.zeros(2)
        self._ticks, self._arrived_s, self._drives = 0, -math.inf, False
        self._dead = self._hung = ""
        self._fed_s, self._expired_s = -math.inf, math.inf  # by `clock`
        self._rest_s = REST_S + CATCH_TAUS * rig.servo.time_constant_s
        self._card: Any = None
        self._task: Any = None
        self._sdk = _sdk()
        self._thread = OneThread("quanser")
        if not homed:
            self.level_s = 0.0  # nobody knows where level is
        try:
            self._start(rig)
        except BaseException:
            self.close()
            raise

    def _start(self, rig: Rig) -> None:
        """Open, options, watchdog cleared, 0 V, expiry 0 V, quadrature, encoder task, watchdog."""
        sdk, channels, zero = self._sdk, self._channels, np.zeros(2)
        address = rig.table.address or "0"
        self._card = self._call("open", sdk.HIL, CARD, address, patience_s=OPEN_PATIENCE_S)
        if not self._ask("is_valid"):
            raise self._lost("is not valid after opening; plug it in anew")
        watchdog = [name for name in WATCHDOG_CALLS if not hasattr(self._card, name)]
        if watchdog:
            raise self._lost(
                f"this SDK has no {watchdog[0]}: without the card's watchdog a hung program would "
                "leave volts on the motors; install a newer Quanser SDK"
            )
        if options := rig.table.card_options:
            longest = getattr(sdk, "MAX_STRING_LENGTH", len(options))
            self._ask("set_card_specific_options", options, longest)
        self._ask("watchdog_clear")
        self._ask("write_analog", channels, 2, zero)
        self._ask("watchdog_set_analog_expiration_state", channels, 2, zero)
        x4 = np.array([int(sdk.EncoderQuadratureMode.X4)] * 2, np.int32)
        self._ask("set_encoder_quadrature_mode", channels, 2, x4)
        room = math.ceil(BUFFER_S / self.period_s)
        self._task = self._ask("task_create_encoder_reader", room, channels, 2)
        clock, rate = sdk.Clock.HARDWARE_CLOCK_0, 1 / self.period_s
        self._ask("task_start", self._task, clock, rate, sdk.HIL.INFINITE)
        self._ask("watchdog_start", WATCHDOG_S)

    @property
    def zero_s(self) -> float:
        """Moment of the first reading on the host's monotonic clock [s]; NaN before it."""
        return self._time.zero_s

    def read(self) -> Reading:
        """Wait for the card's next tick and return its reading.

        LinkLost: the card is gone, or its watchdog expired and the arms had time to come to rest.
        CameraStopped: the camera of `eye` failed.
        """
        if self._clock() - self._expired_s > self._rest_s:
            raise self._lost(EXPIRED)
        counts = self._next_counts()
        t_s = self._time.time(self._ticks * self.period_s, self._arrived_s, self.period_s)
        speed = self._speeds() if self._tachometer else None
        x, y = self._wiring.angles((int(counts[0]), int(counts[1])))
        lost = f"{self._name}: {EXPIRED}" if self._expired_s < math.inf else ""
        return Reading(t_s, (x, y), speed, self._feed.take(t_s), lost)

    def _next_counts(self) -> np.ndarray:
        """The newest sample; after a late tick the ones that were missed are read over at once."""
        late = (self._clock() - self._arrived_s) / self.period_s
        samples = int(late) if 2 <= late < math.inf else 1
        buffer = self._counts if samples == 1 else np.zeros(2 * samples, np.int32)
        got = self._call("task_read_encoder", self._sample, samples, buffer)
        if got < 1:
            raise self._lost("its encoder task ended")
        self._arrived_s = self._clock()
        self._ticks += got
        return buffer[2 * (got - 1) : 2 * got]

    def _sample(self, samples: int, buffer: np.ndarray) -> int:
        """In the driver's thread: wait for the card's tick, then read the tachometers."""
        got = self._card.task_read_encoder(self._task, samples, buffer)
        if self._tachometer:
            self._card.read_analog(self._channels, 2, self._inputs)
        return samples if got is None else int(got)

    def _speeds(self) -> tuple[float, float]:
        """Motor speeds at the load shaft's scale; a tachometer's plus follows its motor's."""
        first, second = self._inputs * (TACHOMETER_RAD_S_V / GEAR_RATIO_HIGH)
        return self._wiring.from_board((float(first), float(second)))

    def drive(self, volts: tuple[float, float]) -> None:
        """Apply volts (x, y) without waiting; what goes wrong is raised by the next `read`.

        ValueError: volts that are not finite. LinkLost: the card is lost.
        """
        if not all(map(math.isfinite, volts)):
            raise ValueError(f"volts must be finite, got {volts}; use rig.safety.limits.limit")
        if self._dead:
            raise LinkLost(self._dead)
        out = np.array(self._wiring.to_board(volts), np.float64)
        out = np.clip(out, -self.voltage_limit_V, self.voltage_limit_V) / self._gain
        self._thread.post(self._put, out)

    def _put(self, out: np.ndarray) -> None:
        """In the driver's thread: feed the watchdog, then the amplifiers.

        One that expired while 0 V were told (before the first tick, say) has cut off nothing: it
        begins anew. So does, once, one that expired because nobody fed it: the arms are to be
        braked.
        """
        fed_s, self._fed_s = self._fed_s, self._clock()
        if self._card.watchdog_reload() is False:
            now_s = self._clock()
            if self._drives:
                if now_s - fed_s <= WATCHDOG_S or self._expired_s < math.inf:
                    raise _ExpiredError
                self._expired_s = now_s
            self._card.watchdog_clear()
            self._card.watchdog_start(WATCHDOG_S)
        self._drives = bool(out.any())
        self._card.write_analog(self._channels, 2, out)

    def shift_counts(self, by: tuple[int, int]) -> None:
        """Add `by` (channel 0, 1) to the card's counters, at rest, to mark them as homed.

        After a power-up they are seen to be others. LinkLost: the card is gone.
        """
        now = np.zeros(2, np.int32)
        self._ask("read_encoder", self._channels, 2, now)
        self._ask("set_encoder_counts", self._channels, 2, now + np.array(by, np.int32))

    def close(self) -> None:
        """Give 0 V, then stop, delete and close: each tried whatever became of the one before.

        LinkLost: a step failed on a card that was not lost before.
        """
        if self._card is None:
            return
        was_dead = bool(self._dead)
        steps: list[tuple] = [("write_analog", self._channels, 2, np.zeros(2))]
        if self._task is not None:
            steps += [("task_stop", self._task), ("task_delete", self._task)]
        if hasattr(self._card, "watchdog_stop"):
            steps.append(("watchdog_stop",))
        failed: OSError | None = None
        for name, *arguments in [*steps, ("close",)]:
            self._dead = self._hung
            try:
                self._ask(name, *arguments)
            except OSError as error:
                failed = failed or error
        self._card, self._dead = None, f"{self._name}: is closed"
        self._thread.end()
        if failed is not None and not was_dead:
            raise failed

    def _ask(self, name: str, *arguments: Any) -> Any:
        return self._call(name, getattr(self._card, name), *arguments)

    def _call(
        self, what: str, function: Callable, *arguments: Any, patience_s: float | None = None
    ) -> Any:
        """One call of the SDK; `LinkLost` in one line for whatever goes wrong with it."""
        if self._dead:
            raise LinkLost(self._dead)
        try:
            return self._thread.call(function, *arguments, patience_s=patience_s or PATIENCE_S)
        except TimeoutError as error:
            lost = self._lost(f"{error} ({what}); is its cable in?")
            self._hung = self._dead  # nothing more is asked of a driver that hangs
            raise lost from None
        except _ExpiredError:
            raise self._lost(EXPIRED) from None
        except self._sdk.HILError as error:
            said = " ".join(str(getattr(error, "get_error_message", error.__str__)()).split())
            cure = "" if self._task else "; is it plugged in, and no other program using it?"
            raise self._lost(f"{said} ({what}){cure}") from error

    def _lost(self, why: str) -> LinkLost:
        self._dead = f"{self._name}: {why}"
        return LinkLost(self._dead)


def _sdk() -> Any:
    """The vendor's module. `LinkLost` with the cure where it is not installed."""
    try:
        return import_module("quanser.hardware")
    except ImportError as error:
        raise LinkLost(
            f"the Quanser card needs the vendor's Python module quanser.hardware ({error}): "
            'install the Quanser SDK, or run "rig serve" where it is and use kind = "remote"'
        ) from None
