"""What a table is made to do so that its servos can be measured: ramps and pulses, no ball.

Both axes work at once, each at its own pace: an axis is a generator that takes its encoder angle
and gives the volts it wants; the one clamp of `rig.limits` decides. Where directions matter the arm
moves the same way several times: the first time takes up the play, the others find it closed.
"""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from calibration.sheet import CalibrationError
from rig.limits import SLEW_V_S, limit
from rig.table import Table

# Takes the encoder's angle [rad]; gives volts and the move that they belong to: its number above
# zero while it is driven, minus that while the servo comes to rest, 0 between moves.
Axis = Generator[tuple[float, int], float, None]

START_RAD, END_RAD = -0.36, 0.34  # between them every manoeuvre moves
RAMP_V_S, RAMP_TOP_V, RAMP_TRAVEL_RAD = 0.12, 1.5, 0.13
PULSE_TRAVEL_RAD, PULSE_LONGEST_S, REST_S = 0.11, 0.4, 0.35
PULSES_V = (1.0, 1.6, 2.3, 3.0)
PROBE_V, PROBE_S, MOVED_RAD = 1.2, 0.15, 0.01
PATIENCE_S = 400.0


@dataclass(frozen=True, eq=False)
class Trace:
    """What happened: t_s (n,), volts applied from each tick to the next (n, 2), encoders (n, 2),
    numbers of the moves (n, 2) as an `Axis` gives them."""

    t_s: np.ndarray
    volts: np.ndarray
    theta_rad: np.ndarray
    move: np.ndarray


def perform(table: Table, axes: tuple[Axis, Axis], *, angle_limit_rad: float = 0.5) -> Trace:
    """Let both axes work until they are done. `CalibrationError`: they never are."""
    slew = SLEW_V_S * table.period_s
    bounds = (table.voltage_limit_V, angle_limit_rad, slew)
    rows: list[tuple[float, ...]] = []
    wishes, applied = [next(axis) for axis in axes], [0.0, 0.0]
    last: tuple[float, float] | None = None
    ended = 0
    while ended < 2:
        reading = table.read()
        theta, ended = reading.theta_rad, 0
        for a, axis in enumerate(axes):
            try:
                wishes[a] = axis.send(theta[a])
            except StopIteration:
                ended, wishes[a] = ended + 1, (0.0, 0)
            rate = 0.0 if last is None else (theta[a] - last[a]) / table.period_s
            applied[a] = float(limit(wishes[a][0], theta[a], rate, applied[a], *bounds))
        table.drive((applied[0], applied[1]))
        rows.append((reading.t_s, *applied, *theta, wishes[0][1], wishes[1][1]))
        last = theta
        if rows[-1][0] - rows[0][0] > PATIENCE_S:
            raise CalibrationError(
                f"a servo did not come to its end in {PATIENCE_S:g} s: is something in its way?"
            )
    table.drive((0.0, 0.0))
    found = np.array(rows)
    return Trace(found[:, 0], found[:, 1:3], found[:, 3:5], found[:, 5:].astype(int))


def rest(seconds: float, period_s: float, bias_V: float, move: int = 0) -> Axis:
    """The volts at which the motor feels none, for so long."""
    for _ in range(max(1, round(seconds / period_s))):
        yield bias_V, move


def go_to(target_rad: float, period_s: float, bias_V: float, *, seconds: float = 2.0) -> Axis:
    """To an angle by proportional volts with enough integral to beat friction."""
    theta = yield bias_V, 0
    total = 0.0
    for _ in range(round(seconds / period_s)):
        error = target_rad - theta
        total = float(np.clip(total + 20.0 * error * period_s, -0.8, 0.8))
        theta = yield float(np.clip(10.0 * error + total, -2.5, 2.5)), 0
        if abs(error) < 0.01:
            break
    yield from rest(REST_S, period_s, bias_V)


def ramps(period_s: float, bias_V: float, times: int) -> Axis:
    """Slow ramps of volts until the arm moves off, `times` up and then `times` down."""
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


def pulses(period_s: float, bias_V: float, sweeps: int = 4) -> Axis:
    """Volts of several sizes from rest until the arm has moved a little, to and fro."""
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


def probe(table: Table) -> None:
    """Nudge one axis after the other: refuse a table whose signs or axes are wrong."""
    for a, name in enumerate("xy"):
        volts = (PROBE_V, 0.0) if a == 0 else (0.0, PROBE_V)
        before = table.read().theta_rad
        first = now = table.read()
        while now.t_s - first.t_s < PROBE_S:
            table.drive(volts)
            now = table.read()
        table.drive((0.0, 0.0))
        moved = np.subtract(now.theta_rad, before)
        other = "yx"[a]
        if abs(moved[1 - a]) > max(MOVED_RAD, abs(moved[a])):
            raise CalibrationError(
                f"direction signs: volts on motor {name} turn the encoder of {other}: swap the "
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
        _settle(table)


def _settle(table: Table, seconds: float = 0.3) -> None:
    first = now = table.read()
    while now.t_s - first.t_s < seconds:
        table.drive((0.0, 0.0))
        now = table.read()


def wiggle(period_s: float, seconds: float, hertz: tuple[float, ...]) -> Axis:
    """Follow a sum of sines of 0.3 rad in all, for the camera's delay against the encoders."""
    size = 0.3 / max(len(hertz), 1)
    theta = yield 0.0, 0
    for k in range(round(seconds / period_s)):
        t = k * period_s
        waves = sum(np.sin(2 * np.pi * f * t + i) for i, f in enumerate(hertz))
        target = size * min(t / 0.5, 1.0) * waves
        theta = yield float(np.clip(14.0 * (target - theta), -6.0, 6.0)), 0
