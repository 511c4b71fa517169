"""Sliders that act together: presets, some kept by name, undo, and the way back to the start."""

import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from experiments.dashboard.server.controls import Controls
from experiments.dashboard.server.input_limits import Range, choice
from experiments.dashboard.session.presets import KeptPresets, preset_name

if TYPE_CHECKING:
    from viser import ViserServer

OWN = "of my own"
ONE_MOVE_S = 1.0  # values of one slider that follow each other so soon are one move of it; chosen
MOST_UNDONE = 50  # moves that are remembered; chosen


class SliderGroup:
    """Sliders in the GUI container of viser that is open, whose values are applied together.

    rows: label, limits and first value of each; apply: is given all values whenever one changes
    (ValueError: refused); presets: name -> values, clamped to the limits; kept: presets that a
    person may add under a name, and forget; check: raises where `apply` would refuse a page.
    """

    def __init__(
        self,
        server: "ViserServer",
        controls: Controls,
        rows: Sequence[tuple[str, Range, float]],
        apply: Callable[[list[float]], None],
        *,
        hint: str,
        presets: Mapping[str, Sequence[float]],
        kept: KeptPresets | None = None,
        check: Callable[[int], Any] = lambda page: None,
    ) -> None:
        gui, self._apply, self._presets, self._own = server.gui, apply, presets, kept
        self._limits = [limits for _, limits, _ in rows]
        self._start = [value for *_, value in rows]
        self._past: list[list[float]] = []
        self._moved, self._moved_s = -1, 0.0  # which slider, and when
        first = next(iter(presets))
        self._preset: Any = gui.add_dropdown("Preset", self._names, initial_value=first)
        self._chosen = controls.value(
            self._preset, "preset", lambda v: choice(v, self._names), self._take
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
        undo = gui.add_button("Undo", color="gray")
        controls.button(undo, "undo", lambda page: self.undo())
        controls.needs(lambda page: self._last, undo)
        reset = gui.add_button(f"Reset to {words}")
        controls.button(reset, "reset", lambda page: self.set(self._start))
        controls.needs(check, self._preset, *self._handles, undo, reset)
        if kept is not None:
            self._add_keeping(gui, controls)

    def _add_keeping(self, gui: Any, controls: Controls) -> None:
        name = gui.add_text("Name", "", hint="to keep these values by; in the list from then on")
        self._name = controls.value(name, "name", preset_name)
        keep, forget = gui.add_button("Keep by this name"), gui.add_button("Forget this name")
        controls.button(keep, "keep", lambda page: self.keep(self._name.now))
        controls.button(forget, "forget", lambda page: self.forget(self._name.now))
        controls.needs(lambda page: self._new(self._name.now), keep)
        controls.needs(lambda page: self._known(self._name.now), forget)

    @property
    def _names(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys((OWN, *self._presets, *(self._own or ()))))

    def _new(self, name: str) -> KeptPresets:
        if self._own is None or not name or name in (OWN, *self._presets):
            raise ValueError("write a name that no other preset has, then press Keep")
        return self._own

    def _known(self, name: str) -> KeptPresets:
        if self._own is None or name not in self._own:
            raise ValueError("write the name of a preset that was kept, then press Forget")
        return self._own

    def keep(self, name: str) -> None:
        """Keep the values under a name. ValueError: it is none, or that of another preset."""
        self._new(name).keep(name, self.values)
        self._show_names(name)

    def forget(self, name: str) -> None:
        """Forget the values kept under a name. ValueError: there are none."""
        self._known(name).forget(name)
        self._show_names(OWN)

    def _show_names(self, chosen: str) -> None:
        self._preset.options = self._names
        self._preset.value = self._chosen.now = chosen

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

    @property
    def _last(self) -> list[float]:
        """The values before the last move. ValueError: there was none."""
        if not self._past:
            raise ValueError("nothing was changed yet")
        return self._past[-1]

    def undo(self) -> None:
        """Go back to the values before the last move. ValueError: there was none."""
        self._use(self._last)
        self._past.pop()
        self._moved = -1
        self._is_own()

    def _use(self, values: list[float]) -> None:
        self._apply(values)
        for kept, handle, value in zip(self._kept, self._handles, values, strict=True):
            kept.now = handle.value = value

    def _take(self, name: str) -> None:
        if name != OWN:
            self._set(self._presets[name] if name in self._presets else (self._own or {})[name])

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
        if self._preset.value != OWN:
            self._preset.value = self._chosen.now = OWN
