"""Which effects the logs of a table can tell apart, and on which side they show them."""

from dataclasses import replace

from rig.effects import ANGLES, Effect, effects_of
from rig.linkage import THREE_ARMS
from rig.parameters import Rig

# Where servos take an angle that nobody measures, these make the same data as others do, whatever
# the motion: a late camera as late servos, its scale as theirs, their zero as the level.
TOLD_TWINS = {
    "servo_dead_time": ("camera_delay", "delay_servo_to_plate"),
    "angle_scale": ("camera_scale", "linkage_gain", "ball_inertia"),
    "level_offset": ("angle_zero", "asymmetric_play"),
}


# Each of three arms follows its command with the values of both axes in its own shares, so that
# these, on either axis, show in both tilts; what befalls the command itself stays on its axis.
IN_BOTH = "servos"  # the side of such an effect
OF_EACH_ARM = ("servo_lag", "rate_limit", "command_dead_band")


def in_ball(effect: Effect) -> bool:
    """Whether the ball shows the effect (of `effects_in`), not what the servo's encoder reads."""
    return effect.side not in ("servo", IN_BOTH)


def effects_in(rig: Rig) -> tuple[Effect, ...]:
    """The effects of the rig's catalogue that its logs can tell apart (see TOLD_TWINS), each on the
    side on which they show it: the ball alone shows those of servos whose angle nobody measures, of
    three arms that read it back both axes show those of each arm (IN_BOTH)."""
    known = effects_of(rig.servo.kind, rig.catalogue.values())
    twins = {twin for names in TOLD_TWINS.values() for twin in names}
    if rig.servo.takes_angle and not rig.servo.has_angle:
        return tuple(
            replace(e, side="ball") if e.servos == ANGLES else e
            for e in known
            if e.name not in twins
        )
    if rig.servo.takes_angle and rig.linkage.kind == THREE_ARMS:
        return tuple(replace(e, side=IN_BOTH) if e.name in OF_EACH_ARM else e for e in known)
    return known
