"""From a rig and its hobby servos to an open table on a pulse board."""

from collections.abc import Sequence

from rig.hardware.board.link import Link
from rig.hardware.board.pulse_servo import PulseServo
from rig.hardware.board.pulse_table import FRAME_S, PulseTable
from rig.hardware.observations import ObservationSource
from rig.parameters import Rig


def open_pulse_board(
    link: Link,
    rig: Rig,
    servos: Sequence[PulseServo],
    eye: ObservationSource | None = None,
    *,
    order: Sequence[int] | None = None,
    **session,
) -> PulseTable:
    """Return the table of `rig` whose servos hang on a pulse board behind `link`, disarmed.

    servos: by channel of the board; order: by channel, the linkage's servo on it (default: as they
    come; of two rods 0 is x, 1 is y; of three arms those at 0, 120 and 240 degrees from +x). Of the
    rig: angle and rate limit, the servos' period as the frame of the pulses (0: 20 ms), control
    rate and linkage. session: clock and random_below of `BoardSession`. ValueError: as
    `PulseTable`, or servos that take no angle, or are not as many as the linkage has. LinkLost: as
    `PulseTable`.
    """
    try:
        _check(rig, len(servos))
    except BaseException:
        link.close()
        raise
    return PulseTable(
        link,
        servos,
        rig.linkage,
        order or range(rig.linkage.servos),
        angle_limit_rad=rig.servo.angle_limit_rad,
        rate_limit_rad_s=rig.servo.pair("rate_limit_rad_s"),
        frame_s=rig.servo.pair("period_s")[0] or FRAME_S,
        period_s=1 / rig.control_rate_hz,
        eye=eye,
        **session,
    )


def _check(rig: Rig, servos: int) -> None:
    """ValueError: what pulses cannot do for a rig."""
    if not rig.servo.takes_angle:
        raise ValueError("servo.kind = 'voltage': servos on pulses take an angle: 'position'")
    if servos != rig.linkage.servos:
        raise ValueError(f"{servos} servos on pulses, the linkage has {rig.linkage.servos}")
    frames = rig.servo.pair("period_s")
    if frames[0] != frames[1]:
        raise ValueError("servo.x.period_s and servo.y.period_s differ: pulses have one frame")
