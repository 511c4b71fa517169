"""Effects of a lab's own for tests: the shipped examples, and files written for a test."""

from pathlib import Path

from rig.own_effects import OwnEffect, read_effect
from tests.support import ROOT

EXAMPLES = ROOT / "experiments" / "rigs" / "own_effects"
FILE = """from rig import Effect, Parameter

EFFECT = Effect("{name}", "{side}", ("x", "y"), (Parameter("{key}", 0.0, "{unit}", -5.0, 5.0),),
                0.01, "For a test.")


def equation(u, v, t_s, {key}):
    return {formula}
"""


def example(name: str) -> OwnEffect:
    """A shipped example, "hanging_arm" or "pulling_cable"."""
    return read_effect(EXAMPLES / f"{name}.py")


def written(folder: Path, name: str, formula: str, *, side: str = "servo", key: str = "size_V"):
    """The file of an effect with one number, of which `formula` is the equation."""
    file = folder / f"{name}.py"
    unit = "V" if side == "servo" else "m/s2"
    file.write_text(FILE.format(name=name, side=side, key=key, unit=unit, formula=formula))
    return file
