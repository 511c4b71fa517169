"""Effects of a lab's own (`rig.own_effects`): Python, which no exported model carries."""

from dataclasses import replace

from rig.effects import BY_NAME
from rig.parameters import Rig


def left_out(rig: Rig) -> list[str]:
    """One line for each effect of the rig's own that acts."""
    return [
        f"effects.{name}: its equation is a Python file of the rig's own."
        for name in rig.effects
        if name not in BY_NAME
    ]


def without_own(rig: Rig) -> Rig:
    """The rig with the shipped effects alone."""
    kept = {name: by_axis for name, by_axis in rig.effects.items() if name in BY_NAME}
    return replace(rig, own=(), effects=kept)
