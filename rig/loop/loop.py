"""One run: every tick reads sensors, estimates, commands, limits, drives and records.

No sleep, no clock, no `if simulated`.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from rig.control import tick, user_controller
from rig.control.tick import BLIND, HOLD, PLACE, RUN, control_tick, fill_row
from rig.course import BLIND_LIMIT_S, Course
from rig.foreign_call import ForeignCall, in_words
from rig.log import COLUMNS
from rig.loop.commands import BY_HAND, CommandSlot, Inbox, Push, SetGains, Stop, Target, said
from rig.loop.signals import stop_by
from rig.operator import SAY, Operator
from rig.parameters import Rig
from rig.safety import monitor
from rig.safety.levelling import LevelOnExit
from rig.safety.limits import CATCH_TAUS, Braking, delayed, lateness, limit, limit_angle
from rig.safety.monitor import Fault, MonitorLimits
from rig.table import Reading, Table, takes_angle

HIGHEST_GAINS = (20.0, 20.0, 20.0)  # rad/m, rad/(m s), rad s/m: what a setpoint page may ask for
PLACED_S = 0.5  # so long a ball must lie at its start before it counts as placed


@dataclass(frozen=True)
class Ending:
    """How a run ended.

    outcome: "completed", "ball lost", "limit", "not released", "aborted", "interrupted", that of a
    `Stop` or of an error, or the name of the monitor's fault; reason: for a person; level: whether
    the plate may be levelled afterwards, else 0 V at once.
    """

    outcome: str
    reason: str = ""
    level: bool = True


def ending_of(error: BaseException) -> Ending:
    """Return the ending of a run that raised `error`: that of a signal, the `outcome` that it bears
    (a lost link, a camera), else aborted.
    """
    if (stop := stop_by(error)) is not None:
        return Ending(stop.outcome, stop.reason)
    outcome = getattr(error, "outcome", "aborted")
    return Ending(outcome, in_words(error))


DONE = Ending("completed")


def run_controlled(
    controller: user_controller.UserController | None,
    known: Rig,
    run: Callable[[], Ending],
    ended: Callable[[Ending], None] = lambda ending: None,
) -> Ending:
    """Start a user's controller, run, tell the controller how it ended; return the ending.

    run: opens the table, so that none is armed before the controller is ready, and leaves it
    level; ended: hears of the ending before the controller does. Without a controller: run alone.
    """
    try:
        if controller is not None:
            user_controller.start_controller(controller, known, 1 / known.control_rate_hz)
        ending = run()
    except user_controller.ControllerError as error:
        ending = Ending("aborted", str(error))
    except BaseException as error:
        if controller is not None:
            user_controller.end_controller(controller, ending_of(error).outcome)
        raise
    ended(ending)
    if controller is None:
        return ending
    said = user_controller.end_controller(controller, ending.outcome)
    return replace(ending, reason="; ".join(filter(None, (ending.reason, said))))


class Loop:
    """One run of a controller on a table, tick by tick; every tick's row goes to `keep`.

    known: what the controller may know of the table; compensator: a number of
    `controllers.COMPENSATORS`; commands: where stops, pushes, gains and targets come from;
    controller: a user's that was started, in place of the built-in one; control_s: how long it may
    take for a tick; keep: takes the row (len(COLUMNS),), which is written anew at the next tick;
    event: takes time and text of what happened; late_s: tells how late the last tick came by the
    wall clock, where the table's own time does not; limits: of the monitor (default: those of
    `known`). ValueError: only the servos of one of `table` and `known` take an angle.
    """

    def __init__(
        self,
        table: Table,
        known: Rig,
        compensator: int,
        course: Course,
        *,
        operator: Operator | None = None,
        commands: Inbox | None = None,
        controller: user_controller.UserController | None = None,
        control_s: float = user_controller.CONTROL_S,
        keep: Callable[[np.ndarray], None] = lambda row: None,
        event: Callable[[float, str], None] = lambda t_s, text: None,
        late_s: Callable[[], float] = lambda: 0.0,
        limits: MonitorLimits | None = None,
    ) -> None:
        if takes_angle(table) != known.servo.takes_angle:
            raise ValueError(
                f"servo.kind = '{known.servo.kind}', but this table's servos take "
                + ("volts" if known.servo.takes_angle else "angles")
                + ": correct the rig file"
            )
        self._late_s, self._limits = late_s, limits or MonitorLimits.of_rig(known)
        self._monitor_state = monitor.MonitorState()
        self._table, self._course, self._operator = table, course, operator or Operator()
        self._commands, self._keep, self._event = commands or CommandSlot(), keep, event
        self._controller, self._bounds = controller, ForeignCall(control_s)
        self._q = tick.settings(known, compensator, servo_only=course.servo_only)
        self.state = tick.start(self._q, held=course.hold_s > 0)
        self._reach_m = 0.5 * known.linkage.side_m
        self._commanded, self._applied = np.zeros(2), np.zeros(2)
        self._row = np.full(len(COLUMNS), np.nan)
        self._target: tuple[float, float] | None = None
        self._push, self._push_until = (0.0, 0.0), -1.0
        self._ticks = self._blind = 0
        self._steps = [step for step in course.operator if self._operator.is_person]
        self._placed_since: float | None = None
        self._held_since: float | None = None
        self._pushing, self._slow_s, q = False, 0.0, self._q
        self._stops = self._braking = Braking(q["delay"], q["time_constant"], q["top_speed"])
        if "place" in self._steps:
            self.state["phase"] = PLACE

    def run(self) -> Ending:
        """Tick until the course is done or something ends the run; return how it ended.

        Whatever is raised, arms that fly are braked and 0 V is driven before it passes on; leaving
        the table's context levels the plate, where the encoders may be trusted. A user controller
        that fails aborts the run. OSError: the table or its camera is lost.
        """
        try:
            ending = self.until_done()
        except user_controller.ControllerError as error:
            ending = self._caught(Ending("aborted", str(error)))
        except BaseException:
            with suppress(Exception):  # the first error is the one to hear of
                self._leave(self._caught(DONE))
            raise
        return self._leave(ending)

    def _leave(self, ending: Ending) -> Ending:
        self._table.drive((0.0, 0.0))
        if not ending.level and isinstance(self._table, LevelOnExit):
            self._table.level_s = 0.0
        return ending

    def until_done(self) -> Ending:
        """As `run`, for a table of nobody's: what is raised passes on at once."""
        while True:
            reading = self._table.read()
            ending = self._tick(reading)
            if ending is not None:
                return self._caught(ending, reading) if ending.level else ending

    def _tick(self, reading: Reading) -> Ending | None:
        fault = self._watch(reading)
        if fault is not None and not fault.level:  # before any stop, which would level the plate
            return self._cut(reading, fault)
        for command in self._commands.take():
            if isinstance(command, Stop):
                return Ending(command.outcome, command.reason)
            self._obey(command, reading.t_s)
        self._guide(reading)
        row = reading.row()
        target = np.array(self._target or self._course.targets_m[self._ticks])
        before = self.state["phase"]
        control_tick(self.state, self._q, row, target, self._applied, self._commanded)
        failed = self._ask_controller(row, target)
        if before == HOLD and self.state["phase"] != HOLD:
            self._event(reading.t_s, "released")
        x, y = float(self._commanded[0]), float(self._commanded[1])
        fault = fault or monitor.check_command(x, y, "rad" if self._q["takes_angle"] else "V")
        push = self._operator.act(reading, self._push_now(reading.t_s))
        self._limit(reading)
        if failed:
            self._applied[:] = 0.0
        self._table.drive((float(self._applied[0]), float(self._applied[1])))
        self._note(reading, row, target, push)
        if failed:
            raise failed
        return Ending(fault.name, fault.reason) if fault is not None else self._ended(reading)

    def _limit(self, reading: Reading) -> None:
        """What is applied of what is commanded; where ticks come late, volts last longer."""
        age_s, q = self._monitor_state.late_s, self._q
        self._slow_s = lateness(self._slow_s, age_s, self._limits.period_s)
        self._stops = stops = delayed(self._braking, self._slow_s)
        for a, theta in enumerate(reading.theta_rad):
            rate, free = (self.state["estimate"][name][a] for name in ("rate", "free_rate"))
            last, bounds = self._applied[a], (q["voltage_limit"], q["angle_limit"], q["slew"])
            if q["takes_angle"]:
                now = limit_angle(self._commanded[a], last, q["angle_limit"], age_s)
            else:
                now = limit(self._commanded[a], theta, rate, last, *bounds, stops, age_s, free)
            self._applied[a] = now

    def _note(
        self, reading: Reading, row: np.ndarray, target: np.ndarray, push: tuple[float, float]
    ) -> None:
        """Hand the tick's row to `keep`."""
        covariance = np.array(reading.ball.cov_m2 if reading.ball else (np.nan,) * 3)
        pushed = 1.0 if push != (0.0, 0.0) else 0.0
        commanded, applied = self._commanded, self._applied
        fill_row(
            self._row, self.state, self._q, row, covariance, target, pushed, commanded, applied
        )
        self._keep(self._row)

    def _watch(self, reading: Reading) -> Fault | None:
        """What the monitor says of a reading."""
        balancing = self.state["phase"] not in (PLACE, HOLD) and not self._course.servo_only
        applied = float(self._applied[0]), float(self._applied[1])
        self._monitor_state, fault = monitor.check(
            self._monitor_state,
            self._limits,
            reading,
            applied,
            balancing=bool(balancing),
            late_s=self._late_s(),
        )
        return fault

    def _cut(self, reading: Reading, fault: Fault) -> Ending:
        """0 V at once to the axis that shows the fault; the other arm is braked before its limit,
        and gets 0 V as soon as it stays within that without, its time constant twice the known.

        The readings until then are kept where they have a time of their own.
        """
        ending = Ending(fault.name, fault.reason, level=False)
        if fault.axis is None or self._q["takes_angle"]:
            return self._all_off(reading, ending)
        return self._all_off(self._brake_arms(reading, fault.axis)[0], ending)

    def _caught(self, ending: Ending, reading: Reading | None = None) -> Ending:
        """The ending, once no arm flies beyond its limit: levelling is too weak to brake it, and
        is left out where an encoder is lost meanwhile. reading: the newest, None: not known.
        """
        if self._q["takes_angle"] or (reading and not self._fly((0, 1), reading)):
            return ending
        with suppress(OSError):  # levelling will tell it
            _, trusted = self._brake_arms(self._table.read(), None)
            return replace(ending, level=trusted)
        return ending

    def _brake_arms(self, reading: Reading, lost: int | None) -> tuple[Reading, bool]:
        """Brake the arms that fly, from this reading on, that of the axis `lost` at 0 V; return the
        last reading, and whether the other encoders may still be trusted.
        """
        until_s = reading.t_s + CATCH_TAUS * self._q["time_constant"]
        arms = [axis for axis in (0, 1) if axis != lost]
        with suppress(OSError):  # what ended the run is told already
            while reading.t_s < until_s:
                seen = reading if lost is None else self._without(reading, lost)
                fault = self._watch(seen) if seen.t_s != self._monitor_state.t_s else None
                if fault is not None and not fault.level:
                    return reading, False
                self._brake(seen, arms)
                if not self._fly(arms, seen):
                    break
                self._table.drive((float(self._applied[0]), float(self._applied[1])))
                if lost is not None:
                    self._note(reading, reading.row(), np.full(2, np.nan), (0.0, 0.0))
                reading = self._table.read()
        return reading, True

    def _without(self, reading: Reading, lost: int) -> Reading:
        self._applied[lost] = 0.0
        seen, self._monitor_state = monitor.without(reading, lost, self._monitor_state)
        return seen

    def _brake(self, seen: Reading, arms: Sequence[int]) -> None:
        """The limiter's volts, to these arms alone, in a tick in which nobody commands any."""
        level = np.zeros(2)
        control_tick(self.state, self._q, seen.row(), level, self._applied, self._commanded)
        self._commanded[:] = 0.0
        self._limit(seen)
        self._applied[[axis for axis in (0, 1) if axis not in arms]] = 0.0

    def _fly(self, arms: Sequence[int], seen: Reading) -> bool:
        """Whether one of the arms might pass its angle limit at 0 V: it coasts by tau w from the
        speed w. One that is beyond what the monitor allows is at its stop.
        """
        far_s = self._stops.delay_s + 2.0 * self._q["time_constant"]
        theta = np.abs([seen.theta_rad[a] for a in arms])
        estimate = self.state["estimate"]
        rates = np.maximum(np.abs(estimate["rate"]), np.abs(estimate["free_rate"]))
        ways = theta + far_s * rates[list(arms)]
        return bool(np.any((ways > self._q["angle_limit"]) & (theta <= self._limits.angle_rad)))

    def _all_off(self, reading: Reading, ending: Ending) -> Ending:
        self._table.drive((0.0, 0.0))
        self._applied[:] = self._commanded[:] = 0.0
        if np.isfinite(reading.t_s) and not reading.t_s <= self._row[0]:
            self._note(reading, reading.row(), np.full(2, np.nan), (0.0, 0.0))
        return ending

    def _ask_controller(
        self, row: np.ndarray, target: np.ndarray
    ) -> user_controller.ControllerError | None:
        """A user controller in place of the built-in one, where that would steer the ball."""
        steering = self.state["phase"] in (HOLD, RUN) and self.state["estimate"]["frames"] > 0
        if self._controller is None or self._q["servo_only"] or not steering:
            return None
        seen = user_controller.now(self.state, self._q, row, target, self._applied)
        try:
            user_controller.command_volts(self._controller, seen, self._commanded, self._bounds)
        except user_controller.ControllerError as error:
            return error
        return None

    def _guide(self, reading: Reading) -> None:
        """Ask the operator for the steps in turn; see from the ball when it is placed."""
        t_s = reading.t_s
        if self.state["phase"] == PLACE:
            self._ask("place", t_s)
            if reading.ball is not None:
                off = np.hypot(*np.subtract(reading.ball.xy_m, self._course.start_m))
                near = bool(off <= self._course.tolerance_m)
                begin = t_s if self._placed_since is None else self._placed_since
                self._placed_since = begin if near else None
            if self._placed_since is not None and t_s - self._placed_since >= PLACED_S:
                self.state["phase"] = HOLD if self._course.hold_s > 0 else RUN
                self._event(t_s, "placed")
        if self.state["phase"] == HOLD:
            self._held_since = t_s if self._held_since is None else self._held_since
            self._ask("hold", t_s)
            if t_s - self._held_since >= self._course.hold_s:
                self._ask("release", t_s)

    def _ask(self, step: str, t_s: float) -> None:
        """Tell the operator a step once."""
        if step not in self._steps:
            return
        if step != "push":
            self._steps.remove(step)
        x, y = (100 * v for v in self._course.start_m)
        text = SAY[step].format(x=x, y=y)
        self._operator.tell(text)
        self._event(t_s, f"asked: {text}")

    def _ended(self, reading: Reading) -> Ending | None:
        """The ending that this tick brings, or None; counts the ticks since the release."""
        blind = self.state["phase"] == BLIND
        self._blind = self._blind + 1 if blind else 0
        if self._blind * self._table.period_s > BLIND_LIMIT_S:
            return Ending("ball lost", f"the ball was not seen for {BLIND_LIMIT_S:g} s")
        if self.state["phase"] not in (PLACE, HOLD):
            self._ticks += 1
        elif reading.t_s > self._course.hold_s + self._operator.release_limit_s:
            return Ending(
                "not released", "the ball was not seen to leave the place where it was held"
            )
        if self._ticks < len(self._course.targets_m):
            return None
        return Ending("ball lost", "the ball was out of sight at the end") if blind else DONE

    def _push_now(self, t_s: float) -> tuple[float, float]:
        if self.state["phase"] in (PLACE, HOLD):
            return (0.0, 0.0)
        if t_s < self._push_until:
            return self._push
        x, y = self._course.pushes_m_s2[self._ticks]
        wanted = bool(x or y)
        if wanted and not self._pushing:
            self._ask("push", t_s)
        self._pushing = wanted
        return float(x), float(y)

    def _obey(self, command: Push | Target | SetGains, t_s: float) -> None:
        words = said(command)
        if isinstance(command, Push):
            self._push, self._push_until = command.acceleration_m_s2, t_s + command.seconds
        elif isinstance(command, Target):
            if command.xy_m is None or np.all(np.abs(command.xy_m) <= self._reach_m):
                self._target = command.xy_m
            else:  # off the plate, or no number
                words = f"{words.removeprefix(BY_HAND)} is off the plate: refused"
        else:
            gains = (command.kp, command.ki, command.kd)
            for key, value, top in zip(("kp", "ki", "kd"), gains, HIGHEST_GAINS, strict=True):
                self._q["control"][key] = min(max(value, 0.0), top) if np.isfinite(value) else 0.0
        self._event(t_s, words)
