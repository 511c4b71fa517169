"""A table on a bus of servos that take an angle and tell theirs: `read / drive / close`.

Every tick asks all servos for their state in one packet and tells all goals in another. Nobody
limits a goal's rate here: the servos' own speed registers do, at the rig file's rate limit, so that
what is recorded is what was told.
"""

import errno
import math
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from math import inf, pi

from rig.hardware.board.link import LINK_DEAD_S, Link, LinkLost
from rig.hardware.bus.vendor import Block, Present, Setup, Status, Vendor
from rig.hardware.observations import FromFirst, ObservationFeed, ObservationSource
from rig.hardware.servo_table import ServoTable
from rig.hardware.wiring import Pair, Wiring
from rig.linkage import Linkage
from rig.loop.ticker import Ticker, sleep_until
from rig.safety.levelling import LevelOnExit
from rig.table import ArmingStoppedError, Reading

ANSWER_S = 0.5  # chosen: an adapter that was just plugged in is slow at first
ASK_AGAIN_S = 0.02  # chosen: above the 16 ms for which an FTDI adapter may keep an answer back
LENGTHS = 1 + math.ceil(LINK_DEAD_S / ASK_AGAIN_S)  # of answers: lost before one comes again
HEALTH_S = 0.1  # torque, watchdog and hardware errors are looked at so often
START_RAD_S = 0.5  # chosen: a plate that is brought level by itself does so in a second, slowly
MARGIN_RAD = 0.1  # as homing has it, of stops
ARRIVED_RAD, ARRIVE_S = 0.04, 4.0  # as homing has it
SET_TRIES = 4  # chosen: a bus that loses one packet in ten loses four in a row once in 10 000
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


class BusTable(ServoTable, LevelOnExit):
    """A table on bus servos: looked at when opened, its torque untouched; `with` arms it.

    Arming tells every servo the angle where it is, switches torque on and brings the plate level
    slowly; leaving brings it level and leaves torque on, as limp arms would let the plate fall to a
    side. linkage: what the servos do to the plate; ids: of the servos, by channel; wiring:
    zero_counts is where the plate is level; rate_limit_rad_s: by axis (x, y), for the servos' own
    speed registers; homed False: level is not known yet, so goals go slowly and nothing is
    levelled. eye: where observations of the ball come from; clock: monotonic [s]; sleep_until:
    until a time of it. turned_rad: the servos' angles from level as last read, by servo;
    stop_asked: looked at on the way to level (`rig.table.watch_arming`).
    ValueError: a servo is set so that it cannot be driven, in one line with the cure. LinkLost: a
    servo does not answer; ServoAlarm: one reports an error.
    """

    def __init__(
        self,
        link: Link,
        vendor: Vendor,
        wiring: Wiring,
        linkage: Linkage = Linkage(),  # noqa: B008 - it is frozen
        *,
        ids: tuple[int, ...] = (1, 2),
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
        super().__init__(linkage, angle_limit_rad)
        self._homed, self.level_s = homed, self.level_s * homed  # else nobody knows where level is
        self._rates = wiring.by_channel(linkage.servo_rates(rate_limit_rad_s))
        self._feed, self._times, self._clock = ObservationFeed(eye), FromFirst(), clock
        self._ticker = Ticker(period_s, clock=clock, sleep_until=sleep_until)
        self._parser = vendor.parser()
        self._patience_s = max(LINK_DEAD_S - period_s, 2 * ASK_AGAIN_S)  # a tick may pass before
        self.turned_rad = self._told = (0.0,) * len(ids)  # by servo
        self._step_rad = START_RAD_S * period_s
        self._armed, self._closed = False, False
        self.stop_asked: Callable[[], bool] = lambda: False
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
    def travel_rad(self) -> tuple[float, ...]:
        """By servo: twice the way from level to the nearer of its own limits."""
        return self._wiring.by_servo(
            [
                2 * min(zero - setup.low, setup.high - zero) * self._wiring.step_rad
                for zero, setup in zip(self._wiring.zero_counts, self._setups, strict=True)
            ]
        )

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
        name = self._linkage.servo_names[self._wiring.order[self._ids.index(servo_id)]]
        return f"{self._link.name}: servo {servo_id} ({name})"

    def _checked_setups(self) -> list[Setup]:
        """What the servos are set to. ValueError: it does not allow what the rig file asks."""
        found = self._ask(self._vendor.setup, ANSWER_S)
        setups = [self._vendor.read_setup(found[servo_id].data) for servo_id in self._ids]
        limits = self._wiring.by_channel(self._limits_rad)
        for servo_id, setup, zero, limit in zip(
            self._ids, setups, self._wiring.zero_counts, limits, strict=True
        ):
            reach = math.ceil(limit / self._wiring.step_rad)
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

        ValueError: an arm is turned away from its level. Told to stay where they are: LinkLost, the
        bus is lost; ServoAlarm, one does not arm or come to level; ArmingStoppedError: `stop_asked`
        """
        vendor, counts = self._vendor, self._counts()
        self.turned_rad = self._told = self._wiring.angles(counts)
        self._check_near()
        units = [round(r / s.speed_rad_s) for r, s in zip(self._rates, self._setups, strict=True)]
        self._tell_watchdog(on=False)
        self._set(vendor.speed, [vendor.speed_data(unit) for unit in units], "speed limit")
        self._set(vendor.goal, [vendor.goal_data(count) for count in counts], "goal")
        try:
            self._set(vendor.torque, [b"\x01"] * len(counts), "torque switch")
            if (word := vendor.watchdog(on=True)) is not None:
                self._set(word[0], [word[1]] * len(counts), "bus watchdog")
            self._armed = True
            self._check_health()
            if self._homed:
                self._go_level()
                self._step_rad = inf
        except BaseException:
            self.level_s = 0.0
            self.close()
            raise

    def _check_near(self) -> None:
        """ValueError: from where an arm is, its level may lie on the other way round."""
        ways = zip(self._linkage.servo_names, self._told, self.travel_rad, strict=True)
        for name, angle, travel in ways:
            if abs(angle) > 0.5 * travel + MARGIN_RAD:
                raise ValueError(
                    f"{self._link.name}: servo {name} stands {abs(angle):.2f} rad from level, it "
                    f"may turn {0.5 * travel:.2f} to each side: with its supply off, turn its arm "
                    "towards level"
                )

    def _go_level(self) -> None:
        """Slowly. ServoAlarm: a servo stays behind; ArmingStoppedError: `stop_asked`."""
        until = inf
        while True:
            self._look()
            if self.stop_asked():
                raise ArmingStoppedError
            self.drive((0.0, 0.0))
            if any(self._told):
                continue
            off = [abs(angle) for angle in self.turned_rad]
            if max(off) < ARRIVED_RAD:
                return
            until = min(until, self._clock() + ARRIVE_S)
            if self._clock() > until:
                name = self._linkage.servo_names[off.index(max(off))]
                why = f"{self._link.name}: servo {name} stays {max(off):.2f} rad from level: is it "
                raise self._end(ServoAlarm(errno.EIO, why + "blocked, its horn or trim wrong?"))

    def __enter__(self) -> "BusTable":
        if not self._armed:
            self.arm()
        return self

    # --- the contract ---
    def read(self) -> Reading:
        """Wait for the next tick, ask the servos and return their reading; its angles are NaN where
        three arms stand as no plate has them.

        LinkLost: the adapter vanished or a servo is silent (raised within 100 ms). ServoAlarm: a
        servo reports an error. CameraStopped: the camera of `eye` failed.
        """
        self._look()
        t_s = self._times.seconds(self._seen_s, 1e-4)
        angles = self._linkage.table_angles(self.turned_rad)
        return Reading(t_s, angles, None, self._feed.take(t_s))

    def _tell(self, angles: Sequence[float]) -> None:
        """Tell the servos their next goals on the way to angles from level [rad]."""
        if self._ended is not None:
            raise self._ended
        if not self._armed:
            if any(angles):
                raise ValueError("the servos are not armed: call arm(), or use `with table:`")
            return
        step = self._step_rad
        ways = zip(angles, self._told, strict=True)
        self._tell_goals([min(max(angle, told - step), told + step) for angle, told in ways])

    def close(self) -> None:
        """Leave the servos holding level, to which they go slowly, and let the bus go; where
        nothing is to be levelled they hold where they are, and a blocked one is not pushed on.
        """
        if self._closed:
            return
        self._closed = True
        with suppress(OSError):  # it is gone: what the servos do then, they do by themselves
            if self._armed:
                units = (round(START_RAD_S / setup.speed_rad_s) for setup in self._setups)
                slow = [self._vendor.speed_data(unit) for unit in units]
                level = (0.0,) * len(self._ids)
                for _ in range(SET_TRIES):  # nobody hears whether one was lost
                    self._tell_watchdog(on=False)
                    self._write(self._vendor.speed, slow)
                    self._tell_goals(level if self.level_s > 0.0 else self.turned_rad)
        self._armed = False
        self._link.close()

    # --- the bus ---
    def _tell_goals(self, angles: Sequence[float]) -> None:
        """Tell all goals, by servo [rad]."""
        goals = [self._vendor.goal_data(count) for count in self._wiring.counts(angles)]
        self._write(self._vendor.goal, goals)
        self._told = tuple(angles)

    def _tell_watchdog(self, *, on: bool) -> None:
        if (word := self._vendor.watchdog(on)) is not None:
            self._write(word[0], [word[1]] * len(self._ids))

    def _write(self, address: int, data: list[bytes]) -> None:
        """Write to all servos at once; `data` by channel."""
        self._send(self._vendor.tell(address, dict(zip(self._ids, data, strict=True))))

    def _set(self, address: int, data: list[bytes], what: str) -> None:
        """`_write` and read back: no servo acknowledges that. ServoAlarm: one does not take it."""
        wrong, wanted = list[int](), dict(zip(self._ids, data, strict=True))
        for _ in range(SET_TRIES):
            self._write(address, data)
            found = self._ask(Block(address, len(data[0])), self._patience_s)
            wrong = [one for one, value in wanted.items() if found[one].data != value]
            if not wrong:
                return
        raise self._alarm(wrong[0], f"its {what} is not as it was told")

    def _send(self, packet: bytes) -> None:
        try:
            self._link.send(packet)
        except LinkLost as error:
            raise self._end(error) from None

    def _look(self) -> None:
        """Wait for the next tick and read the servos' angles."""
        self._ticker.wait()
        self.turned_rad = self._wiring.angles(self._counts())
        if self._armed and self._clock() - self._health_s >= HEALTH_S:
            self._check_health()

    def _counts(self) -> list[int]:
        """The servos' positions by channel."""
        found = self._ask(self._vendor.present, self._patience_s)
        self._seen_s = self._asked_s  # a servo measures when it is asked
        seen = [self._vendor.read_present(found[servo_id].data) for servo_id in self._ids]
        self._note(seen)
        return [one.counts for one in seen]

    def _note(self, seen: list[Present]) -> None:
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
                self._extra = (self._extra + 1) % LENGTHS
        except LinkLost as error:
            raise self._end(error) from None
        cure = ": is its power on, are table.ids and table.baud right?"
        why = f"{self._name(silent[0])} is lost: silent for {1e3 * patience_s:.0f} ms"
        raise self._end(LinkLost(errno.ETIMEDOUT, why + ("" if self._armed else cure)))

    def _ask_once(self, block: Block) -> dict[int, Status]:
        """The answers that come within `ASK_AGAIN_S`. ServoAlarm: one of them is an alarm.

        No answer names its question. Where one was not answered in time, the next are for another
        number of registers before the block, and a late answer shows by its length.
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
        return f"{why}, {more}" if more else why

    def _alarm(self, servo_id: int, why: str) -> OSError:
        return self._end(ServoAlarm(errno.EIO, f"{self._name(servo_id)} reports: {why}"))
