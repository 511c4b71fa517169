"""From a rig and its hobby servos to an open table on a pulse board."""

from collections.abc import Callable, Sequence
from typing import Any

from rig.hardware.board.link import Link
from rig.hardware.board.pulse_servo import PulseServo
from rig.hardware.board.pulse_table import FRAME_S, PulseTable
from rig.hardware.observations import ObservationSource
from rig.linkage import THREE_ARMS
from rig.parameters import Rig
from rig.plant.ball import tilt_sines
from rig.three_arms import ARMS, arm_angle

Pair = tuple[float, float]


def open_pulse_board(
    link: Link,
    rig: Rig,
    servos: Sequence[PulseServo],
    eye: ObservationSource | None = None,
    *,
    swap: bool = False,
    **session,
) -> PulseTable:
    """Return the table of `rig` whose servos hang on a pulse board behind `link`, disarmed.

    servos: by channel of the board: with two rods x, y (swap: y, x); with three arms those of the
    arms at 0, 120 and 240 degrees from +x. Of the rig: angle and rate limit, the servos' period as
    the frame of the pulses (0: 20 ms), control rate and linkage. session: clock and random_below of
    `BoardSession`. ValueError: as `PulseTable`, or servos that take no angle, or are not as many as
    the linkage has, or swap with three arms. LinkLost: as `PulseTable`.
    """
    try:
        settings = _settings(rig, len(servos), swap)
    except BaseException:
        link.close()
        raise
    return PulseTable(
        link, servos, period_s=1 / rig.control_rate_hz, eye=eye, **settings, **session
    )


def _settings(rig: Rig, servos: int, swap: bool) -> dict[str, Any]:
    """What a PulseTable takes of a rig."""
    needed = ARMS if rig.linkage.kind == THREE_ARMS else 2
    if not rig.servo.takes_angle:
        raise ValueError("servo.kind = 'voltage': servos on pulses take an angle: 'position'")
    if servos != needed:
        raise ValueError(f"{servos} servos on pulses, the linkage has {needed}")
    if swap and needed == ARMS:
        raise ValueError("swap: three arms have no x and y to swap; put their servos in order")
    frames, rates = rig.servo.pair("period_s"), rig.servo.pair("rate_limit_rad_s")
    if frames[0] != frames[1]:
        raise ValueError("servo.x.period_s and servo.y.period_s differ: pulses have one frame")
    limit = rig.servo.angle_limit_rad
    common = {"angle_limit_rad": limit, "frame_s": frames[0] or FRAME_S}
    if needed == ARMS:
        slowest = [min(rates)] * ARMS
        return common | {
            "to_servos": _arms(rig), "limits_rad": _arm_limits(rig), "rates_rad_s": slowest
        }  # fmt: skip
    way = -1 if swap else 1
    return common | {
        "to_servos": lambda angles: angles[::way], "limits_rad": [limit] * 2,
        "rates_rad_s": rates[::way],
    }  # fmt: skip


def _arms(rig: Rig) -> Callable[[Pair], Sequence[float]]:
    """Tilt (x, y) [rad] to what three arms turn from level [rad]."""
    height, size = rig.linkage.height_m, rig.linkage.size
    level = [arm_angle(i, 0.0, 0.0, height, size) for i in range(ARMS)]

    def turned(tilt: Pair) -> Sequence[float]:
        s_x, s_y = tilt_sines(tilt, 1.0)
        return [arm_angle(i, s_x, s_y, height, size) - level[i] for i in range(ARMS)]

    return turned


def _arm_limits(rig: Rig) -> list[float]:
    """How far each arm turns at most [rad] while both tilts stay within their limit.

    An arm's angle is monotonic in the height of its joint, which is extreme on the tilts' edge; a
    mrad is left for what lies between the poses looked at.
    """
    limit, steps = rig.servo.angle_limit_rad, 16
    side = [limit * (2 * k / steps - 1) for k in range(steps + 1)]
    edge = [pose for t in side for pose in ((t, limit), (t, -limit), (limit, t), (-limit, t))]
    turned = [_arms(rig)(pose) for pose in edge]
    return [max(abs(pose[i]) for pose in turned) + 1e-3 for i in range(ARMS)]
