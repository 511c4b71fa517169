"""A host's session with a board of ours, whatever it drives: asking, arming, hearing, ending."""

import errno
import secrets
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from math import inf
from typing import ClassVar, Self

from rig.hardware.board import wire
from rig.hardware.board.link import LINK_DEAD_S, Link, LinkLost
from rig.hardware.board.wire import Arm, ConfigAnswer, Disarm, Request, Status
from rig.hardware.observations import BoardClock
from rig.safety.late_watch import LateWatch
from rig.safety.levelling import LevelOnExit

ANSWER_S = 3.0  # an Arduino that resets on opening spends two seconds in its boot loader
ASK_AGAIN_S = 0.1
LATE_CURE = "see to its cable, plug it in without a hub, end what else loads this machine"
REASONS = {
    wire.BY_WATCHDOG: "it had no command for 100 ms",
    wire.BY_ANGLE: "an arm was beyond its angle limit",
    wire.BY_STALL: "a motor was driven and did not move (end stop, blocked, or encoder off)",
}
DRIVES = {False: "motors by volts", True: "servos by pulses"}


class BoardStopped(OSError):  # noqa: N818 - it names a board state used as a run ending
    """The board stopped driving by itself; the message says why. Outcome: "board stopped"."""

    outcome = "board stopped"

    def __str__(self) -> str:
        return self.strerror or super().__str__()


class BoardSession(LevelOnExit):
    """A board that is configured and disarmed when opened; `with` arms it.

    takes_angle, telemetry: what this kind of table drives and hears; period_s: of the board's
    telemetry, 1 to 50 whole milliseconds; longest_trip_s: of command and answer [s], inf where no
    servo loop closes over the link; clock: monotonic [s]; random_below(n): from 0 to n - 1, for the
    numbers that tell this session's packets from another's. ticks_missed: of the board; newest:
    telemetry.
    """

    takes_angle: ClassVar[bool] = False
    telemetry: ClassVar[type[Status]] = Status

    def __init__(
        self,
        link: Link,
        period_s: float,
        *,
        longest_trip_s: float = inf,
        clock: Callable[[], float] = time.monotonic,
        random_below: Callable[[int], int] = secrets.randbelow,
    ) -> None:
        self.period_s = period_s
        self.ticks_missed = 0  # of the board's: their telemetry came late or never
        self.newest: Status | None = None
        self._link, self._clock = link, clock
        self._parser, self._times = wire.Parser(), BoardClock(clock)
        self._unheard: deque[tuple[int, float]] = deque()
        self._late = LateWatch(longest_trip_s)
        self._random_below, self._sequence = random_below, random_below(65536)
        self._armed, self._closed = False, False
        self._read_us: int | None = None

    @property
    def zero_s(self) -> float:
        """Moment of the first reading on the host's monotonic clock [s]; NaN before it."""
        return self._times.zero_s

    def notes(self) -> dict[str, int]:
        """Return what a recording keeps of this link: ticks_missed and bad_frames."""
        return {"ticks_missed": self.ticks_missed, "bad_frames": self._parser.bad_frames}

    # --- before the run ---
    def _open(self, request: Callable[[], Request]) -> None:
        """Configure the board; the link is let go where that fails."""
        try:
            self._answer = self._configure(request())
        except BaseException:
            self._link.close()
            raise

    def _period_ms(self) -> int:
        period_ms = round(1000 * self.period_s)
        if not 1 <= period_ms <= 50 or abs(period_ms - 1000 * self.period_s) > 1e-6:
            raise ValueError(
                f"period_s = {self.period_s:g}: a board ticks every 1 to 50 whole milliseconds"
            )
        return period_ms

    def _configure(self, request: Request) -> ConfigAnswer:
        """Ask until the board answers. LinkLost: it does not, speaks another version, drives
        something else or refuses."""
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
        name, takes_angle = self._link.name, bool(answer.features & wire.TAKES_ANGLE)
        if answer.version != wire.VERSION:
            why = (
                f"{name} speaks version {answer.version} of the protocol, this program "
                f"{wire.VERSION}: flash rig/firmware again"
            )
        elif takes_angle != self.takes_angle:
            why = (
                f"{name} drives {DRIVES[takes_angle]}, the rig file {DRIVES[not takes_angle]}: "
                "flash the other firmware (make flash, make flash-servo) or correct the rig file"
            )
        elif answer.features & wire.REFUSED:
            why = f"{name} refuses its configuration: {self._why_refused(answer)}"
        else:
            return answer
        raise LinkLost(errno.EPROTO, why)

    def _why_refused(self, answer: ConfigAnswer) -> str:
        return "a value is out of its bounds; is its firmware older than this program?"

    def arm(self) -> None:
        """Let the board drive from now on. LinkLost: the board is lost; BoardStopped: it does not
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

    def __enter__(self) -> Self:
        if not self._armed:
            self.arm()
        return self

    # --- while it runs ---
    def _tick(self) -> tuple[Status, float]:
        """Wait for the next telemetry; return it and its time [s]. LinkLost, BoardStopped."""
        before, packet = self._read_us, self._await_telemetry()
        self._check(packet)
        self._read_us, t_s = packet.clock_us, self._times.reading()
        if before is not None:
            passed_s = 1e-6 * ((packet.clock_us - before) % 2**32)
            self.ticks_missed += max(round(passed_s / self.period_s) - 1, 0)
        return packet, t_s

    def _may_command(self, wishes: Sequence[float]) -> bool:
        """Whether the board is armed. ValueError: it is not, and should do something."""
        if self._ended is not None:
            raise self._ended
        if not self._armed and any(wishes):
            raise ValueError("the board is not armed: call arm(), or use `with table:`")
        return self._armed

    def _command(self, make: Callable[[int], wire.Packet]) -> None:
        """Send the command that `make` makes of the next sequence number."""
        self._sequence = (self._sequence + 1) % 65536
        self._send(make(self._sequence))
        self._unheard.append((self._sequence, self._clock()))

    def close(self) -> None:
        """Disarm the board, confirmed where it still answers, and let the link go.

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

    def _await_telemetry(self) -> Status:
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
                    if isinstance(packet, self.telemetry) and self._times.heard(packet.clock_us)
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

    def _check(self, packet: Status) -> None:
        """BoardStopped, LinkLost: the board does not do what it is told any more."""
        if not self._armed:
            return
        if not packet.flags & wire.ARMED:
            why = [text for flag, text in REASONS.items() if packet.flags & flag]
            told = why[0] if why else "it was reset or disarmed"
            raise self._end(BoardStopped(errno.ECANCELED, f"{self._link.name} has stopped: {told}"))
        while self._unheard and (packet.sequence - self._unheard[0][0]) % 65536 < 32768:
            self._unheard.popleft()
        now_s = self._clock()
        waits_s = now_s - self._unheard[0][1] if self._unheard else 0.0
        trip_s = max(waits_s, self._times.age_s())
        if waits_s > LINK_DEAD_S:
            why = f"deaf for {1000 * LINK_DEAD_S:.0f} ms"
        elif self._late.is_late(trip_s, now_s):
            why = self._late.why(trip_s, LATE_CURE)
        else:
            return
        raise self._end(LinkLost(errno.ETIMEDOUT, f"{self._link.name} is lost: {why}"))
