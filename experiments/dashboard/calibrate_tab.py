"""The tab Calibrate: the steps of `rig calibrate` on the virtual table, with verdict and reason."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.dashboard.controls import Controls
from experiments.dashboard.desk import Desk, Piece
from experiments.dashboard.gallery import Gallery
from experiments.dashboard.session import Session
from experiments.dashboard.tasks import CALIBRATION_STEPS, calibrate, print_sheets

if TYPE_CHECKING:
    from viser import ViserServer

STEPS = {
    "camera": "the lens, from pictures of the sheet",
    "table": "where the level plate is",
    "time": "how late frames are stamped",
    "level": "how far the plate is from level",
    "servo": "breakaway volts, gain, time constant",
    "play": "how much play, and where",
}
MARKS = {"": "", "on": "▶ ", "accepted": "✓ ", "refused": "✗ "}
COLOURS = {"": None, "on": "orange", "accepted": "teal", "refused": "red"}
SEED = 1
REAL = "A real table is not measured from here: print the sheets, then `rig calibrate` (README)."


class CalibrateTab:
    """One button a step, and one for all in their order; `send` offers a file to a page."""

    def __init__(
        self, server: "ViserServer", controls: Controls, desk: Desk, session: Session, out: Path,
        send: Callable[[int | None, Path], None],
    ) -> None:  # fmt: skip
        self._controls, self._desk, self._session, self._send = controls, desk, session, send
        self._out = out
        gui = server.gui
        gui.add_markdown("Measure the virtual table: press **All steps**, or one after another.")
        everything = gui.add_button("All steps", color="green")
        controls.button(everything, "calibrate", lambda page: self.begin(CALIBRATION_STEPS))
        self._buttons: dict[str, Any] = {}
        for step, meaning in STEPS.items():
            one = self._buttons[step] = gui.add_button(f"{step}: {meaning}")
            controls.button(one, f"calibrate {step}", lambda page, s=step: self.begin((s,)))
        cancel = gui.add_button("Cancel", color="gray")
        controls.button(cancel, "cancel", lambda page: self._cancel())
        self._verdict: Any = gui.add_markdown("")
        self._gallery = Gallery(server, "Coverage and residuals")
        sheets = gui.add_button("Download the sheets to print", color="gray")
        controls.button(sheets, "sheets", self._sheets, everybody=True)
        gui.add_markdown(REAL)
        self._state = dict.fromkeys(STEPS, "")
        self._lines: list[str] = []
        self._left: tuple[str, ...] = ()

    def begin(self, steps: tuple[str, ...]) -> None:
        """Do these steps in turn; the first that is refused is the last."""
        if self._session.table.real:
            raise ValueError("this page calibrates virtual tables; a real one: rig calibrate")
        if "on" in self._state.values():
            raise ValueError("a step is on: wait, or cancel it")
        self._left = tuple(steps)
        self._next()

    def _next(self) -> None:
        if not self._left:
            return
        step, self._left = self._left[0], self._left[1:]
        task = partial(calibrate, step, self._session.rig, self._out / "calibration", SEED)

        def heard(kind: str, what: Any) -> None:
            self._controls.orders.put(f"calibrate {step}", partial(self._heard, step, kind, what))

        self._desk.put(Piece("calibration", task, heard))
        self._lines = []
        self._mark(step, "on", "on its way (or waiting for other work)")

    def _heard(self, step: str, kind: str, what: Any) -> None:
        if kind == "line" and not what.startswith(("written", "believed")):
            self._lines.append(what)
            self._mark(step, "on", "measured")
        elif kind == "failed":
            self._left = ()
            self._mark(step, "refused", f"refused, because {what}")
        elif kind == "done":
            self._mark(step, "accepted", "accepted")
            self._gallery.show(what)
            self._controls.orders.put("next step", self._next)

    def _mark(self, step: str, state: str, words: str) -> None:
        self._state[step] = state
        self._buttons[step].label = f"{MARKS[state]}{step}: {STEPS[step]}"
        self._buttons[step].color = COLOURS[state]
        self._verdict.content = "\n\n".join([f"**{step}: {words}**", *self._lines])

    def _cancel(self) -> None:
        self._left = ()
        self._desk.cancel("calibration")

    def _sheets(self, page: int | None) -> None:
        """Draw the sheets to print and send them to the page."""

        def heard(kind: str, what: Any) -> None:
            if kind == "done":
                self._controls.orders.put("sheets", lambda: self._send(page, what), page)
            elif kind == "failed":
                self._controls.orders.put("sheets", partial(_refuse, what), page)

        self._desk.put(
            Piece("sheets", partial(print_sheets, self._session.rig, self._out / "sheets"), heard)
        )


def _refuse(why: str) -> None:
    raise ValueError(why)
