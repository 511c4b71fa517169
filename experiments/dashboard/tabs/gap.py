"""The tab Gap: choose runs, watch the five stages, see what is missing and both models at once."""

from collections.abc import Callable, Sequence
from functools import partial
from math import isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.calibrate.folder import FILE
from experiments.dashboard.server.controls import CheckedValue, Controls
from experiments.dashboard.server.input_limits import flag
from experiments.dashboard.server.untrusted_text import plain
from experiments.dashboard.session.gap_tasks import (
    GapAnswer,
    find_gap,
    newest_answer,
    next_number,
)
from experiments.dashboard.session.playback import Playback
from experiments.dashboard.session.tasks import RunSummary
from experiments.dashboard.session.worker_process import WorkerProcess, WorkItem
from experiments.dashboard.tabs.gallery import Gallery
from experiments.dashboard.tabs.guess import Guess
from experiments.dashboard.tabs.waits import waits_for
from experiments.dashboard.view.elapsed import Elapsed, minutes
from experiments.gap.beside import HEAD
from experiments.gap.demo import DEMO_PLAY_RAD
from experiments.gap.short_answer import WANTED, advice, missing_protocols
from experiments.gap.words import spoken

if TYPE_CHECKING:
    from viser import ViserServer

STAGES = {
    "locate": "where do model and table disagree?",
    "name": "which effect is missing?",
    "add": "put it into the model",
    "prove": "does the gap close on other data?",
    "next": "what to measure next",
}
# The workflow's own words for what it begins -> the stage that is then on, and the part of the bar
# [%] that it takes: about its part of the time.
BEGINS = {
    "recording the demo's runs": (0, 0, 10),
    "baseline": (0, 10, 15),
    "name": (1, 15, 75),
    "add and prove": (2, 75, 85),
    "closed loop and next experiment": (4, 85, 90),
    "report": (4, 90, 95),
    "both models, side by side": (4, 95, 99),
}
# Part of what is left of a stage that the bar goes on by in a second: a stage tells little of how
# far it is; chosen, as naming takes a minute or two.
CREEP = 0.015
# ... and in words for whoever watches.
DOES = {
    "baseline": "fitting the model as the rig file has it",
    "name": "trying every effect of the catalogue: the longest part",
    "add and prove": "putting it into the model, testing on parts it has not seen",
    "closed loop and next experiment": "running the new model in closed loop",
    "report": "writing the report",
}
TICKED, LISTED = 4, 12  # runs that are ticked, and that are listed; chosen: minutes, a screen
NONE_TICKED = "No run is ticked: make some in the tab Run, or try the demo."
TAKES = "it takes some minutes, more with every effect that is found"
OWN_TABLE = "*The demo has a table of its own: not the one that is drawn in the 3-D view.*"
HIDDEN = "*What was hidden is shown as soon as 'Hide the truth' is unticked.*"
GUESS = "I guess first: no true values here, nor in the 3-D view, until the tick is taken away"
MANY_TABLES = (
    "the ticked runs are of several tables (other play, plate or servos): tick those of one"
)
GOOD = (
    "Which runs are good for this? **steps** and **servo-squares** together (45 s): steps move "
    "ball and plate through all their play, squares the servos alone; either controller will "
    "do. "
    "In the tab Run, *the whole study* makes both."
)


def stage_lines(on: int, done: bool) -> str:
    """The five stages as Markdown lines with a mark each: on: number of the stage that is being
    done, -1: none yet; done: all are.
    """
    lines = []
    for i, (name, question) in enumerate(STAGES.items()):
        busy = i == on or (on == 2 and i == 3)  # the model is extended and proved in one go
        mark = "✓" if done or i < on else "▶" if busy else "·"
        lines.append(f"{mark} **{i + 1} {name}**: {question}")
    return "  \n".join(lines)


def time_words(elapsed_s: int, before_s: float) -> str:
    """How long an analysis has been going on [s], and how long the newest one took, before_s [s],
    NaN: nobody knows. What is left is not foretold: every effect that is found begins a new search.
    """
    before = f"the one before took {minutes(before_s)}" if isfinite(before_s) else TAKES
    return f"{minutes(elapsed_s)} so far; {before}"


def good_runs(rows: Sequence[RunSummary]) -> list[Path]:
    """Which of these runs, newest first, are ticked until somebody chooses: nobody disturbed them,
    they are of the newest one's table, and of the protocols that tell the effects apart, where
    there is one of each.
    """
    calm = [row for row in rows if not row.by_hand and row.table == rows[0].table]
    if not missing_protocols({row.protocol for row in calm}):
        calm = [row for row in calm if row.protocol in WANTED]
    return [row.folder for row in calm[:TICKED]]


def without_truth(rows: list[list[str]]) -> list[list[str]]:
    """The rows of `experiments.gap.beside` that were found, for who wants to guess: without truth
    and what follows from it.
    """
    found, truth = HEAD.index("found"), HEAD.index("truth")
    return [[*row[:truth], *[""] * len(row[truth:])] for row in rows if row[found]]


def beside_list(rows: list[list[str]]) -> str:
    """The rows of `experiments.gap.beside` as Markdown, for the panel's width: two lines each, what
    was found above what is known of it otherwise."""
    lines = []
    for name, axis, found, calibrated, truth, verdict in ([plain(x) for x in row] for row in rows):
        known = [f"Calibrate {calibrated}" if calibrated else "", f"truth {truth}" if truth else ""]
        told = " · ".join(filter(None, [*known, verdict]))
        lines.append(
            f"- **{name}, {axis}**: {found or 'not found'}" + (f"  \n  {told}" * bool(told))
        )
    return "\n".join(lines)


class GapTab:
    """Builds the tab Gap in the GUI container of viser that is open: runs, stages, answer, report.

    worker: does the analysis; out: parent of the folders `gap-N`; rows: lists the recorded runs,
    newest first; show_map: lays a map of `GapAnswer.plate_map` on the plate, None takes it away;
    show_playback: puts a film in place of the live table on a page, None ends it; send: lets a page
    download a file; virtual: there is a truth, which may be hidden.
    """

    def __init__(
        self,
        server: "ViserServer",
        controls: Controls,
        worker: WorkerProcess,
        out: Path,
        rows: Callable[[], list[RunSummary]],
        show_map: Callable[[Any], None],
        show_playback: Callable[[int, Playback | None], None],
        send: Callable[[int | None, Path], None],
        *,
        virtual: bool = True,
    ) -> None:
        self._controls, self._worker, self._out, self._rows = controls, worker, out, rows
        self._show_map, self._show_playback, self._send = show_map, show_playback, send
        gui = server.gui
        intro = gui.add_markdown("Find out which effect the model lacks: start with the demo.")
        hides: Any = gui.add_checkbox("Hide the truth", False, hint=GUESS, visible=virtual)
        self._hidden = controls.value(hides, "hide the truth", flag, self._hide)
        demo = gui.add_button("Demo: find hidden play", color="green")
        controls.button(demo, "gap", lambda page: self.begin(None, page))
        good = gui.add_markdown(GOOD)
        self._folder: Any = gui.add_folder("Recorded runs", visible=False)
        self._boxes: dict[Path, tuple[Any, CheckedValue[bool]]] = {}
        self._ticks: dict[Path, bool] = {}  # that somebody set
        self._advice: Any = gui.add_markdown("")
        own = gui.add_button("Analyse the ticked runs")
        controls.button(own, "gap", lambda page: self.begin(self._chosen(), page))
        controls.needs(lambda page: self._chosen(), own)
        self._asks: list[Any] = [intro, demo, good, self._advice, own]
        self._again: Any = gui.add_button("Another analysis")
        controls.button(self._again, "gap", lambda page: self._ask(True))
        self._cancel_button: Any = gui.add_button("Cancel", color="gray")
        controls.button(self._cancel_button, "cancel", lambda page: self._cancel())
        self._bar: Any = gui.add_progress_bar(0.0)
        self._words: Any = gui.add_markdown("")
        self._guess = Guess(server, controls)  # seen without scrolling, as it ends with the work
        self._stages: Any = gui.add_markdown(stage_lines(-1, False))
        self._film: Any = gui.add_button("Before and after, side by side", visible=False)
        controls.button(self._film, "film", self._start_film, everybody=True)
        self._report: Any = gui.add_button("Download the gap report", visible=False)
        controls.button(self._report, "gap report", self._download, everybody=True)
        self._clear: Any = gui.add_button("Take the map off the plate", color="gray", visible=False)
        controls.button(self._clear, "map", lambda page: self._lay(None))
        self._gallery = Gallery(server, "Pictures")
        self._gui, self._demo, self._of = gui, False, ""
        self._advised: list[str] | None = None
        self._on, self._until = -1, 0.0  # stage, and where the bar stands when it ends [%]
        self._does, self._elapsed = "", Elapsed()
        self._shows, self._earlier = False, False  # the answer; it is of an earlier program
        self.answer: GapAnswer | None = newest_answer(out)
        self._ask(self.answer is None)
        if self.answer is not None:
            self._stages.content = stage_lines(4, True)
            self._show(self.answer, earlier=True)

    @property
    def hides_truth(self) -> bool:
        """Whether somebody wants to guess the virtual table's true values."""
        return self._hidden.now

    def _hide(self, hides: bool) -> None:
        self._hidden.now = hides
        if self.answer is not None and self._shows and not self._asking:
            self._show(self.answer, earlier=self._earlier)

    def _ask(self, asks: bool) -> None:
        """Show what can be analysed or, in its place, so that it is seen without scrolling, what is
        being found."""
        self._asking = asks
        for handle in self._asks:
            handle.visible = asks
        self._folder.visible = asks and bool(self._boxes)
        busy = bool(self._does)
        self._stages.visible = self._words.visible = not asks
        self._bar.visible = self._cancel_button.visible = not asks and busy
        self._again.visible = not asks and not busy
        found = self.answer if self._shows and not asks else None
        self._report.visible = found is not None
        self._film.visible = found is not None and found.models is not None
        self._gallery.show(found.pictures if found is not None else [])

    def refresh(self) -> None:
        """List the recorded runs anew, each with a box; what somebody ticked stays so."""
        rows = [row for row in self._rows() if row.outcome == "completed"][:LISTED]
        if [row.folder for row in rows] == list(self._boxes):
            return
        good = good_runs(rows)
        for handle, _ in self._boxes.values():
            self._controls.forget(handle)
            handle.remove()
        self._boxes = {}
        with self._folder:
            for row in rows:
                ticked = self._ticks.get(row.folder, row.folder in good)
                handle = self._gui.add_checkbox(row.label, ticked)
                kept = self._controls.value(handle, "run", flag, partial(self._tick, row.folder))
                self._boxes[row.folder] = handle, kept
        self._folder.visible = self._asking and bool(rows)
        self._advise()

    def _ticked(self) -> list[RunSummary]:
        rows = {row.folder: row for row in self._rows()}
        return [rows[f] for f, (_, kept) in self._boxes.items() if kept.now and f in rows]

    def _tick(self, folder: Path, ticked: bool) -> None:
        self._ticks[folder] = ticked
        self._advise()

    def _advise(self) -> None:
        """Say what the ticked runs lack; a box that was just set counts a moment later."""
        self._advised = None

    def _chosen(self) -> list[Path]:
        rows = self._ticked()
        if not rows:
            raise ValueError(NONE_TICKED)
        if len({row.table for row in rows}) > 1:
            raise ValueError(MANY_TABLES)
        return [row.folder for row in rows]

    def begin(self, logs: list[Path] | None, page: int | None) -> None:
        """Have the worker analyse run folders (None: the demo), without waiting; what was shown
        before is cleared, and the film of the page that asked. ValueError: an analysis is on.
        """
        number = next_number(self._out)
        calibration = self._out / "calibration" / FILE
        task = partial(find_gap, logs, self._out / f"gap-{number}", number, calibration)

        def on_message(kind: str, what: Any) -> None:
            self._controls.queue.put("gap", partial(self._on_message, kind, what))

        self._worker.put(WorkItem("gap", task, on_message))
        self._demo, self._of = logs is None, OWN_TABLE
        if logs is not None:
            labels = [row.label for row in self._rows() if row.folder in logs]
            self._of = f"*Analysed: {plain('; '.join(labels))}*"
        if page is not None:
            self._show_playback(page, None)  # it would be taken for this analysis's
        self._on, self._until, self._shows = -1, 0.0, False
        self._bar.value = 0.0
        self._stages.content = stage_lines(-1, False)
        self._guess.end()
        self._does = "starting; it is faster while the table is stopped"
        self._elapsed.begin()
        self._ask(False)
        self._lay(None)

    def _cancel(self) -> None:
        if self._worker.cancel("gap"):
            self._on_message("failed", "it was cancelled before it began")

    def _on_message(self, kind: str, what: Any) -> None:
        if kind == "progress":
            said, k, n = what
            stage, _, words = said.partition(": ")
            now = self._bar.value
            self._on, begin, self._until = BEGINS.get(stage, (self._on, now, self._until))
            self._stages.content = stage_lines(self._on, False)
            self._bar.value = max(now, begin + (self._until - begin) * k / max(n, 1))
            words = plain(spoken(words))
            self._does = ": ".join(filter(None, (DOES.get(stage, plain(stage)), words)))
        elif kind == "shown":
            self._gallery.show([what.picture])
            self._guess.ask(what.words)
        elif kind == "failed":
            self._does = ""
            self._guess.end()
            self._words.content = f"**stopped**: {plain(what)}"
            self._ask(False)
        elif kind == "done":
            self._end(what)

    def draw(self) -> None:
        """Write what is being done, and for how long, once a second; and what the ticked runs
        lack.
        """
        protocols = [row.protocol for row in self._ticked()] if self._advised is None else None
        if protocols is not None:
            self._advised = protocols
            self._advice.content = plain(advice(protocols) if protocols else NONE_TICKED)
        if self._does and self._elapsed.changed():
            self._bar.value += CREEP * max(self._until - self._bar.value, 0.0)
            last = self.answer.short if self.answer is not None else None
            before_s = last.took_s if last is not None and last.of_demo == self._demo else nan
            time = time_words(self._elapsed.seconds, before_s)
            does = waits_for(self._worker, "gap") or self._does
            self._words.content = f"*{does}* ({time})\n\n{self._of}"

    def _end(self, answer: GapAnswer) -> None:
        self.answer, self._does = answer, ""
        self._guess.end()
        self._bar.value = 100.0
        self._stages.content = stage_lines(4, True)
        self._show(answer)
        if not self._demo:  # whose table is another than the one that is shown
            self._lay(answer.plate_map)

    def _show(self, answer: GapAnswer, *, earlier: bool = False) -> None:
        """The answer: the first sentence in bold, what is known otherwise, the others."""
        self._earlier = earlier
        short, hides = answer.short, self.hides_truth
        said = [plain(sentence) for sentence in short.sentences]
        lines = [f"**{sentence}**" for sentence in said[:1]] + said[1:]
        if earlier:
            lines.insert(0, f"*Of an earlier analysis ({plain(answer.report.parent.name)}):*")
        lines.append(beside_list(without_truth(short.table) if hides else short.table))
        if short.truth:
            lines += [HIDDEN if hides else f"**{plain(short.truth)}**", OWN_TABLE]
            if not (hides or earlier):
                lines.append(self._guess.against(DEMO_PLAY_RAD))
        lines += map(plain, short.more)
        self._words.content = "\n\n".join(filter(None, lines))
        self._shows = True
        self._ask(False)

    def _lay(self, plate_map: Any) -> None:
        """The map of disagreement on the live table's plate, or (None) the bare plate."""
        if plate_map is None and not self._clear.visible:
            return
        self._show_map(plate_map)
        self._clear.visible = plate_map is not None

    def _start_film(self, page: int | None) -> None:
        if self.answer is None or self.answer.models is None:
            raise ValueError("no effect was named: there is nothing to compare")
        models = self.answer.models
        name = f"{models.name}: recorded, before, after"
        both = models.before, models.after
        film = Playback(name, models.recorded, both, plate_map=self.answer.plate_map)
        if page is not None:
            self._show_playback(page, film)

    def _download(self, page: int | None) -> None:
        if self.answer is None:
            raise ValueError("no analysis yet")
        self._send(page, self.answer.report)
