"""What a table is made to do so that its play shows: slow sweeps to and fro, and strikes from rest.

*Sweeps*: the arm at constant speed up and down; friction keeps the teeth closed on the driving
side, so which side is known. Without an encoder the integrated tachometer stands in for it.
*Strikes*: from rest against one side constant volts towards the other, until the arm moves.
"""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from rig.limits import SLEW_V_S, limit
from rig.table import Table

# Takes angle [rad]; gives volts and a label: sweep or strike number, 0 between them.
Move = Generator[tuple[float, int], float, None]
REACH_RAD, SPEED_RAD_S = 0.22, 0.4
GAIN_V_RAD, INTEGRAL_V_RAD_S = 14.0, 60.0
STRIKES_V = (1.2, 2.8)  # no two alike: the ticks' rounding of the times then averages out
REST_S, LONGEST_S = 0.25, 0.25
PRESS_V = 0.12  # keeps the teeth closed at rest: more than rubs in a motor, less than moves an arm


@dataclass(frozen=True, eq=False)
class Motion:
    """What happened tick by tick: t_s (n,); volts applied from each tick on, encoders (NaN without)
    and tachometers (NaN without), (n, 2); labels (n, 2) as a `Move` gives them."""

    t_s: np.ndarray
    volts: np.ndarray
    theta_rad: np.ndarray
    speed_rad_s: np.ndarray
    label: np.ndarray


def perform(table: Table, moves: tuple[Move, Move], *, encoder: bool = True) -> Motion:
    """Both axes through their moves; without `encoder` the motor's own angle is fed back."""
    bounds = (table.voltage_limit_V, 0.5, SLEW_V_S * table.period_s)
    wishes, applied, rows = [next(move) for move in moves], [0.0, 0.0], []
    motor, ended, last = np.zeros(2), 0, None
    while ended < 2:
        reading, ended = table.read(), 0
        speed = np.array(reading.motor_speed_rad_s or (np.nan, np.nan))
        motor = motor + np.nan_to_num(speed) * table.period_s
        angle = np.array(reading.theta_rad) if encoder else motor
        rate = np.zeros(2) if last is None else (angle - last) / table.period_s
        for a, move in enumerate(moves):
            try:
                wishes[a] = move.send(float(angle[a]))
            except StopIteration:
                ended, wishes[a] = ended + 1, (0.0, 0)
            applied[a] = float(limit(wishes[a][0], angle[a], rate[a], applied[a], *bounds))
        table.drive((applied[0], applied[1]))
        shown = reading.theta_rad if encoder else (np.nan, np.nan)
        rows.append((reading.t_s, *applied, *shown, *speed, wishes[0][1], wishes[1][1]))
        last = angle
    table.drive((0.0, 0.0))
    found = np.array(rows)
    return Motion(
        found[:, 0], found[:, 1:3], found[:, 3:5], found[:, 5:7], found[:, 7:].astype(int)
    )


def sweeps(period_s: float, count: int) -> Move:
    """`count` sweeps of 2 REACH_RAD, up first; numbers 1, 2, ..."""
    angle = yield 0.0, 0
    total, aim = 0.0, angle
    for number in range(count + 1):
        way = 1.0 if number % 2 else -1.0
        while (way * REACH_RAD - aim) * way > 0.0:
            aim += way * SPEED_RAD_S * period_s
            error = aim - angle
            total = float(np.clip(total + INTEGRAL_V_RAD_S * error * period_s, -1.0, 1.0))
            angle = yield float(np.clip(GAIN_V_RAD * error + total, -4.0, 4.0)), number
    for _ in range(round(0.3 / period_s)):
        yield 0.0, 0


def strikes(period_s: float, bias_V: float, count: int) -> Move:
    """`count` strikes, each after a short slow push the other way that closes the teeth."""
    angle = yield bias_V, 0
    for number in range(1, count + 1):
        way = 1.0 if number % 2 else -1.0
        start, total, aim = angle, 0.0, angle
        while abs(angle - start) < 0.06 and abs(aim - start) < 0.4:
            aim -= way * SPEED_RAD_S * period_s
            error = aim - angle
            total = float(np.clip(total + INTEGRAL_V_RAD_S * error * period_s, -1.0, 1.0))
            angle = yield bias_V + float(np.clip(GAIN_V_RAD * error + total, -4.0, 4.0)), 0
        for _ in range(round(REST_S / period_s)):  # unpressed, a smooth motor rebounds into the gap
            angle = yield bias_V - way * PRESS_V, 0
        start = angle
        low, high = STRIKES_V
        size = low + (high - low) * (0.618034 * number % 1.0)
        for _ in range(round(LONGEST_S / period_s)):
            angle = yield bias_V + way * size, number
            if abs(angle - start) > 0.01:
                break
        for _ in range(round(REST_S / period_s)):
            angle = yield bias_V, 0
