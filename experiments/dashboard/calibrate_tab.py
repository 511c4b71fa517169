"""The tab Calibrate: the steps of `rig calibrate` on the virtual table, with verdict and reason."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.dashboard.controls import Controls
from experiments.dashboard.desk import Desk, Piece
from experiments.dashboard.gallery import Gallery
from experiments.dashboard.session import Session
from experiments.dashboard.tasks import CALIBRATION_STEPS, calibrate

if TYPE_CHECKING:
    from viser import ViserServer

STEPS = {
    "camera": "the lens, from pictures of the printed sheet",
    "table": "where the level plate is, from its markers",
    "time": "how late frames are stamped",
    "level": "how far the plate is from level",
    "servo": "breakaway volts, gain and time constant",
}
MARKS = {"": "·", "on": "▶", "accepted": "✓", "refused": "✗"}
SEED = 1


class CalibrateTab:
    """One button a step, and one for all in their order."""

    def __init__(
        self, server: "ViserServer", controls: Controls, desk: Desk, session: Session, out: Path
    ) -> None:
        self._controls, self._desk, self._session = controls, desk, session
        self._out = out / "calibration"
        gui = server.gui
        gui.add_markdown("Measure the virtual table: press **All steps**, or one after another.")
        everything = gui.add_button("All steps", color="green")
        controls.button(everything, "calibrate", lambda page: self.begin(CALIBRATION_STEPS))
        for step, meaning in STEPS.items():
            one = gui.add_button(f"{step.capitalize()}", hint=meaning)
            controls.button(one, f"calibrate {step}", lambda page, s=step: self.begin((s,)))
        cancel = gui.add_button("Cancel", color="gray")
        controls.button(cancel, "cancel", lambda page: self._cancel())
        self._list: Any = gui.add_markdown("")
        self._verdict: Any = gui.add_markdown("")
        self._gallery = Gallery(server, "Coverage and residuals")
        self._state = dict.fromkeys(STEPS, "")
        self._lines: list[str] = []
        self._left: tuple[str, ...] = ()
        self._show()

    def begin(self, steps: tuple[str, ...]) -> None:
        """Do these steps in turn; the first that is refused is the last."""
        if "on" in self._state.values():
            raise ValueError("a step is on: wait, or cancel it")
        self._left = tuple(steps)
        self._next()

    def _next(self) -> None:
        if not self._left:
            return
        step, self._left = self._left[0], self._left[1:]
        task = partial(calibrate, step, self._session.rig, self._out, SEED)

        def heard(kind: str, what: Any) -> None:
            self._controls.orders.put(f"calibrate {step}", partial(self._heard, step, kind, what))

        self._desk.put(Piece("calibration", task, heard))
        self._state[step], self._lines = "on", []
        self._verdict.content = f"**{step}**: on its way (or waiting for other work)"
        self._show()

    def _heard(self, step: str, kind: str, what: Any) -> None:
        if kind == "line":
            self._lines.append(what)
        elif kind == "failed":
            self._state[step], self._left = "refused", ()
            self._verdict.content = f"**{step}: refused**, because {what}"
        elif kind == "done":
            self._state[step] = "accepted"
            found = [line for line in self._lines if not line.startswith(("written", "believed"))]
            self._verdict.content = f"**{step}: accepted**\n\n" + "\n\n".join(found)
            self._gallery.show(what)
            self._controls.orders.put("next step", self._next)
        self._show()

    def _cancel(self) -> None:
        self._left = ()
        self._desk.cancel("calibration")

    def _show(self) -> None:
        lines = [f"{MARKS[self._state[s]]} **{s}**: {words}" for s, words in STEPS.items()]
        self._list.content = "  \n".join(lines)
