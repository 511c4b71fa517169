"""Homing of servos that take an angle: no stop is sought, only level.

They know where they are, so the rig file's trim says roughly where level is. Both servos are
brought there slowly and swung a little, one after the other; where the plate's markers are seen,
they say which servo tilts which axis, in which direction, and by how much the trim is off. Else
these are the rig file's word, and homing only sees that each servo follows; one that does not tell
its angle (on pulses) is taken to be on its way to what it was told.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace

from rig.hardware.homing.home import Homing, Plan, confirmed, home, swing, unconfirmed
from rig.hardware.homing.homing_moves import (
    SWING_RAD,
    Arm,
    HomingRefused,
    Pair,
    Sight,
    hold,
    look,
)
from rig.parameters import Rig
from rig.table import Reading, Table

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


def plan_angles(rig: Rig, travel_rad: Pair) -> Plan:
    """Yield the angles of both servos, by channel from the rig file's trim, tick by tick; return
    the homing, its zero_counts from that trim.

    travel_rad: by channel, twice the way to the nearer end of the servo's turn. HomingRefused: what
    was seen does not allow a homing; the message names it and the cure.
    """
    sight = yield 0.0, 0.0
    reach = min(SWING_RAD, SWING_SHARE * rig.servo.angle_limit_rad)
    arms = [arm_at(channel, 0.0, 0.5 * travel) for channel, travel in enumerate(travel_rad)]
    sight = yield from hold(arms, [0.0, 0.0], sight)
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
    level, _, sight = yield from look(arms, [arm.middle for arm in arms], sight)
    if level is None:
        raise HomingRefused("no markers", "the markers were lost while the plate moved")
    return confirmed(arms, columns, level, rig)


def _follow(arms: list[Arm], sight: Sight, reach_rad: float) -> Generator[Pair, Sight, Sight]:
    """Each servo a little to both sides and back. HomingRefused: one does not follow."""
    for i in (0, 1):
        for angle in (reach_rad, -reach_rad, 0.0):
            sight = yield from hold(arms, [angle * (k == i) for k in (0, 1)], sight)
    return sight


def _trims(columns: list[Pair], level: Pair) -> Pair:
    """Angles by channel [rad] at which the sines vanish: level + columns theta = 0."""
    (a, c), (b, d) = columns
    scale = a * d - b * c
    return (b * level[1] - d * level[0]) / scale, (c * level[0] - a * level[1]) / scale


class AsTold:
    """A table whose servos do not tell their angles, read as if they went where they are told.

    rate_rad_s: at which they are taken to go there, from 0 on.
    """

    takes_angle = True

    def __init__(self, table: Table, rate_rad_s: float) -> None:
        self.period_s, self.voltage_limit_V = table.period_s, table.voltage_limit_V
        self._table, self._step_rad = table, rate_rad_s * table.period_s
        self._told = self._theta = (0.0, 0.0)

    def read(self) -> Reading:
        """Wait for the next tick; its angles [rad] are where the servos ought to be. OSError: the
        table is lost.
        """
        reading, most = self._table.read(), self._step_rad
        x, y = (
            now + min(max(told - now, -most), most)
            for now, told in zip(self._theta, self._told, strict=True)
        )
        self._theta = x, y
        return replace(reading, theta_rad=self._theta)

    def drive(self, volts: Pair) -> None:
        """Tell the servos angles [rad] in place of volts. ValueError, OSError: as the table."""
        self._told = volts
        self._table.drive(volts)

    def close(self) -> None:
        """Close the table."""
        self._table.close()


def home_angles(
    table: Table, rig: Rig, zero_counts: tuple[int, int], tilt: Callable[[float], Pair | None]
) -> Homing:
    """Home an armed table that was opened with raw wiring; it ends level.

    zero_counts: of that wiring; tilt: as `home` takes it. HomingRefused: as `plan_angles`; OSError:
    the table is lost.
    """
    stop = rig.servo.stop_rad
    travel = getattr(table, "travel_rad", (2 * stop, 2 * stop))
    if not rig.servo.has_angle:
        table = AsTold(table, min(rig.servo.pair("rate_limit_rad_s")))
    found = home(table, rig, tilt, plan_angles(rig, travel))
    a, b = (old + new for old, new in zip(zero_counts, found.wiring.zero_counts, strict=True))
    return replace(found, wiring=replace(found.wiring, zero_counts=(a, b)))
