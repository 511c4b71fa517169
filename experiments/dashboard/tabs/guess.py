"""What a person guesses of the demo's hidden play: something to guess from, and two fields."""

from collections.abc import Mapping, Sequence
from math import degrees
from typing import TYPE_CHECKING, Any

from experiments.dashboard.server.controls import Controls
from experiments.dashboard.server.input_limits import BACKLASH_DEG
from experiments.dashboard.server.untrusted_text import plain

if TYPE_CHECKING:
    from viser import ViserServer

ASKS = "**Guess before it ends**, how much play each axis has."


class Guess:
    """Builds the fields, hidden, in the GUI container of viser that is open."""

    def __init__(self, server: "ViserServer", controls: Controls) -> None:
        gui = server.gui
        self._words: Any = gui.add_markdown("", visible=False)
        self._shown: list[Any] = [self._words]
        self._values = {}
        for axis in "xy":
            label = f"Your guess: play of {axis} [degrees]"
            low, high, step = BACKLASH_DEG.low, BACKLASH_DEG.high, BACKLASH_DEG.step
            field = gui.add_number(label, 0.0, min=low, max=high, step=step, visible=False)
            self._values[axis] = controls.value(field, label, BACKLASH_DEG.clamp)
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
        guessed = {axis: one.now for axis, one in self._values.items()}
        if not any(guessed.values()):
            return ""
        parts = [
            f"{axis} {guessed[axis]:.1f}, hidden {degrees(play):.1f}"
            for axis, play in hidden_rad.items()
        ]
        return f"**Your guess**: {'; '.join(parts)} degrees."
