"""The tab Calibrate: the steps of `rig calibrate`, pictures growing, with verdict and reason.

A virtual table does every step by itself. A real one is seen by its camera (lens, level plate) and
measured from recorded runs (delay, level); nothing here moves it.
"""

import json
import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calibration.bundle import load_draft
from experiments.calibrate.folder import FILE, table_file
from experiments.calibrate.found import HEAD, found_table
from experiments.dashboard.server.controls import CheckedValue, Controls
from experiments.dashboard.server.input_limits import PRINTED_MM
from experiments.dashboard.server.untrusted_text import measured, plain
from experiments.dashboard.session.calibration_tasks import (
    NOT_REAL,
    CalibrationRequest,
    calibration_step,
    print_sheets,
    steps_of,
)
from experiments.dashboard.session.real_camera import RealCamera
from experiments.dashboard.session.session import Session
from experiments.dashboard.session.tasks import RunSummary
from experiments.dashboard.session.worker_process import WorkerProcess, WorkItem
from experiments.dashboard.tabs.gallery import Gallery
from experiments.dashboard.tabs.waits import waits_for
from experiments.dashboard.view.elapsed import Elapsed
from experiments.gap.beside import calibrated_beside
from rig.files import json_of, write_whole

if TYPE_CHECKING:
    from viser import ViserServer

STEPS = {
    "camera": "the lens, from pictures of the sheet",
    "table": "where the level plate is",
    "time": "camera delay",
    "level": "how far the plate is from level",
    "servo": "breakaway volts, gain, time constant",
    "play": "how much, and where",
}
OF_POSITION_SERVO = "lag, dead time, limits, dead band"
UNCLEAR = ", its middle cannot be told from a level error or a rest position"  # said in the report
FILES = "written", "note: goes on", "your rig file", "changed: "  # the page has words of its own
MARKS = {"": "", "on": "▶ ", "accepted": "✓ ", "refused": "✗ "}
COLOURS = {"": None, "on": "orange", "accepted": "teal", "refused": "red"}
VIRTUAL = "Measure the virtual table: all steps in one go, or one after another."
REAL = (
    "Measure the table: **camera** with the printed sheet held before the lens, in 15 to 40 "
    "places and tilts until all cells are green; **table** with the plate level and empty; "
    "**time** and **level** from the newest runs with the ball."
)
PRINTED_DEFAULT_MM = 24.0  # of `rig calibrate sheet`
# Of a virtual table each step is done with a copy; how long the longest takes.
COPY = "*On a copy of the table, not the one you see{}.*"
LONG = {"play": "; up to two minutes"}
# Part of what is left of a stage by which the percentage goes on in a second, though nothing is
# told of it; chosen, as for the tab Gap: the longest take a minute.
CREEP = 0.015
VERDICTS = "verdicts.json"
DETAILS = "How it was measured"
LED_ABOUT, MOST_RUNS = ("steps", "circle", "free-release", "pushed"), 4


class CalibrateTab:
    """Builds the tab Calibrate in the GUI container of viser that is open: a button for each step.

    worker: does the steps; session: of the table; out: its folder `calibration` is filled; send:
    lets a page download a file; real: rig file and camera of a real table, None for the virtual
    one; rows: lists the recorded runs, newest first; show_live: called with the page that begins a
    step, to end its film.
    """

    _share, _until = 0.0, 0.0  # of the step: done, and when its stage will be

    def __init__(
        self,
        server: "ViserServer",
        controls: Controls,
        worker: WorkerProcess,
        session: Session,
        out: Path,
        send: Callable[[int | None, Path], None],
        *,
        real: tuple[Path, RealCamera | None] | None = None,
        rows: Callable[[], list[RunSummary]] = list,
        show_live: Callable[[int | None], None] = lambda page: None,
    ) -> None:
        self._controls, self._worker, self._session, self._send = controls, worker, session, send
        self._out, self._real, self._rows, self._show_live = out, real, rows, show_live
        self._borrowed = ExitStack()
        self._awaited: WorkItem | None = None
        gui = server.gui
        gui.add_markdown(REAL if real else VIRTUAL)
        self._steps = steps_of(session.rig, real=bool(real))
        self._meanings = dict(STEPS)
        self._state = dict.fromkeys(self._steps, "")
        if session.rig.servo.takes_angle:
            self._meanings["servo"] = OF_POSITION_SERVO
        if real:
            self._square_mm = self._add_number(gui, "Square as printed [mm]")
            self._marker_mm = self._add_number(gui, "Plate marker [mm]")
        else:
            everything = gui.add_button("All steps", color="green")
            controls.button(everything, "calibrate", lambda page: self.begin(self._steps, page))
            controls.needs(lambda page: self._check_free(), everything)
        self._verdict: Any = gui.add_markdown("")
        self._folded: Any = gui.add_folder(DETAILS, expand_by_default=False, visible=False)
        with self._folded:
            self._details: Any = gui.add_markdown("")
        self._gallery = Gallery(server, "Pictures of this step")
        self._buttons: dict[str, Any] = {}
        with gui.add_folder("One step at a time"):
            for step in self._steps:
                one = self._buttons[step] = gui.add_button(self._label(step))
                controls.button(
                    one, f"calibrate {step}", lambda page, s=step: self.begin((s,), page)
                )
            controls.needs(lambda page: self._check_free(), *self._buttons.values())
            cancel = gui.add_button("Cancel", color="gray")
            controls.button(cancel, "cancel", lambda page: self.stop("Cancel"))
            controls.needs(lambda page: self._check_on(), cancel)
        self._found: Any = gui.add_markdown("")
        sheets = gui.add_button("Download the sheets to print", color="gray")
        controls.button(sheets, "sheets", self._sheets, everybody=True)
        controls.needs(lambda page: worker.check_free("sheets"), sheets)
        if real:
            refused = [(step, why) for step, why in NOT_REAL.items() if step not in self._steps]
            gui.add_markdown("  \n".join(f"*{step}*: {why}." for step, why in refused))
        self._lines: list[str] = []
        self._kept: dict[str, list[str]] = {}
        self._on, self._words, self._elapsed = "", "", Elapsed()
        self._why_ended = ""  # by a person
        self._left: tuple[str, ...] = ()
        self._restore()

    def _restore(self) -> None:
        """Show the verdicts of an earlier program, which lie beside its calibration."""
        try:
            kept = json_of(self._out / "calibration" / VERDICTS)
            kept = {step: list(map(str, lines)) for step, lines in kept.items()}
        except (OSError, ValueError, AttributeError, TypeError):
            return
        for step, lines in kept.items():
            if step in self._buttons:
                self._lines = self._kept[step] = lines
                self._mark(step, "accepted", "accepted earlier")
        self._write_found()

    def _label(self, step: str) -> str:
        return f"{step}: {self._meanings[step]}"

    def _add_number(self, gui: Any, label: str) -> CheckedValue[float]:
        low, high = PRINTED_MM.low, PRINTED_MM.high
        handle = gui.add_number(label, PRINTED_DEFAULT_MM, min=low, max=high)
        return self._controls.value(handle, label, PRINTED_MM.clamp)

    @property
    def accepted(self) -> set[str]:
        """The steps that were measured and accepted."""
        return {step for step, state in self._state.items() if state == "accepted"}

    def begin(self, steps: tuple[str, ...], page: int | None = None) -> None:
        """Do calibration steps in turn in the worker, without waiting, until one is refused; `page`
        shows the live table again.

        ValueError, OSError: a step or a run is on, or the real table's camera cannot be borrowed.
        """
        self._check_free()
        self._left = tuple(steps)
        self._next()
        self._show_live(page)

    def _check_free(self) -> None:
        """ValueError: a step or a run of a real table is on."""
        if "on" in self._state.values():
            raise ValueError("a step is on: wait, or cancel it")
        if self._real and self._session.status.state == "running":
            raise ValueError("a run is on: calibrate when it has ended")

    def _check_on(self) -> None:
        """ValueError: no step is on."""
        if "on" not in self._state.values():
            raise ValueError("no step is on")

    def _measure(self, step: str) -> CalibrationRequest:
        """What is to be done for a step."""
        out, rig = self._out / "calibration", self._session.rig
        if self._real is None:
            return CalibrationRequest(step, rig, out)
        file, _ = self._real
        runs = [
            row.folder
            for row in self._rows()
            if row.protocol in LED_ABOUT and row.outcome == "completed"
        ]
        return CalibrationRequest(
            step,
            rig,
            out,
            rig_file=file,
            runs=tuple(runs[:MOST_RUNS]),
            square_mm=self._square_mm.now,
            plate_marker_mm=self._marker_mm.now,
        )

    def _next(self) -> None:
        if "on" in self._state.values():  # begun anew when the last step had ended
            return
        if not self._left:
            if len(self._kept) == len(self._steps):
                self._words = f"{self._words}. All steps are done"
                self._write(done=True)
            return
        step, self._left = self._left[0], self._left[1:]
        task = partial(calibration_step, self._measure(step))

        def on_message(kind: str, what: Any) -> None:
            self._controls.queue.put(
                f"calibrate {step}", partial(self._on_message, step, kind, what)
            )

        item = WorkItem("calibration", task, on_message)
        camera = self._real[1] if self._real and step in ("camera", "table") else None
        self._worker.check_free(item.name)
        if camera is not None:
            camera.check_free()
        self._lines, self._why_ended = [], ""
        self._share = self._until = 0.0
        self._elapsed.begin()
        self._mark(step, "on", "on its way")  # first: it may be refused at once
        if camera is not None:
            self._awaited = item
            threading.Thread(target=self._borrow, args=(camera, item), daemon=True).start()
        else:
            self._worker.put(item)

    def _borrow(self, camera: RealCamera, item: WorkItem) -> None:
        """Borrow the camera of a real table, which may take seconds, then let the worker begin."""
        try:
            self._borrowed.enter_context(camera.lend())
            if self._awaited is item:
                self._worker.put(item)
            else:  # cancelled meanwhile
                self._borrowed.close()
        except (OSError, ValueError) as error:
            item.on_message("failed", str(error))
        finally:
            self._awaited = None

    def draw(self) -> None:
        """Write how far the present step is, and how long it has taken, once a second."""
        if "on" in self._state.values() and self._elapsed.changed():
            self._share += CREEP * (self._until - self._share)
            far = f", {100 * self._share:.0f} %" if self._until else ""
            copy = "" if self._real else f"\n\n{COPY.format(LONG.get(self._on, ''))}"
            waits = waits_for(self._worker, "calibration")
            said = f", {waits}" if waits else far
            self._write(f"{said}, {self._elapsed.seconds} s{copy}")

    def _write(self, more: str = "", *, done: bool = False) -> None:
        """The verdict; how a step was measured stands below it while it is on, then folded."""
        done = done and bool(self._lines)
        answer = self._against_truth() if done and self._on == "play" else ""
        words = [f"**{self._on}: {plain(self._words)}**{more}{answer}"]
        lines = list(map(plain, self._lines))
        self._verdict.content = "\n\n".join(words if done else words + lines)
        self._details.content = "\n\n".join(lines)
        self._folded.visible = done

    def _against_truth(self) -> str:
        """Markdown on the play that was found beside the virtual table's; "" where nobody knows."""
        out = self._out / "calibration"
        if self._real:
            return ""
        try:
            said, rows = calibrated_beside(out / FILE, out / table_file("play"))
        except (OSError, ValueError):
            return ""
        lines = [("play", "found", "true", ""), ("---",) * 4, *rows]
        table = "\n".join(f"| {' | '.join(map(measured, line))} |" for line in lines[2:])
        head = "\n".join(f"| {' | '.join(line)} |" for line in lines[:2])
        return f"\n\n**What was found {plain(said)}.**\n\n{head}\n{table}"

    def _on_message(self, step: str, kind: str, what: Any) -> None:
        if kind == "line" and not what.startswith(FILES):
            counted = what.startswith("picture ") and self._lines
            if counted and self._lines[-1].startswith("picture "):
                self._lines.pop()
            self._lines.append(what.replace(UNCLEAR, ""))
            self._mark(step, "on", "measuring")
        elif kind == "progress" and what[2] > 1:  # it has parts
            words, done, of = what
            self._share, self._until = max(self._share, done / of), (done + 1) / of
            self._mark(step, "on", words)
        elif kind == "shown":
            self._mark(step, "on", "measuring")
            self._gallery.show(what)
        elif kind in ("failed", "done"):
            self._borrowed.close()
            if kind == "failed":
                self._left = ()
                why, self._why_ended = self._why_ended, ""
                words = f"ended by {why}" if why else f"refused, because {what}"
                self._mark(step, "refused", words)
                return
            self._keep(step)
            self._mark(step, "accepted", "accepted")
            self._gallery.show(what)
            self._controls.queue.put("next step", self._next)

    def _mark(self, step: str, state: str, words: str) -> None:
        self._buttons[step].label = MARKS[state] + self._label(step)
        self._buttons[step].color = COLOURS[state]
        self._on, self._words = step, words
        self._write(done=state == "accepted")
        self._state[step] = state  # last: who waits for it reads the words

    def _keep(self, step: str) -> None:
        """The verdict stays in the list of what was found."""
        self._kept[step] = self._lines
        file = self._out / "calibration" / VERDICTS
        with suppress(OSError):  # shown all the same; only a restart forgets it
            file.parent.mkdir(parents=True, exist_ok=True)
            write_whole(file, json.dumps(self._kept).encode())
        self._write_found()

    def _write_found(self) -> None:
        used = "the tab Gap compares with it, runs keep the rig file's numbers"
        if self._real:
            used = f"to use it copy it to {plain(self._session.rig.table.calibration)}"
        place = plain(self._out / "calibration")
        words = f"**What was found** (accepted; {used}; kept in {place})\n\n"
        try:
            rows = found_table(load_draft(self._out / "calibration" / FILE))
        except (OSError, ValueError) as error:
            self._found.content = words + plain(error)
            return
        lines = [HEAD, ("---",) * len(HEAD), *(map(measured, row) for row in rows)]
        self._found.content = words + "\n".join("| " + " | ".join(row) + " |" for row in lines)

    def stop(self, why: str) -> None:
        """End the step that is on, and what would follow it; nothing where none is. why: in words.
        To be called in the thread of the control panel queue.
        """
        self._left = ()
        step = next((step for step, state in self._state.items() if state == "on"), None)
        if step is None:
            return
        self._why_ended = why
        awaited, self._awaited = self._awaited, None  # of a camera that is being borrowed
        if awaited or self._worker.cancel("calibration"):
            self._on_message(step, "failed", "")

    def _sheets(self, page: int | None) -> None:
        """Draw the sheets to print and send them to the page."""

        def on_message(kind: str, what: Any) -> None:
            if kind == "done":
                self._controls.queue.put("sheets", lambda: self._send(page, what), page)
            elif kind == "failed":
                self._controls.queue.put("sheets", partial(_refuse, what), page)

        self._worker.put(
            WorkItem(
                "sheets", partial(print_sheets, self._session.rig, self._out / "sheets"), on_message
            )
        )


def _refuse(why: str) -> None:
    raise ValueError(why)
