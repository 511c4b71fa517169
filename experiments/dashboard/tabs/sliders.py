"""Sliders that act together: presets, undo, and the way back to where they began."""

import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from experiments.dashboard.server.controls import Controls
from experiments.dashboard.server.input_limits import Range, choice

if TYPE_CHECKING:
    from viser import ViserServer

OWN = "of my own"
ONE_MOVE_S = 1.0  # values of one slider that follow each other so soon are one move of it; chosen
MOST_UNDONE = 50  # moves that are remembered; chosen


class SliderGroup:
    """Sliders in the GUI container of viser that is open, whose values are applied together.

    rows: label, limits and first value of each; apply: is given all values whenever one changes
    (ValueError: refused); presets: name -> values, clamped to the limits.
    """

    def __init__(
        self,
        server: "ViserServer",
        controls: Controls,
        rows: Sequence[tuple[str, Range, float]],
        apply: Callable[[list[float]], None],
        *,
        hint: str,
        presets: Mapping[str, Sequence[float]] | None = None,
    ) -> None:
        gui, self._apply = server.gui, apply
        self._limits = [limits for _, limits, _ in rows]
        self._start = [value for *_, value in rows]
        self._past: list[list[float]] = []
        self._moved, self._moved_s = -1, 0.0  # which slider, and when
        self._preset: Any = None
        if presets:
            names = (OWN, *presets)
            self._preset = gui.add_dropdown("Preset", names, initial_value=next(iter(presets)))
            take = partial(self._take, dict(presets))
            self._chosen = controls.value(
                self._preset, "preset", partial(choice, options=names), take
            )
        self._handles = [
            gui.add_slider(label, limits.low, limits.high, limits.step, value, hint=hint)
            for label, limits, value in rows
        ]
        self._kept = [
            controls.value(handle, label, limits.clamp, partial(self._move, i))
            for i, (handle, (label, limits, _)) in enumerate(zip(self._handles, rows, strict=True))
        ]
        words = " / ".join(f"{value:g}" for value in self._start)
        controls.button(gui.add_button("Undo", color="gray"), "undo", lambda page: self.undo())
        reset = gui.add_button(f"Reset to {words}")
        controls.button(reset, "reset", lambda page: self.set(self._start))

    @property
    def values(self) -> list[float]:
        """The values as they are applied."""
        return [kept.now for kept in self._kept]

    def set(self, values: Sequence[float]) -> None:
        """Apply these values, clamped, and show them; they can be undone."""
        self._set(values)
        self._is_own()

    def _set(self, values: Sequence[float]) -> None:
        before = self.values
        self._use([one.clamp(v) for one, v in zip(self._limits, values, strict=True)])
        self._remember(before, -1)

    def undo(self) -> None:
        """Go back to the values before the last move. ValueError: there was none."""
        if not self._past:
            raise ValueError("nothing was changed yet")
        self._use(self._past[-1])
        self._past.pop()
        self._moved = -1
        self._is_own()

    def _use(self, values: list[float]) -> None:
        self._apply(values)
        for kept, handle, value in zip(self._kept, self._handles, values, strict=True):
            kept.now = handle.value = value

    def _take(self, presets: Mapping[str, Sequence[float]], name: str) -> None:
        if name != OWN:
            self._set(presets[name])

    def _move(self, which: int, value: float) -> None:
        """One slider was moved; it keeps its own value."""
        before = self.values
        self._apply([value if i == which else v for i, v in enumerate(before)])
        self._remember(before, which)
        self._is_own()

    def _remember(self, before: list[float], which: int) -> None:
        now_s = time.monotonic()
        same = which >= 0 and which == self._moved and now_s - self._moved_s < ONE_MOVE_S
        self._moved, self._moved_s = which, now_s
        if not same:
            self._past = [*self._past[1 - MOST_UNDONE :], before]

    def _is_own(self) -> None:
        if self._preset is not None and self._preset.value != OWN:
            self._preset.value = self._chosen.now = OWN
