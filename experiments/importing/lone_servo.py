"""A recording of one servo by itself: `position` beside `goal_position`, as bus servos call them.

A ball's place and its target bear the same names, so it is asked which of both they are.
"""

from collections.abc import Sequence
from dataclasses import replace

from experiments.importing.draft import Draft
from experiments.importing.roles import columns_of
from experiments.importing.units import FACTORS, family

ANGLES = ("theta", "command")


def read_lone_servo(draft: Draft) -> None:
    """Read a lone place and its goal as a servo's measured and commanded angle, and doubt that.

    They are left as they are where they bear an axis, a length's unit or a word for the ball, where
    an angle stands beside them, or where somebody said what they are.
    """
    places, goals = (_nameless(draft, role) for role in ("ball", "target"))
    if len(places) != 1 or len(goals) != 1 or _has_angles(draft):
        return
    place, name = places[0], "theta_x_rad"
    if draft.said.get(name, {}).get("column", place) != place:
        return
    as_servo = {place: "theta", goals[0]: "command"}
    draft.hints = {
        column: replace(one, role=as_servo.get(column, one.role))
        for column, one in draft.hints.items()
    }
    why = f"is {place} the angle of a servo (and {goals[0]} what it is told), no ball's place"
    draft.doubt([name], "column", why, place, "none")


def _nameless(draft: Draft, role: str) -> Sequence[str]:
    """Columns of a role whose names say nothing of a ball, not even an axis or a length."""
    said = {k.get("column") for name, k in draft.said.items() if family(name) in ANGLES}
    names = [*columns_of(draft, role), *(name for name in draft.hints if name in said)]
    each = {name: draft.hints[name] for name in names}
    return [
        name
        for name, one in each.items()
        if one.role == role
        and one.axis is None
        and not one.explicit
        and one.unit not in FACTORS["length"]
    ]


def _has_angles(draft: Draft) -> bool:
    return any(columns_of(draft, role) for role in (*ANGLES, "angle"))
