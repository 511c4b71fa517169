"""What a person guesses of the demo's hidden play: something to guess from, and two fields."""

import re
from collections.abc import Mapping, Sequence
from math import degrees
from typing import TYPE_CHECKING, Any

from experiments.dashboard.server.controls import Controls
from experiments.dashboard.server.untrusted_text import plain

if TYPE_CHECKING:
    from viser import ViserServer

DIGITS = re.compile(r"\d{0,2}[.,]?\d{0,3}")
ASKS = "**Guess before it ends**, how much play each axis has."


def digits(value: Any) -> str:
    """What somebody types as a number, so far; "" for none. ValueError: it is no number."""
    if not isinstance(value, str) or DIGITS.fullmatch(value) is None:
        raise ValueError("a guess is a number of degrees, such as 1.5")
    return value


class Guess:
    """Builds the fields, hidden, in the GUI container of viser that is open."""

    def __init__(self, server: "ViserServer", controls: Controls) -> None:
        gui = server.gui
        self._words: Any = gui.add_markdown("", visible=False)
        self._shown: list[Any] = [self._words]
        self._values = {}
        for axis in "xy":
            label = f"Your guess: play of {axis} [degrees]"
            field = gui.add_text(label, "", visible=False)  # a number would begin as a guess
            self._values[axis] = controls.value(field, label, digits)
            self._shown.append(field)

    def ask(self, clues: Sequence[str]) -> None:
        """Show the fields below what there is to guess from."""
        self._words.content = "  \n".join([ASKS, *map(plain, clues)])
        self._show(True)

    def end(self) -> None:
        """Take the fields away; what was guessed stays."""
        self._show(False)

    def _show(self, visible: bool) -> None:
        for one in self._shown:
            one.visible = visible

    def against(self, hidden_rad: Mapping[str, float]) -> str:
        """Markdown on the guess beside the plays (axis -> full width) that were hidden; "" where
        nobody guessed."""
        guessed = {axis: one.now.replace(",", ".") for axis, one in self._values.items()}
        guessed = {axis: f"{float(one):.1f}" for axis, one in guessed.items() if one.strip(".")}
        if not guessed:
            return ""
        parts = [
            f"{axis} {guessed.get(axis, 'not guessed')}, hidden {degrees(play):.1f}"
            for axis, play in hidden_rad.items()
        ]
        return f"**Your guess**: {'; '.join(parts)} degrees."
