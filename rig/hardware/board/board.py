"""A table on a board of ours: packets behind `read / drive / close`, whatever the cable."""

import errno
import math
import secrets
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from math import pi
from types import TracebackType

from rig.hardware.board import wire
from rig.hardware.board.link import LINK_DEAD_S, Link, LinkLost
from rig.hardware.board.wire import Arm, Command, ConfigAnswer, ConfigRequest, Disarm, Telemetry
from rig.hardware.observations import BoardClock, ObservationFeed, ObservationSource
from rig.hardware.wiring import Wiring
from rig.safety.levelling import LevelOnExit
from rig.table import Reading

ANSWER_S = 3.0  # an Arduino that resets on opening spends two seconds in its boot loader
ASK_AGAIN_S = 0.1
COMMAND_TTL_S = 0.02
# SRV02: 1.5 V per 1000 rpm of the motor, 70 turns of which are one of the load shaft.
TACHOMETER_RAD_S_V = 1000 / 1.5 * 2 * pi / 60 / 70
REASONS = {
    wire.BY_WATCHDOG: "it had no command for 100 ms",
    wire.BY_ANGLE: "an arm was beyond its angle limit",
    wire.BY_STALL: "a motor was driven and did not move (end stop, blocked, or encoder off)",
}


class BoardStopped(OSError):  # noqa: N818 - it names a board state used as a run ending
    """The board took the volts away by itself; the message says why. Outcome: "board stopped"."""

    outcome = "board stopped"

    def __str__(self) -> str:
        return self.strerror or super().__str__()


class BoardTable(LevelOnExit):
    """A table on a serial or USB board: configured and disarmed when opened; `with` arms it.

    The board's tick is the loop's: `read` waits for its next telemetry, of several the newest.
    time_constant_s, top_speed_rad_s: of the servo at voltage_limit_V, by which the board brakes.
    homed False: the zeros are not known yet, so the board keeps to 1.5 V and does not level. eye:
    where observations of the ball come from; tachometer_rad_s_V: speed at the load shaft per volt
    of the tachometer; clock: monotonic [s]; random_below(n): from 0 to n - 1, for the numbers that
    tell this session's packets from another's. ticks_missed: of the board; newest: telemetry.
    ValueError: a period or a field that the board cannot take. LinkLost: the board does not answer
    or speaks another version.
    """

    def __init__(
        self,
        link: Link,
        wiring: Wiring | None = None,
        *,
        period_s: float = 0.002,
        voltage_limit_V: float = 6.0,
        angle_limit_rad: float = pi / 6,
        time_constant_s: float = 0.025,
        top_speed_rad_s: float = 9.18,
        homed: bool = True,
        eye: ObservationSource | None = None,
        tachometer_rad_s_V: float = TACHOMETER_RAD_S_V,
        clock: Callable[[], float] = time.monotonic,
        random_below: Callable[[int], int] = secrets.randbelow,
    ) -> None:
        self.period_s, self.voltage_limit_V = period_s, voltage_limit_V
        self.ticks_missed = 0  # of the board's: their telemetry came late or never
        self.newest: Telemetry | None = None
        self._link, self._wiring, self._feed = link, wiring or Wiring(), ObservationFeed(eye)
        self._tachometer, self._clock = tachometer_rad_s_V, clock
        self._parser, self._times = wire.Parser(), BoardClock(clock)
        self._unheard: deque[tuple[int, float]] = deque()
        self._random_below, self._sequence = random_below, random_below(65536)
        self._armed, self._ended, self._closed = False, None, False
        self._read_us: int | None = None
        try:
            servo = (time_constant_s, top_speed_rad_s)
            self._answer = self._configure(self._request(angle_limit_rad, servo, homed))
        except BaseException:
            link.close()
            raise

    @property
    def is_fresh(self) -> bool:
        """Whether the board was reset and not opened since: its counts mean nothing then."""
        return bool(self._answer.features & wire.IS_FRESH)

    @property
    def zero_s(self) -> float:
        """Moment of the first reading on the host's monotonic clock [s]; NaN before it."""
        return self._times.zero_s

    def notes(self) -> dict[str, int]:
        """Return what a recording keeps of this link: ticks_missed and bad_frames."""
        return {"ticks_missed": self.ticks_missed, "bad_frames": self._parser.bad_frames}

    # --- before the run ---
    def _request(
        self, angle_limit_rad: float, servo: tuple[float, float], homed: bool
    ) -> ConfigRequest:
        wiring, period_ms = self._wiring, round(1000 * self.period_s)
        if not 1 <= period_ms <= 50 or abs(period_ms - 1000 * self.period_s) > 1e-6:
            raise ValueError(
                f"period_s = {self.period_s:g}: a board ticks every 1 to 50 whole milliseconds"
            )
        negative = [polarity < 0 for polarity in wiring.polarities()]
        bits = homed | negative[0] << 1 | negative[1] << 2 | wiring.crossed << 3
        return ConfigRequest(
            wire.VERSION,
            self._random_below(65536),
            period_ms,
            bits,
            *wiring.zero_counts,
            wiring.counts_per_rev,
            round(angle_limit_rad / wiring.step_rad),
            round(1000 * self.voltage_limit_V),
            *(min(max(math.ceil(1000 * number), 1), 65535) for number in servo),
        )

    def _configure(self, request: ConfigRequest) -> ConfigAnswer:
        """Ask until the board answers. LinkLost: it does not, or speaks another version."""
        until = self._clock() + ANSWER_S
        while self._clock() < until:
            self._link.send(b"\0" + wire.encode(request))  # the zero ends whatever was half sent
            again = self._clock() + ASK_AGAIN_S
            while (now := self._clock()) < again:
                for packet in self._parser.feed(self._link.receive()):
                    if isinstance(packet, ConfigAnswer) and packet.nonce == request.nonce:
                        self._times.heard(packet.clock_us)
                        return self._checked(packet)
                self._link.wait(again - now)
        raise LinkLost(
            errno.ETIMEDOUT,
            f"{self._link.name} does not answer: is our firmware on it, and the baud rate right?",
        )

    def _checked(self, answer: ConfigAnswer) -> ConfigAnswer:
        if answer.version == wire.VERSION:
            return answer
        raise LinkLost(
            errno.EPROTO,
            f"{self._link.name} speaks version {answer.version} of the protocol, this program "
            f"{wire.VERSION}: flash rig/firmware again",
        )

    def arm(self) -> None:
        """Let volts flow from now on. LinkLost: the board is lost; BoardStopped: it does not
        confirm.
        """
        word = Arm(self._answer.token, self._sequence)
        until = self._clock() + LINK_DEAD_S
        try:
            while self._clock() < until:
                self._send(word)  # again and again: it arms but once
                if self._await_telemetry().flags & wire.ARMED:
                    self._armed = True
                    self._read_us = None  # ticks heard here are none that were missed
                    return
            raise self._end(BoardStopped(errno.EPERM, f"{self._link.name} does not arm"))
        except BaseException:  # it may have heard us, though we did not hear it
            with suppress(OSError):
                self._link.send(wire.encode(Disarm()))
            raise

    def __enter__(self) -> "BoardTable":
        if not self._armed:
            self.arm()
        return self

    # --- the contract ---
    def read(self) -> Reading:
        """Wait for the board's next telemetry and return its reading.

        LinkLost: the board vanished, is silent or deaf (raised within 100 ms). BoardStopped: it
        took the volts away by itself. CameraStopped: the camera of `eye` failed.
        """
        before, packet = self._read_us, self._await_telemetry()
        self._check(packet)
        self._read_us, t_s = packet.clock_us, self._times.reading()
        if before is not None:
            passed_s = 1e-6 * ((packet.clock_us - before) % 2**32)
            self.ticks_missed += max(round(passed_s / self.period_s) - 1, 0)
        speeds = None
        if isinstance(packet, wire.TelemetryWithTachometer):
            x, y = self._wiring.from_board(
                (packet.tachometer_0_mV / 1000, packet.tachometer_1_mV / 1000)
            )
            speeds = (self._tachometer * x, self._tachometer * y)
        return Reading(
            t_s, self._wiring.angles((packet.count_0, packet.count_1)), speeds, self._feed.take(t_s)
        )

    def drive(self, volts: tuple[float, float]) -> None:
        """Command volts (x, y), which the board applies for 20 ms at most without a newer command.

        ValueError: volts that are not finite, or other than 0 V on a board that is not armed.
        LinkLost, BoardStopped: the board is lost or has stopped.
        """
        if not all(map(math.isfinite, volts)):
            raise ValueError(f"volts must be finite, got {volts}; use rig.safety.limits.limit")
        if self._ended is not None:
            raise self._ended
        if not self._armed:
            if any(volts):
                raise ValueError("the board is not armed: call arm(), or use `with table:`")
            return
        limit = self.voltage_limit_V
        mV = [round(1000 * min(max(v, -limit), limit)) for v in self._wiring.to_board(volts)]
        self._sequence = (self._sequence + 1) % 65536
        self._send(Command(self._sequence, round(1000 * COMMAND_TTL_S), *mV))
        self._unheard.append((self._sequence, self._clock()))

    def close(self) -> None:
        """Disarm the board at 0 V, confirmed where it still answers, and let the link go.

        A board that has stopped by itself levels the plate alone and is told nothing more.
        """
        if self._closed:
            return
        self._closed = True
        try:
            if self._ended is None:  # else it levels by itself, and a word would stop it
                self._disarm()
        except OSError:
            pass  # it is gone: its watchdog does the rest
        finally:
            self._link.close()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._ended is not None:
            self.close()
        else:
            super().__exit__(kind, error, trace)

    # --- the cable ---
    def _disarm(self) -> None:
        self._armed = False
        until = self._clock() + LINK_DEAD_S
        while self._clock() < until:
            self._send(Disarm())
            if not self._await_telemetry().flags & wire.ARMED:
                return

    def _send(self, packet: wire.Packet) -> None:
        try:
            self._link.send(wire.encode(packet))
        except LinkLost as error:
            raise self._end(error) from None

    def _await_telemetry(self) -> Telemetry:
        """The newest telemetry not yet read; waits for one. LinkLost after `LINK_DEAD_S`."""
        if self._ended is not None:
            raise self._ended
        until = self._clock() + LINK_DEAD_S
        try:
            while True:
                packets = self._parser.feed(self._link.receive())
                found = [
                    packet
                    for packet in packets
                    if isinstance(packet, Telemetry) and self._times.heard(packet.clock_us)
                ]
                if found and self._times.age_s() < LINK_DEAD_S:
                    self.newest = found[-1]
                    return found[-1]
                if (left := until - self._clock()) <= 0:
                    break
                self._link.wait(left)
        except LinkLost as error:
            raise self._end(error) from None
        why = f"{self._link.name} is lost: silent for {1000 * LINK_DEAD_S:.0f} ms"
        raise self._end(LinkLost(errno.ETIMEDOUT, why))

    def _check(self, packet: Telemetry) -> None:
        """BoardStopped, LinkLost: the board does not do what it is told any more."""
        if not self._armed:
            return
        if not packet.flags & wire.ARMED:
            why = [text for flag, text in REASONS.items() if packet.flags & flag]
            told = why[0] if why else "it was reset or disarmed"
            raise self._end(BoardStopped(errno.ECANCELED, f"{self._link.name} has stopped: {told}"))
        while self._unheard and (packet.sequence - self._unheard[0][0]) % 65536 < 32768:
            self._unheard.popleft()
        if self._unheard and self._clock() - self._unheard[0][1] > LINK_DEAD_S:
            why = f"{self._link.name} is lost: deaf for {1000 * LINK_DEAD_S:.0f} ms"
            raise self._end(LinkLost(errno.ETIMEDOUT, why))

    def _end(self, error: OSError) -> OSError:
        """Remember how it ended: every later call says the same."""
        self._ended = error
        return error
