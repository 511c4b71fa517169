"""Which effects the logs of a table can tell apart, and on which side they show them."""

from dataclasses import replace

from rig.effects import ANGLES, Effect, effects_of
from rig.linkage import RODS
from rig.parameters import Rig

# Where servos take an angle that nobody measures, these make the same data as others do, whatever
# the motion: a late camera as late servos, its scale as theirs, their zero as the level.
TOLD_TWINS = {
    "servo_dead_time": ("camera_delay", "delay_servo_to_plate"),
    "angle_scale": ("camera_scale", "linkage_gain", "ball_inertia"),
    "level_offset": ("angle_zero", "asymmetric_play"),
}


def in_ball(effect: Effect) -> bool:
    """Whether the ball shows the effect (of `effects_in`), not what the servo's encoder reads."""
    return effect.side != "servo"


def has_commanded_servos(rig: Rig) -> bool:
    """Whether servos' outputs are angles by commands: of three arms no servo has the tilt's."""
    return rig.servo.takes_angle and rig.linkage.kind == RODS


def effects_in(rig: Rig) -> tuple[Effect, ...]:
    """The effects of the rig's catalogue that its logs can tell apart (see TOLD_TWINS), each on the
    side on which they show it: the ball alone shows those of servos whose angle nobody measures.
    Three arms that read their angles back show theirs in no output yet."""
    known = effects_of(rig.servo.kind, rig.catalogue.values())
    twins = {twin for names in TOLD_TWINS.values() for twin in names}
    if not rig.servo.takes_angle:
        return known
    if rig.servo.has_angle:
        return tuple(e for e in known if e.servos != ANGLES or has_commanded_servos(rig))
    return tuple(
        replace(e, side="ball") if e.servos == ANGLES else e for e in known if e.name not in twins
    )
