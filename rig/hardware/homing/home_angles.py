"""Homing of servos that take an angle: no stop is sought, only level.

They know where they are, so the rig file's trim says roughly where level is. The servos are
brought there slowly and swung a little, one after the other; where the plate's markers are seen,
they say which servo of the linkage each is, in which direction it turns, and by how much the trim
is off. Else these are the rig file's word, and homing only sees that each servo follows; one that
does not tell its angle (on pulses) is taken to be where its pulse tells it to.
"""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from rig.hardware.homing.home import Homing, Plan, confirmed, home, swing, unconfirmed
from rig.hardware.homing.homing_moves import (
    SWING_RAD,
    Arm,
    Channels,
    HomingRefused,
    Pair,
    Sight,
    hold,
    look,
)
from rig.parameters import Rig
from rig.table import Reading

SWING_SHARE = 0.8  # of the angle limit at most, so that no swing is cut off
FARTHEST_TRIM_RAD = 0.26  # chosen: 15 degrees; beyond it the horn sits a tooth off (25 teeth: 14.4)


@dataclass(frozen=True)
class AngleArm(Arm):
    """An arm whose servo goes by itself to the angle that it is told."""

    def towards(self, target: float, sight: Sight) -> float:
        """The angle to tell it [rad]: the target itself."""
        return target


def arm_at(channel: int, level_rad: float, half_rad: float) -> Arm:
    """The arm of a servo that holds the plate level at level_rad and may turn by half_rad from its
    trim to each side."""
    left = half_rad - abs(level_rad)
    return AngleArm(channel, channel, 1, 0.0, level_rad - left, level_rad + left)


def plan_angles(rig: Rig, travel_rad: Channels) -> Plan:
    """Yield the angles of the servos, by channel from the rig file's trim, tick by tick; return
    the homing, its zero_counts from that trim.

    travel_rad: by channel, twice the way to the nearer end of the servo's turn. HomingRefused: what
    was seen does not allow a homing; the message names it and the cure.
    """
    level_rad = [0.0] * len(travel_rad)
    sight = yield tuple(level_rad)
    limit_rad = min(rig.linkage.servo_limits_rad(rig.servo.angle_limit_rad))
    reach = min(SWING_RAD, SWING_SHARE * limit_rad)
    arms = [arm_at(channel, 0.0, 0.5 * travel) for channel, travel in enumerate(travel_rad)]
    sight = yield from hold(arms, level_rad, sight)
    columns, level, sight = yield from swing(arms, sight, reach)
    if level is None:
        yield from _follow(arms, sight, reach)
        return unconfirmed(arms, rig)
    confirmed(arms, columns, (0.0, 0.0), rig)  # columns that no table can have are refused first
    trims = _trims(columns, level)
    if max(map(abs, trims)) > FARTHEST_TRIM_RAD:
        raise HomingRefused(
            "not level",
            f"the plate would be level {max(trims, key=abs):.2f} rad from table.trim_rad: set the "
            "horns on their shafts anew, or correct table.trim_rad",
        )
    arms = [arm_at(k, trim, 0.5 * travel_rad[k]) for k, trim in enumerate(trims)]
    level, _, sight = yield from look(arms, trims, sight)
    if level is None:
        raise HomingRefused("no markers", "the markers were lost while the plate moved")
    return confirmed(arms, columns, level, rig)


def _follow(arms: list[Arm], sight: Sight, reach_rad: float) -> Generator[Channels, Sight, Sight]:
    """Each servo a little to both sides and back. HomingRefused: one does not follow."""
    for i in range(len(arms)):
        for angle in (reach_rad, -reach_rad, 0.0):
            sight = yield from hold(arms, [angle * (k == i) for k in range(len(arms))], sight)
    return sight


def _trims(columns: list[Pair], level: Pair) -> list[float]:
    """The smallest angles by channel [rad] at which the sines vanish: level + columns theta = 0.

    Where more than two servos move the plate, what lifts it without tilting it stays as it is: no
    tilt tells of it.
    """
    found = np.linalg.lstsq(np.array(columns).T, -np.array(level), rcond=None)[0]
    return [float(one) for one in found]


class Turned(Protocol):
    """A table whose servos can be told angles one by one."""

    period_s: float
    voltage_limit_V: float

    @property
    def turned_rad(self) -> Channels:
        """Where the servos are, from level [rad], by servo."""
        ...

    @property
    def travel_rad(self) -> Channels:
        """Twice the way from level to the nearer end of their turn [rad], by servo."""
        ...

    def read(self) -> Reading:
        """Wait for the next tick. OSError: the table is lost."""
        ...

    def turn(self, angles: Channels) -> None:
        """Tell the servos angles from level [rad]. ValueError, OSError: as a table's `drive`."""
        ...

    def close(self) -> None:
        """Close the table."""
        ...


class ByServo:
    """Such a table as homing drives and reads it: by servo, not by the plate's axes."""

    takes_angle = True

    def __init__(self, table: Turned) -> None:
        self._table = table
        self.period_s, self.voltage_limit_V = table.period_s, table.voltage_limit_V
        self.travel_rad = table.travel_rad

    def read(self) -> Reading:
        """Wait for the next tick; its angles [rad] are the servos'. OSError: the table is lost."""
        return replace(self._table.read(), theta_rad=self._table.turned_rad)  # pyright: ignore

    def drive(self, volts: Channels) -> None:
        """Tell the servos angles [rad]. ValueError, OSError: as the table."""
        self._table.turn(volts)

    def close(self) -> None:
        """Close the table."""
        self._table.close()


def home_angles(
    table: ByServo, rig: Rig, zero_counts: Sequence[int], tilt: Callable[[float], Pair | None]
) -> Homing:
    """Home an armed table that was opened with raw wiring; it ends level.

    zero_counts: of that wiring; tilt: as `home` takes it. HomingRefused: as `plan_angles`; OSError:
    the table is lost.
    """
    found = home(table, rig, tilt, plan_angles(rig, table.travel_rad))
    ways = zip(zero_counts, found.wiring.zero_counts, strict=True)
    zeros = tuple(old + new for old, new in ways)
    return replace(found, wiring=replace(found.wiring, zero_counts=zeros))
