"""The watchdog of a served table: what its user may do, and what happens when the user is silent.

Pure but for its own state: times come in, volts go out.
"""

from dataclasses import replace
from math import exp, inf, isfinite

from rig.hardware.network.remote_wire import SILENT_S, DriveRequest
from rig.hardware.wiring import Wiring
from rig.parameters import Servo
from rig.safety.levelling import Levelling
from rig.safety.limits import CATCH_TAUS, braking, free_rate, limit
from rig.safety.monitor import Fault, MonitorLimits, MonitorState, check, without
from rig.safety.motion_watch import UNKNOWN, Both, MotionLimits
from rig.table import Reading
from vision.sources.clock import ForeignClock

LEVEL_S = 0.5
HOLD_S = 0.05  # so long a command's volts last without a newer one
RATE_FILTER_S = 0.02  # as in the loop (`Gains.torque_filter_s`)
REST_S = 1.0  # after a fault; chosen: ten times what a stall may last, so that motors stay cool
HOMING_LIMIT_V = 3.0  # while nobody knows where the stops are


class ClientWatchdog:
    """Decides the volts of a served table from the commands of its user, and from their silence.

    While armed, the volts of the newest fresh command hold for 50 ms; after 100 ms without one the
    plate is levelled for 0.5 s, then 0 V, latched. What the loop's monitor calls a fault of the
    table ends it as well. Whatever is asked for, and 0 V too, passes the limiter, which brakes an
    arm that would pass its angle limit, until the arms have come to rest. Zeros by which an arm has
    been beyond its stops since they were named are wrong: there are no volts. servo: of the table;
    period_s: of its tick.
    armed, latched, homed, wiring: the present state; stale: commands that were not obeyed.
    """

    def __init__(self, voltage_limit_V: float, servo: Servo, period_s: float) -> None:
        self._limit_V, self._angle_limit_rad = voltage_limit_V, servo.angle_limit_rad
        self._braking = braking(servo, period_s, RATE_FILTER_S)
        self._caught_s = LEVEL_S + CATCH_TAUS * servo.time_constant_s
        self._limits, self._seen = MonitorLimits.of_servo(servo, period_s), MonitorState()
        self._servo = servo
        self._lost: int | None = None  # the axis that showed a fault, whose encoder nobody trusts
        self._forget_motion()
        self.armed = self.latched = False
        self.homed = self._within = False
        self.wiring = Wiring()
        self._volts = self._given = (0.0, 0.0)
        self._now_s = self._fresh_s = self._ended_s = self._rested_s = -inf
        self._levelling: Levelling | None = None
        self.stale = 0
        self.meet()
        self._clamped(self._volts, self._volts, self._volts)  # compiles now, not while a user waits

    def meet(self) -> None:
        """Begin with a new user, whose clock is not known yet."""
        self._clock, self._sent_s = ForeignClock(), -inf

    def hear(self, sent_s: float, now_s: float) -> float:
        """Return how long a message took, beyond the fastest so far [s]; inf for an old one.

        sent_s: on the user's clock; now_s: on ours. Old is one that was not sent after the last one
        heard, or at no time at all.
        """
        if not self._sent_s < sent_s < inf:
            return inf
        self._sent_s = sent_s
        return now_s - self._clock.to_rig(sent_s, now_s)

    def configure(self, wiring: Wiring, homed: bool, sure_V: tuple[Both, Both] = UNKNOWN) -> None:
        """Take the wiring; homed False: channels as they are, at HOMING_LIMIT_V; sure_V: volts that
        surely move each arm, where its user knows.

        ValueError: the table does not rest; its arms would be braked by angles of other channels.
        """
        if not self.rests(self._now_s):
            raise ValueError("channels were named while the table moved")
        self.wiring, self.homed = wiring, homed
        motion = MotionLimits.of_servo(self._servo, sure_V if homed else UNKNOWN)
        self._limits = replace(self._limits, motion=motion)
        self._forget_motion()  # another zero is none
        self._within = False

    def arm(self, now_s: float) -> None:
        """Arm at 0 V and end a latch; now_s: on our clock.

        Neither takes anything from the monitor: an armed table is watched on, and one that showed a
        fault is not armed before it has rested.
        """
        if now_s < self._rested_s:
            return
        if not self.armed:
            self._seen, self._lost = MonitorState(), None
        self.armed, self.latched, self._levelling = True, False, None
        self._volts, self._fresh_s = (0.0, 0.0), now_s

    def disarm(self) -> None:
        """Ask for 0 V from now on, without levelling; for a user who says goodbye."""
        if self.armed:
            self._ended_s = self._now_s
        self.armed, self._levelling = False, None

    def stop(self, now_s: float) -> None:
        """Level the plate, then 0 V, latched until armed anew; nothing where the table is not
        armed.
        """
        if self.armed:
            self.armed, self.latched, self._ended_s = False, True, now_s
            self._levelling = Levelling(self._limit_V)

    def rests(self, now_s: float) -> bool:
        """Whether nobody holds the table and its arms have been levelled or caught; now_s: on our
        clock.
        """
        return not self.armed and not now_s - self._ended_s < self._caught_s

    def obey(self, request: DriveRequest, now_s: float) -> bool:
        """Take a command; False where it was too long on its way or its volts are not finite."""
        age_s = self.hear(request.sent_s, now_s)
        if age_s > 1e-3 * request.ttl_ms or not (isfinite(request.x_V) and isfinite(request.y_V)):
            self.stale += 1
            return False
        self._volts, self._fresh_s = (request.x_V, request.y_V), now_s
        return True

    def watch(self, reading: Reading, now_s: float) -> Fault | None:
        """Return the fault that a table shows in a reading before it rests, and stop it; None: it
        has none.

        now_s: on our clock. The table is levelled where its encoders may still be trusted; else the
        axis that showed the fault gets 0 V at once and the other arm is braked before its limit.
        """
        if self.rests(now_s):
            return None
        if self._lost is not None:
            reading, self._seen = without(reading, self._lost, self._seen)
        limits = self._limits if self.homed else replace(self._limits, angle_rad=inf)
        self._seen, fault = check(self._seen, limits, reading, self._given, balancing=False)
        if fault is not None and fault.level and not self.armed:  # it is being levelled
            self._seen, fault = MonitorState(), None
        if fault is None:
            return None
        if self._zeros_are_wrong:
            reason = f"{fault.reason} since its zero was named: home the table"
            fault = replace(fault, level=False, reason=reason)
        self.stop(now_s)
        self._rested_s = now_s + REST_S
        if not fault.level:
            self._levelling = None
            if fault.axis is None or self._lost is not None:
                self._ended_s = -inf
            self._lost = fault.axis
        return fault

    def volts(self, theta_rad: tuple[float, float], now_s: float) -> tuple[float, float]:
        """Return the volts (x, y) for this tick; theta_rad: encoder angles, now_s: on our clock."""
        rate_rad_s, self._now_s = self._rates(theta_rad, now_s), now_s
        if self.armed and now_s - self._fresh_s > SILENT_S:
            self.stop(now_s)
        self._within = self._within or all(abs(a) <= self._limits.angle_rad for a in theta_rad)
        self._given = (0.0, 0.0)
        if not (self.rests(now_s) or self._zeros_are_wrong):
            x, y = self._clamped(self._wanted(theta_rad, now_s), theta_rad, rate_rad_s)
            self._given = (0.0 if self._lost == 0 else x, 0.0 if self._lost == 1 else y)
        return self._given

    @property
    def _zeros_are_wrong(self) -> bool:
        """Whether no reading yet agreed with the zeros that the user named."""
        return self.homed and not self._within

    def _wanted(self, theta_rad: tuple[float, float], now_s: float) -> tuple[float, float]:
        """The volts of who holds the table: its user, or the levelling after a stop."""
        if self.armed and now_s - self._fresh_s <= HOLD_S:
            return self._volts
        if self.homed and self._levelling is not None and now_s - self._ended_s < LEVEL_S:
            return self._levelling.volts(theta_rad, now_s)
        return 0.0, 0.0

    def _forget_motion(self) -> None:
        self._last: tuple[tuple[float, float], float] | None = None  # angles, and when
        self._rate_rad_s = self._free_rad_s = (0.0, 0.0)

    def _rates(self, theta_rad: tuple[float, float], now_s: float) -> tuple[float, float]:
        """Filtered rates of the arms [rad/s], and what they would be by the volts alone; 0 before
        there are two ticks.
        """
        last, self._last = self._last, (theta_rad, now_s)
        if last is None or not now_s > last[1]:
            return self._rate_rad_s
        kept = exp(-(now_s - last[1]) / self._servo.time_constant_s)
        x, y = (
            free_rate(before, volts, self._servo.gain_rad_s_V, kept)
            for before, volts in zip(self._free_rad_s, self._given, strict=True)
        )
        self._free_rad_s = x, y
        decay = exp(-(now_s - last[1]) / RATE_FILTER_S)
        x, y = (
            decay * rate + (1 - decay) * (angle - before) / (now_s - last[1])
            for rate, angle, before in zip(self._rate_rad_s, theta_rad, last[0], strict=True)
        )
        self._rate_rad_s = x if isfinite(x) else 0.0, y if isfinite(y) else 0.0
        return self._rate_rad_s

    def _clamped(self, volts, theta_rad, rate_rad_s) -> tuple[float, float]:
        """The table's own bounds, whatever the user's program allows itself. What an honest user's
        limiter let through passes as it is: limiting twice changes nothing.
        """
        most = self._limit_V if self.homed else min(HOMING_LIMIT_V, self._limit_V)
        reach = self._angle_limit_rad if self.homed else inf
        x, y = (
            limit(commanded, a, w, 0.0, most, reach, inf, self._braking, 0.0, free)
            for commanded, a, w, free in zip(
                volts, theta_rad, rate_rad_s, self._free_rad_s, strict=True
            )
        )
        return x, y
