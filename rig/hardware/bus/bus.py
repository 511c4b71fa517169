"""A table on a bus of servos that take an angle and tell theirs: `read / drive / close`.

Every tick asks all servos for their state in one packet and tells all goals in another. Nobody
limits a goal's rate here: the servos' own speed registers do, at the rig file's rate limit, so that
what is recorded is what was told.
"""

import errno
import math
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from math import inf, pi
from types import TracebackType

from rig.hardware.board.link import LINK_DEAD_S, Link, LinkLost
from rig.hardware.bus.vendor import Block, Present, Setup, Status, Vendor
from rig.hardware.observations import FromFirst, ObservationFeed, ObservationSource
from rig.hardware.wiring import Pair, Wiring
from rig.loop.ticker import Ticker, sleep_until
from rig.safety.levelling import LevelOnExit
from rig.safety.limits import limit_angle
from rig.table import Reading

ANSWER_S = 0.5  # chosen: an adapter that was just plugged in is slow at first
ASK_AGAIN_S = 0.02  # chosen: above the 16 ms for which an FTDI adapter may keep an answer back
HEALTH_S = 0.1  # torque, watchdog and hardware errors are looked at so often
START_RAD_S = 0.5  # chosen: a plate that is brought level by itself does so in a second, slowly
ARRIVED_RAD, ARRIVE_S = 0.04, 4.0  # as homing has it
BUSY = 0.8  # of a tick at most: the adapter and the servos need time of their own
ANSWERS_AFTER_S = 0.5e-3  # of a servo as it is delivered (return delay: 250 x 2 us)
USB_FRAME_S = 1e-3  # so long an answer may wait in the adapter for its next frame (full speed)


class ServoAlarm(OSError):  # noqa: N818 - it names a state used as a run ending
    """A servo reports that it cannot go on; the message says which, and why. Outcome: "servo
    alarm".
    """

    outcome = "servo alarm"

    def __str__(self) -> str:
        return self.strerror or super().__str__()


def check_period(vendor: Vendor, servos: int, baud: int, period_s: float) -> None:
    """Raise ValueError (one line) where a tick is too short for what goes over the bus in it.

    10 bits a byte; the goals and the question out, an answer of every servo back, each after its
    return delay, and all wait for a USB frame. baud [bit/s].
    """
    ids = tuple(range(servos))
    out = vendor.ask(vendor.present, ids) + vendor.tell(
        vendor.goal, dict.fromkeys(ids, vendor.goal_data(0))
    )
    back = servos * (vendor.present.length + vendor.overhead)
    needed_s = 10 * (len(out) + back) / baud + servos * ANSWERS_AFTER_S + USB_FRAME_S
    if needed_s > BUSY * period_s:
        raise ValueError(
            f"table.baud = {baud}: {servos} {vendor.name} servos need {1e3 * needed_s:.1f} ms a "
            f"tick, control_rate_hz has {1e3 * period_s:.1f} ms: raise the one or lower the other"
        )


class BusTable(LevelOnExit):
    """A table on bus servos: looked at when opened, its torque untouched; `with` arms it.

    Arming tells every servo the angle where it is, switches torque on and brings the plate level
    slowly; leaving brings it level and leaves torque on, as limp arms would let the plate fall to a
    side. ids: of the servos of channel 0 and 1; wiring: zero_counts is where the plate is level;
    rate_limit_rad_s: by axis (x, y), for the servos' own speed registers; homed False: level is
    not known yet, so goals go slowly and nothing is levelled. eye: where observations of the ball
    come from; clock: monotonic [s]; sleep_until: until a time of it. boot_id: position survives a
    power-up. ValueError: a servo is set so that it cannot be driven, in one line with the cure.
    LinkLost: a servo does not answer; ServoAlarm: one reports an error.
    """

    takes_angle = True
    boot_id = "absolute"

    def __init__(
        self,
        link: Link,
        vendor: Vendor,
        wiring: Wiring,
        *,
        ids: tuple[int, int] = (1, 2),
        period_s: float = 0.004,
        angle_limit_rad: float = pi / 6,
        rate_limit_rad_s: Pair = (4.7, 4.7),
        voltage_limit_V: float = 6.0,
        homed: bool = True,
        eye: ObservationSource | None = None,
        clock: Callable[[], float] = time.monotonic,
        sleep_until: Callable[[float], None] = sleep_until,
    ) -> None:
        self.period_s, self.voltage_limit_V = period_s, voltage_limit_V
        self.asked_again = 0
        self._link, self._vendor, self._wiring, self._ids = link, vendor, wiring, ids
        self._limit_rad, self._rates, self._homed = angle_limit_rad, rate_limit_rad_s, homed
        self._feed, self._times, self._clock = ObservationFeed(eye), FromFirst(), clock
        self._ticker = Ticker(period_s, clock=clock, sleep_until=sleep_until)
        self._parser = vendor.parser()
        self._patience_s = max(LINK_DEAD_S - period_s, 2 * ASK_AGAIN_S)  # a tick may pass before
        self._told: Pair = (0.0, 0.0)
        self._step_rad = START_RAD_S * period_s
        self._armed, self._ended, self._closed = False, None, False
        self._asked_s, self._seen_s, self._health_s, self._extra = 0.0, 0.0, -inf, 0
        self._extremes = {"lowest_voltage_V": inf, "highest_temperature_C": -inf, "most_load": 0.0}
        try:
            self._setups = self._checked_setups()
        except BaseException:
            link.close()
            raise

    @property
    def ticks_missed(self) -> int:
        """How many ticks the bus or this program was too late for."""
        return self._ticker.missed

    @property
    def zero_s(self) -> float:
        """Moment of the first reading on the host's monotonic clock [s]; NaN before it."""
        return self._times.zero_s

    @property
    def travel_rad(self) -> Pair:
        """By axis (x, y): twice the way from level to the nearer of the servo's own limits."""
        ways = [
            2 * min(zero - setup.low, setup.high - zero) * self._wiring.step_rad
            for zero, setup in zip(self._wiring.zero_counts, self._setups, strict=True)
        ]
        return (ways[1], ways[0]) if self._wiring.swap else (ways[0], ways[1])

    def notes(self) -> dict[str, float]:
        """Return what a recording keeps of the bus: ticks_missed, asked_again, bad_packets, and the
        extremes of voltage, temperature and load.
        """
        seen = {name: value for name, value in self._extremes.items() if math.isfinite(value)}
        return {
            "ticks_missed": self.ticks_missed,
            "asked_again": self.asked_again,
            "bad_packets": self._parser.bad_packets,
        } | seen

    # --- before the run ---
    def _name(self, servo_id: int) -> str:
        """What the servo is called in messages."""
        axis = "xy"[self._ids.index(servo_id) != self._wiring.swap]
        return f"{self._link.name}: servo {servo_id} ({axis})"

    def _checked_setups(self) -> list[Setup]:
        """What the servos are set to. ValueError: it does not allow what the rig file asks."""
        found = self._ask(self._vendor.setup, ANSWER_S)
        setups = [self._vendor.read_setup(found[servo_id].data) for servo_id in self._ids]
        reach = math.ceil(self._limit_rad / self._wiring.step_rad)
        for servo_id, setup, zero in zip(self._ids, setups, self._wiring.zero_counts, strict=True):
            if setup.wrong:
                raise ValueError(f"{self._name(servo_id)} {setup.wrong}, with its maker's tool")
            if not setup.low <= zero - reach <= zero + reach <= setup.high:
                raise ValueError(
                    f"{self._name(servo_id)} goes from count {setup.low} to {setup.high}, "
                    f"servo.angle_limit_rad needs {zero - reach} to {zero + reach}: set its horn "
                    "anew, or correct table.trim_rad or the servo's limits"
                )
        return setups

    def arm(self) -> None:
        """Switch torque on where the servos are; then, homed, bring the plate level slowly.

        LinkLost: the bus is lost; ServoAlarm: a servo does not arm, or does not come to level.
        """
        vendor, counts = self._vendor, self._counts()
        self._told = self._wiring.angles(counts)
        rates = self._rates[::-1] if self._wiring.swap else self._rates
        units = [round(r / s.speed_rad_s) for r, s in zip(rates, self._setups, strict=True)]
        self._next(0, 0.0)  # loads the compiled limiter: longer than a watchdog waits
        self._tell_watchdog(on=False)
        self._tell(vendor.speed, [vendor.speed_data(unit) for unit in units])
        self._tell(vendor.goal, [vendor.goal_data(count) for count in counts])
        self._tell(vendor.torque, [b"\x01"] * len(counts))
        self._tell_watchdog(on=True)
        try:
            self._armed = True
            self._check_health()
            if self._homed:
                self._go_level()
                self._step_rad = inf
        except BaseException:
            self.close()
            raise

    def _go_level(self) -> None:
        """Slowly, tick by tick. ServoAlarm: a servo stays behind."""
        until = inf
        while True:
            angles = self._look()
            self.drive((0.0, 0.0))
            if self._told != (0.0, 0.0):
                continue
            off = [abs(angle) for angle in angles]
            if max(off) < ARRIVED_RAD:
                return
            until = min(until, self._clock() + ARRIVE_S)
            if self._clock() > until:
                axis = "xy"[off.index(max(off))]
                why = f"{self._link.name}: servo {axis} stays {max(off):.2f} rad from level: is it "
                raise self._end(ServoAlarm(errno.EIO, why + "blocked, its horn or trim wrong?"))

    def __enter__(self) -> "BusTable":
        if not self._armed:
            self.arm()
        return self

    # --- the contract ---
    def read(self) -> Reading:
        """Wait for the next tick, ask the servos and return their reading.

        LinkLost: the adapter vanished or a servo is silent (raised within 100 ms). ServoAlarm: a
        servo reports an error. CameraStopped: the camera of `eye` failed.
        """
        angles = self._look()
        t_s = self._times.seconds(self._seen_s, 1e-4)
        return Reading(t_s, angles, None, self._feed.take(t_s))

    def drive(self, volts: Pair) -> None:
        """Tell the servos the angles `volts` (x, y) [rad], within the angle limit.

        ValueError: angles that are not finite, or other than 0 on a table that is not armed.
        LinkLost, ServoAlarm: the bus is lost or a servo has given up.
        """
        if not all(map(math.isfinite, volts)):
            raise ValueError(f"angles must be finite, got {volts}; use rig.safety.limits")
        if self._ended is not None:
            raise self._ended
        if not self._armed:
            if any(volts):
                raise ValueError("the servos are not armed: call arm(), or use `with table:`")
            return
        self._tell_goals((self._next(0, volts[0]), self._next(1, volts[1])))

    def _next(self, axis: int, wanted_rad: float) -> float:
        """The angle that an axis is told next."""
        last = self._told[axis]
        wanted = float(limit_angle(wanted_rad, last, self._limit_rad))
        return min(max(wanted, last - self._step_rad), last + self._step_rad)

    def close(self) -> None:
        """Leave the servos holding level, to which they go slowly, and let the bus go."""
        if self._closed:
            return
        self._closed = True
        with suppress(OSError):  # it is gone: what the servos do then, they do by themselves
            if self._armed:
                self._tell_watchdog(on=False)
                units = [round(START_RAD_S / setup.speed_rad_s) for setup in self._setups]
                self._tell(self._vendor.speed, [self._vendor.speed_data(unit) for unit in units])
                if self._homed:
                    self._tell_goals((0.0, 0.0))
        self._armed = False
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

    # --- the bus ---
    def _tell_goals(self, angles: Pair) -> None:
        """Tell both goals [rad]."""
        goals = [self._vendor.goal_data(count) for count in self._wiring.counts(angles)]
        self._tell(self._vendor.goal, goals)
        self._told = angles

    def _tell_watchdog(self, *, on: bool) -> None:
        if (word := self._vendor.watchdog(on)) is not None:
            self._tell(word[0], [word[1]] * len(self._ids))

    def _tell(self, address: int, data: list[bytes]) -> None:
        """Write to all servos at once; `data` by channel."""
        self._send(self._vendor.tell(address, dict(zip(self._ids, data, strict=True))))

    def _send(self, packet: bytes) -> None:
        try:
            self._link.send(packet)
        except LinkLost as error:
            raise self._end(error) from None

    def _look(self) -> Pair:
        """Wait for the next tick and return the servos' angles (x, y) [rad]."""
        if self._ended is not None:
            raise self._ended
        self._ticker.wait()
        angles = self._wiring.angles(self._counts())
        if self._armed and self._clock() - self._health_s >= HEALTH_S:
            self._check_health()
        return angles

    def _counts(self) -> tuple[int, int]:
        """The servos' positions by channel."""
        found = self._ask(self._vendor.present, self._patience_s)
        self._seen_s = self._asked_s  # a servo measures when it is asked
        a, b = (self._vendor.read_present(found[servo_id].data) for servo_id in self._ids)
        self._note(a, b)
        return a.counts, b.counts

    def _note(self, *seen: Present) -> None:
        keep = self._extremes
        for one in seen:
            keep["lowest_voltage_V"] = min(keep["lowest_voltage_V"], one.voltage_V)
            keep["highest_temperature_C"] = max(keep["highest_temperature_C"], one.temperature_C)
            keep["most_load"] = max(keep["most_load"], abs(one.load))

    def _check_health(self) -> None:
        """ServoAlarm: a servo that is armed does not hold any more."""
        for servo_id, status in self._ask(self._vendor.health, self._patience_s).items():
            if why := self._vendor.health_alarm(status.data):
                raise self._alarm(servo_id, why)
        self._health_s = self._clock()

    def _ask(self, block: Block, patience_s: float) -> dict[int, Status]:
        """All servos' answers to one question, which is asked again where one is missing."""
        if self._ended is not None:
            raise self._ended
        until = self._clock() + patience_s
        try:
            while True:
                answers = self._ask_once(block)
                silent = [servo_id for servo_id in self._ids if servo_id not in answers]
                if not silent:
                    return answers
                if self._clock() >= until:
                    break
                self.asked_again += 1
                self._extra = 1 - self._extra
        except LinkLost as error:
            raise self._end(error) from None
        cure = ": is its power on, are table.ids and table.baud right?"
        why = f"{self._name(silent[0])} is lost: silent for {1e3 * patience_s:.0f} ms"
        raise self._end(LinkLost(errno.ETIMEDOUT, why + ("" if self._armed else cure)))

    def _ask_once(self, block: Block) -> dict[int, Status]:
        """The answers that come within `ASK_AGAIN_S`. ServoAlarm: one of them is an alarm.

        No answer names its question. Where one was not answered in time, the next are for one
        register more before the block, and a late answer shows by its length.
        """
        extra, is_health = self._extra, block == self._vendor.health
        block = Block(block.address - extra, block.length + extra)
        self._link.receive()
        self._parser.clear()
        self._asked_s = self._clock()
        self._link.send(self._vendor.ask(block, self._ids))
        answers: dict[int, Status] = {}
        while True:
            for status in self._parser.feed(self._link.receive()):
                if status.servo_id not in self._ids:
                    continue
                if not is_health and (why := self._vendor.alarm(status.error)):
                    raise self._alarm(status.servo_id, self._cause(status.servo_id, why))
                if len(status.data) == block.length:
                    answers[status.servo_id] = replace(status, data=status.data[extra:])
            left_s = self._asked_s + ASK_AGAIN_S - self._clock()
            if len(answers) == len(self._ids) or left_s <= 0.0:
                return answers
            self._link.wait(left_s)

    def _cause(self, servo_id: int, why: str) -> str:
        """The error that a servo reports, and what its registers say of it."""
        found = self._ask_once(self._vendor.health).get(servo_id)
        more = self._vendor.health_alarm(found.data) if found and self._armed else ""
        return ", ".join(filter(None, (why, more)))

    def _alarm(self, servo_id: int, why: str) -> OSError:
        return self._end(ServoAlarm(errno.EIO, f"{self._name(servo_id)} reports: {why}"))

    def _end(self, error: OSError) -> OSError:
        """Remember how it ended: every later call says the same."""
        self._ended = error
        return error
