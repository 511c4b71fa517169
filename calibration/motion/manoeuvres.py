"""What a table is made to do so that its servos and their backlash show; no ball is needed.

A manoeuvre moves one axis; two run side by side, each at its own pace. It is a generator that takes
the axis's angle [rad] and yields the volts it asks for with the number of the move that they belong
to: k > 0 while move k is driven, -k while the servo comes to rest after it, 0 between moves. What
is applied is decided by `rig.safety.limits.limit` alone.

* `ramps`, `pulses`: breakaway volts, gain and time constant (`servo.py`).
* `sweeps`, `strikes`: backlash (`backlash.py`).
* `wiggle`: the camera's delay (`timing.py`).
* `probe`: wiring and signs, before anything moves far.

Where backlash must not show, an arm moves the same way several times: the first move takes it up.
"""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from calibration.camera.sheet import CalibrationError
from rig.parameters import Servo
from rig.safety.limits import SLEW_V_S, braking, free_rate, limit
from rig.table import Table, takes_angle

Manoeuvre = Generator[tuple[float, int], float, None]

# Chosen, because a linkage allows about +-0.5 rad: a move starts and ends well inside of that.
ANGLE_LIMIT_RAD, START_RAD, END_RAD = 0.5, -0.36, 0.34
PATIENCE_S = 400.0  # chosen: 4 times the longest manoeuvre
REST_S = 0.35  # chosen: 8 time constants of a servo
# Ramps: so slow that friction, not inertia, decides when the arm moves off.
RAMP_V_S, RAMP_TOP_V, RAMP_TRAVEL_RAD = 0.12, 1.5, 0.13
# Pulses: so long that the speed settles (0.4 s), of sizes that part gain from friction.
PULSE_TRAVEL_RAD, PULSE_LONGEST_S = 0.11, 0.4
PULSES_V = (1.0, 1.6, 2.3, 3.0)
# Probe: moves any servo that is connected by several encoder counts, none by more than 0.2 rad.
PROBE_V, PROBE_S, MOVED_RAD = 1.2, 0.15, 0.01
# Sweeps: slow enough that friction keeps the teeth closed on the driving side.
SWEEP_REACH_RAD, SWEEP_RAD_S = 0.22, 0.4
# Strikes: no two of one size, so that the rounding of the times to ticks averages out.
STRIKES_V, STRIKE_REST_S, STRIKE_LONGEST_S = (1.2, 2.8), 0.25, 0.25
PRESS_V = 0.12  # keeps the teeth closed at rest: over a motor's friction, under an arm's


@dataclass(frozen=True, eq=False)
class Trace:
    """A recording of manoeuvres, tick by tick, with columns x and y: `t_s` (n,) [s]; all others (n,
    2).

    `volts`: applied from each tick to the next [V]; `theta_rad`: encoder angles, `speed_rad_s`:
    tachometer speeds (NaN where there are none); `move`: numbers of the moves as manoeuvres yield
    them.
    """

    t_s: np.ndarray
    volts: np.ndarray
    theta_rad: np.ndarray
    speed_rad_s: np.ndarray
    move: np.ndarray


def perform(
    table: Table, manoeuvres: tuple[Manoeuvre, Manoeuvre], *, encoder: bool = True
) -> Trace:
    """Run the manoeuvres of both axes side by side until both are done, then apply 0 V; the trace
    of all ticks.

    `encoder`: False where there is none: the integrated tachometer then stands in for the angle,
    and `theta_rad` of the trace is NaN. `CalibrationError`: a manoeuvre fails, or has not ended
    after PATIENCE_S; the table's servos take angles.
    """
    if takes_angle(table):
        raise CalibrationError("this table's servos take an angle: volts cannot move them")
    servo = Servo()  # the usual one: this one is not measured yet
    kept = float(np.exp(-table.period_s / servo.time_constant_s))
    stops = braking(servo, table.period_s)
    bounds = (table.voltage_limit_V, ANGLE_LIMIT_RAD, SLEW_V_S * table.period_s, stops, 0.0)
    wanted, applied, free = [next(one) for one in manoeuvres], [0.0, 0.0], [0.0, 0.0]
    rows: list[tuple[float, ...]] = []
    motor, last, ended = [0.0, 0.0], None, 0
    while ended < 2:
        reading, ended = table.read(), 0
        speed = reading.motor_speed_rad_s or (np.nan, np.nan)
        motor = [m + np.nan_to_num(w) * table.period_s for m, w in zip(motor, speed, strict=True)]
        angle = reading.theta_rad if encoder else (motor[0], motor[1])
        for a, manoeuvre in enumerate(manoeuvres):
            try:
                wanted[a] = manoeuvre.send(float(angle[a]))
            except StopIteration:
                ended, wanted[a] = ended + 1, (0.0, 0)
            rate = 0.0 if last is None else (angle[a] - last[a]) / table.period_s
            free[a] = free_rate(free[a], applied[a], servo.gain_rad_s_V, kept)
            applied[a] = float(limit(wanted[a][0], angle[a], rate, applied[a], *bounds, free[a]))
        table.drive((applied[0], applied[1]))
        shown = reading.theta_rad if encoder else (np.nan, np.nan)
        rows.append((reading.t_s, *applied, *shown, *speed, wanted[0][1], wanted[1][1]))
        last = angle
        if rows[-1][0] - rows[0][0] > PATIENCE_S:
            raise CalibrationError(
                f"a servo did not come to its end in {PATIENCE_S:g} s: is something in its way?"
            )
    table.drive((0.0, 0.0))
    made = np.array(rows)
    return Trace(made[:, 0], made[:, 1:3], made[:, 3:5], made[:, 5:7], made[:, 7:].astype(int))


class _AngleControl:
    """Volts V = clip(gain e + i, top_V), i' = integral e within +-most_V: a PI controller of the
    servo angle whose integral overcomes friction."""

    def __init__(
        self, period_s: float, gain: float, integral: float, most_V: float, top_V: float
    ) -> None:
        self._gain, self._step, self._period_s = gain, integral, period_s
        self._most_V, self._top_V, self._sum_V = most_V, top_V, 0.0

    def volts(self, error_rad: float) -> float:
        """Volts for this tick's error of the angle."""
        more = self._sum_V + self._step * error_rad * self._period_s
        self._sum_V = float(np.clip(more, -self._most_V, self._most_V))
        wanted = self._gain * error_rad + self._sum_V
        return float(np.clip(wanted, -self._top_V, self._top_V))


def _sweep_control(period_s: float) -> _AngleControl:
    return _AngleControl(period_s, 14.0, 60.0, 1.0, 4.0)


def rest(seconds: float, period_s: float, bias_V: float, move: int = 0) -> Manoeuvre:
    """Hold `bias_V`, the volts at which the motor feels no torque, for `seconds`, at least one
    tick, under the move number `move`."""
    for _ in range(max(1, round(seconds / period_s))):
        yield bias_V, move


def go_to(target_rad: float, period_s: float, bias_V: float, *, seconds: float = 2.0) -> Manoeuvre:
    """Drive to the angle `target_rad` until within 0.01 rad, for at most `seconds`; then rest. All
    ticks have move number 0."""
    theta = yield bias_V, 0
    control = _AngleControl(period_s, 10.0, 20.0, 0.8, 2.5)
    for _ in range(round(seconds / period_s)):
        error = target_rad - theta
        theta = yield control.volts(error), 0
        if abs(error) < 0.01:
            break
    yield from rest(REST_S, period_s, bias_V)


def ramps(period_s: float, bias_V: float, times: int) -> Manoeuvre:
    """Ramps of RAMP_V_S from `bias_V`, each until the arm has moved by RAMP_TRAVEL_RAD: `times` up
    and then `times` down.

    `CalibrationError`: the arm does not move that far within RAMP_TOP_V.
    """
    number = 0
    for sign in (1.0, -1.0):
        yield from go_to(sign * START_RAD, period_s, bias_V)
        for _ in range(times):
            number += 1
            start = theta = yield bias_V, 0
            more = 0.0
            while abs(theta - start) < RAMP_TRAVEL_RAD and more < RAMP_TOP_V:
                more += RAMP_V_S * period_s
                theta = yield bias_V + sign * more, number
            yield from rest(REST_S, period_s, bias_V, -number)
            if more >= RAMP_TOP_V:
                raise CalibrationError(
                    f"a servo does not move at {bias_V + sign * RAMP_TOP_V:+.1f} V: is its "
                    "amplifier on, are its wires connected?"
                )


def pulses(period_s: float, bias_V: float, sweeps: int = 4) -> Manoeuvre:
    """Constant volts (`bias_V` +- PULSES_V in turn) from rest, each until the arm has moved
    PULSE_TRAVEL_RAD or for PULSE_LONGEST_S; `sweeps` times to and fro over the range."""
    number = 0
    for sweep in range(sweeps):
        for sign in (1.0, -1.0):
            yield from go_to(sign * START_RAD, period_s, bias_V)
            start = theta = yield bias_V, 0
            size = sweep
            while sign * theta < END_RAD - PULSE_TRAVEL_RAD - 0.12:
                number, size = number + 1, size + 1
                volts = bias_V + sign * PULSES_V[size % len(PULSES_V)]
                for _ in range(round(PULSE_LONGEST_S / period_s)):
                    theta = yield volts, number
                    if abs(theta - start) > PULSE_TRAVEL_RAD:
                        break
                yield from rest(REST_S, period_s, bias_V, -number)
                start = theta = yield bias_V, 0


def sweeps(period_s: float, count: int) -> Manoeuvre:
    """Move at SWEEP_RAD_S from one end of +-SWEEP_REACH_RAD to the other `count` times, after a
    first way down to the lower end with number 0; odd moves go up."""
    angle = yield 0.0, 0
    control, aim = _sweep_control(period_s), angle
    for number in range(count + 1):
        way = 1.0 if number % 2 else -1.0
        while (way * SWEEP_REACH_RAD - aim) * way > 0.0:
            aim += way * SWEEP_RAD_S * period_s
            angle = yield control.volts(aim - angle), number
    for _ in range(round(0.3 / period_s)):
        yield 0.0, 0


def strikes(period_s: float, bias_V: float, count: int) -> Manoeuvre:
    """Apply constant volts from rest until the arm moves, `count` times; odd moves go up. The size
    differs from strike to strike within STRIKES_V, about `bias_V`; a slow push the other way closes
    the teeth before each."""
    angle = yield bias_V, 0
    for number in range(1, count + 1):
        way = 1.0 if number % 2 else -1.0
        control, start, aim = _sweep_control(period_s), angle, angle
        while abs(angle - start) < 0.06 and abs(aim - start) < 0.4:
            aim -= way * SWEEP_RAD_S * period_s
            angle = yield bias_V + control.volts(aim - angle), 0
        for _ in range(round(STRIKE_REST_S / period_s)):  # unpressed, a motor rebounds into the gap
            angle = yield bias_V - way * PRESS_V, 0
        start = angle
        low, high = STRIKES_V
        size = low + (high - low) * (0.618034 * number % 1.0)  # the golden ratio: no size twice
        for _ in range(round(STRIKE_LONGEST_S / period_s)):
            angle = yield bias_V + way * size, number
            if abs(angle - start) > 0.01:
                break
        for _ in range(round(STRIKE_REST_S / period_s)):
            angle = yield bias_V, 0


def wiggle(period_s: float, seconds: float, hertz: tuple[float, ...]) -> Manoeuvre:
    """Follow a sum of sines of the frequencies `hertz` [Hz] for `seconds`, with amplitudes that sum
    to 0.3 rad."""
    size = 0.3 / max(len(hertz), 1)
    theta = yield 0.0, 0
    for k in range(round(seconds / period_s)):
        t = k * period_s
        waves = sum(np.sin(2 * np.pi * f * t + i) for i, f in enumerate(hertz))
        target = size * min(t / 0.5, 1.0) * waves
        theta = yield float(np.clip(14.0 * (target - theta), -6.0, 6.0)), 0


def probe(table: Table) -> None:
    """Apply PROBE_V to one axis after the other for PROBE_S and check the signs.
    `CalibrationError`: swapped axes, a wrong sign, or a servo that does not answer."""
    for a, name in enumerate("xy"):
        volts = (PROBE_V, 0.0) if a == 0 else (0.0, PROBE_V)
        before = table.read().theta_rad
        after = _hold(table, volts, PROBE_S)
        table.drive((0.0, 0.0))
        moved = np.subtract(after, before)
        if abs(moved[1 - a]) > max(MOVED_RAD, abs(moved[a])):
            raise CalibrationError(
                f"direction signs: volts on motor {name} turn the encoder of {'yx'[a]}: swap the "
                "motors' or the encoders' plugs"
            )
        if moved[a] < -MOVED_RAD:
            raise CalibrationError(
                f"direction signs: a positive voltage lowers the servo angle of {name}: turn the "
                "sign of that motor or encoder in the driver"
            )
        if moved[a] < MOVED_RAD:
            raise CalibrationError(
                f"direction signs: servo {name} does not answer to {PROBE_V:g} V (it moved by "
                f"{moved[a]:.3f} rad): is its amplifier on, its encoder connected?"
            )
        _hold(table, (0.0, 0.0), 0.3)


def _hold(table: Table, volts: tuple[float, float], seconds: float) -> tuple[float, float]:
    """Apply constant volts; the angles at the end."""
    first = now = table.read()
    while now.t_s - first.t_s < seconds:
        table.drive(volts)
        now = table.read()
    return now.theta_rad
