"""A table whose servos take an angle, whatever brings it to them: told by axis or by servo."""

from collections.abc import Sequence
from math import isfinite

from rig.linkage import Linkage


class ServoTable:
    """Mixin of a table: `drive` takes the plate's axes, `turn` the servos.

    linkage: what the servos do to the plate; angle_limit_rad: of both axes. boot_id: such a servo
    means the same angle after a power-up.
    """

    takes_angle = True
    boot_id = "absolute"

    def __init__(self, linkage: Linkage, angle_limit_rad: float) -> None:
        self._linkage, self._limit_rad = linkage, angle_limit_rad
        self._limits_rad = linkage.servo_limits_rad(angle_limit_rad)
        # Loads what is compiled of the linkage: that takes longer than a watchdog waits.
        linkage.table_angles(linkage.servo_angles((0.0, 0.0)))

    def drive(self, volts: tuple[float, float]) -> None:
        """Tell the servos what brings the table to angles (x, y) [rad] in place of volts, cut at
        the angle limit, to hold until newer ones.

        ValueError: angles that are not finite, or other than 0 on a table that is not armed.
        OSError: the table is lost or has stopped.
        """
        x, y = _within(volts, (self._limit_rad, self._limit_rad))
        self._tell(self._linkage.servo_angles((x, y)))

    def turn(self, angles: Sequence[float]) -> None:
        """Tell the servos angles from level [rad], cut where the angle limit asks no more of them.

        ValueError, OSError: as `drive`.
        """
        self._tell(_within(angles, self._limits_rad))

    def _tell(self, angles: Sequence[float]) -> None:
        """Tell angles by servo [rad]; all 0: also where the table is not armed."""
        raise NotImplementedError


def _within(angles: Sequence[float], limits: Sequence[float]) -> list[float]:
    """The angles cut at +-limits [rad]. ValueError: they are not finite."""
    if not all(map(isfinite, angles)):
        raise ValueError(f"angles must be finite, got {tuple(angles)}; use rig.safety.limits")
    return [min(max(one, -most), most) for one, most in zip(angles, limits, strict=True)]
