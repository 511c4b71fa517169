"""The tab Results: earlier runs, the figures they allow, their centroids, the report."""

from collections.abc import Callable
from functools import partial
from math import hypot
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.analysis.comparison import HEAD, told_words
from experiments.analysis.metrics import NUMBERS_TOLD
from experiments.dashboard.server.controls import Controls
from experiments.dashboard.server.input_limits import choice, flag
from experiments.dashboard.server.untrusted_text import measured, plain
from experiments.dashboard.session.live import LiveBuffer
from experiments.dashboard.session.tasks import (
    BEING_RECORDED,
    MOST_LISTED,
    UNFINISHED,
    DrawnFigures,
    RunSummary,
    draw_figures,
    list_runs,
    recover_runs,
    report_of_runs,
)
from experiments.dashboard.session.worker_process import WorkerProcess, WorkItem
from experiments.dashboard.tabs.gallery import Gallery
from experiments.dashboard.view.elapsed import Elapsed
from experiments.records.run_folder import file_name

if TYPE_CHECKING:
    from viser import ViserServer

TOGETHER = 8  # newest runs of a protocol that figures are made of
LISTED = 12
NEWEST = "what was started last"
MEANS = (
    "Centroid: where the ball was on average, in cm from the centre (the paper's measure); it says "
    "nothing of the swing about it. Blank where the target moves, and until figures of the run's "
    "protocol are shown."
)


def old_words(protocol: str, count: int) -> str:
    """That figures of the newest `count` runs of a protocol are still to come, as Markdown."""
    runs = f"the newest {count} runs" if count > 1 else "the one run"
    return f"**What is below was drawn before.** New figures come, of {runs} of {plain(protocol)}."


def others_words(shown: str, rows: list[RunSummary]) -> str:
    """Markdown on the protocols of `rows` whose figures are not shown; "" where there is none."""
    with_ball = dict.fromkeys(row.protocol for row in rows if not row.servo_only)
    others = [plain(name) for name in with_ball if name != shown]
    if not (shown and others):
        return ""
    return (
        f"Figures and report are of **{plain(shown)}**; there are runs of {', '.join(others)}, "
        "too: choose one under *Figures of*."
    )


def table(rows: list[RunSummary], centroids: dict[str, tuple[float, float]]) -> str:
    """The newest runs of `rows` as a Markdown table; centroids: by the name of the run's folder,
    (x, y) [cm].
    """
    if not rows:
        return "No runs yet: make some in the tab **Run**."
    lines = ["| run | controller | outcome | centroid [cm] |", "|---|---|---|---|"]
    for row in rows[:LISTED]:
        where = centroids.get(row.folder.name)
        words = "" if where is None else f"({where[0]:+.2f}, {where[1]:+.2f})"
        names = (f"{row.protocol} {row.when}", row.method, row.how)
        cells = (f'<span class="rig-name">{plain(name)}</span>' for name in names)
        lines.append(f"| {' | '.join(cells)} | {words} |")
    more = len(rows) - LISTED
    lines += ["", MEANS]
    older = " in the lists; older runs are in the folder alone" if len(rows) >= MOST_LISTED else ""
    where = older or " in the folder"
    return "\n".join(lines) + (f"\n\n{more} more{where}." if more > 0 else "")


def card(figures: DrawnFigures) -> str:
    """What both methods did, as Markdown: the answer first, then the numbers; what does not count
    is named.
    """
    said = figures.sentence or "to compare, run it with and without play compensation."
    of = "".join(f"{plain(row.protocol)}: " for row in figures.rows[:1])
    lines = [f"{of}**{measured(said)}**"]
    if any(figures.counts):
        without, with_ = figures.counts
        which = f"the newest {len(figures.rows)} runs" if len(figures.rows) > 1 else "the one run"
        lines += ["", f"Counted of {which}: {without} without, {with_} with play compensation."]
    says = [row for row in figures.table if row[1] != row[2] or row[3]]
    if says:
        lines += ["", *("| " + " | ".join(row) + " |" for row in (HEAD, ("---",) * len(HEAD)))]
        lines += ["| " + " | ".join(map(measured, row)) + " |" for row in says]
        lines += ["", NUMBERS_TOLD]
    for why in dict.fromkeys(row[1] for row in figures.table if row not in says):
        names = ", ".join(row[0] for row in figures.table if row not in says and row[1] == why)
        lines += ["", f"{plain(names)}, with and without: {plain(why)}."]
    for words in filter(None, (told_words(figures.table), *figures.left_out)):
        lines += ["", plain(words)]
    lines += [line for one in figures.unread for line in ("", f"**Left out**: {plain(one)}")]
    for row in figures.rows:
        for what in row.by_hand:
            lines += ["", f"By hand in {plain(row.label)}: {plain(what)}"]
    return "\n".join(lines)


def _ended(rows: list[RunSummary]) -> set[Path]:
    """Folders of the runs that are no longer being recorded."""
    return {row.folder for row in rows if row.outcome != BEING_RECORDED}


class ResultsTab:
    """Builds the tab Results in the GUI container of viser that is open: runs, figures, report.

    worker: draws and writes; out: folder of runs, figures and report; live: gives the present run's
    centroid; send: lets a page download a file. To be told by `refresh` that a run was recorded.
    compared: whether a sentence on both methods was shown; started: protocol that the last Start
    began with, "" for none: of several in turn its figures are shown.
    """

    def __init__(
        self,
        server: "ViserServer",
        controls: Controls,
        worker: WorkerProcess,
        out: Path,
        live: LiveBuffer,
        send: Callable[[int | None, Path, str], None],
    ) -> None:
        self._controls, self._worker, self._out, self._live, self._send = (
            controls,
            worker,
            out,
            live,
            send,
        )
        gui = server.gui
        gui.add_markdown("Every finished run appears here; figures come as runs complete.")
        self._centroid: Any = gui.add_markdown("")
        self._picked: Any = gui.add_dropdown("Figures of", (NEWEST,))
        self._protocol = controls.value(self._picked, "protocol", self._clean, self._chosen)
        disturbed = gui.add_checkbox("Count runs disturbed by hand", False)
        self._disturbed = controls.value(
            disturbed, "disturbed", flag, lambda value: self.figures(disturbed=value)
        )
        self._others: Any = gui.add_markdown("")
        self._words: Any = gui.add_markdown("")
        self._card: Any = gui.add_markdown("")
        report = gui.add_button("Download the report")
        controls.button(report, "report", self.report, everybody=True)
        controls.needs(lambda page: self._shown(), self._picked, disturbed, report)
        controls.needs(lambda page: worker.check_free("report"), report)
        controls.needs(lambda page: self._check_read(), report)
        self._gallery = Gallery(server, "Figures")
        self._table: Any = gui.add_markdown("")
        self._recover: Any = gui.add_button("Recover what was cut off", visible=False)
        controls.button(self._recover, "recover", lambda page: self.recover())
        controls.needs(lambda page: worker.check_free("recover"), self._recover)
        self._rows: list[RunSummary] = []
        self._centroids: dict[str, tuple[float, float]] = {}
        self._live_words, self.compared, self.started = "", False, ""
        self._does, self._old, self._elapsed = "", "", Elapsed()
        self.refresh()  # runs of an earlier program are shown again

    def _clean(self, value: Any) -> str:
        return choice(value, self._picked.options)

    def _chosen(self, name: str) -> None:
        self._tell_others(name)
        self.figures(name)

    def _check_read(self) -> None:
        """ValueError: the runs are being read for the first figures, which a report would wait
        for."""
        if self._does and not self._card.content:
            raise ValueError(f"{self._does}: wait for it")

    def _tell_others(self, chosen: str | None = None) -> None:
        shown = self._named(chosen or self._protocol.now)
        self._others.content = others_words(shown, self._rows)

    @property
    def rows(self) -> list[RunSummary]:
        """The recorded runs, newest first."""
        return self._rows

    @property
    def shown(self) -> list[RunSummary]:
        """Of those the ones whose figures are shown, or will be: of the protocol that is chosen."""
        return self._together(self._named(self._protocol.now))

    def refresh(self) -> None:
        """Read the folder of runs anew, and draw the figures of what is chosen if it has a new run.
        A protocol that somebody chose stays; else that which was started last is shown, or that of
        the newest run with a ball.
        """
        before, self._rows = self._rows, list_runs(self._out / "runs")
        names = NEWEST, *dict.fromkeys(row.protocol for row in self._rows)
        if names != self._picked.options:
            self._picked.options = names
        self._table.content = table(self._rows, self._centroids)
        self._tell_others()
        self._recover.visible = any(row.outcome == UNFINISHED for row in self._rows)
        new = _ended(self._rows) - _ended(before)
        if any(row.folder in new for row in self.shown):
            self.figures()

    def _named(self, chosen: str) -> str:
        """The protocol that a choice of the list means; "" where there is none."""
        if chosen != NEWEST:
            return chosen
        with_ball = [row.protocol for row in self._rows if not row.servo_only]
        return self.started if self.started in with_ball else next(iter(with_ball), "")

    def _together(self, protocol: str) -> list[RunSummary]:
        return [row for row in self._rows if row.protocol == protocol][:TOGETHER]

    def _shown(self, chosen: str | None = None) -> tuple[str, list[RunSummary]]:
        """The protocol that is chosen (None: in the list), and its newest runs. ValueError: there
        is none.
        """
        protocol = self._named(chosen or self._protocol.now)
        rows = self._together(protocol)
        if not rows:
            raise ValueError("no runs yet: make some in the tab Run")
        return protocol, rows

    def recover(self) -> None:
        """Have the worker repair the recordings that were cut off. ValueError: there is none."""
        folders = [row.folder for row in self._rows if row.outcome == UNFINISHED]
        if not folders:
            raise ValueError("no recording was cut off")
        self._put("recover", partial(recover_runs, folders), self._recovered)

    def _recovered(self, left: str) -> None:
        self.refresh()
        if left:
            self._words.content = f"not repaired: {plain(left)}"

    def figures(self, protocol: str | None = None, *, disturbed: bool | None = None) -> None:
        """Have the worker draw the figures that the newest runs of a protocol allow (None: the one
        chosen), instead of figures that it still draws; disturbed: runs that were disturbed by hand
        count (None: as the box says). ValueError: no run of it.
        """
        name, rows = self._shown(protocol)
        count = self._disturbed.now if disturbed is None else disturbed
        task = partial(draw_figures, rows, self._out / "figures" / file_name(name), count)
        old = old_words(name, len(rows)) if self._card.content else ""
        self._put("figures", task, self._drawn, instead=True, old=old)  # of fewer runs

    def report(self, page: int | None) -> None:
        """Have the worker write the report of the newest runs of the chosen protocol, then let the
        page download it (None: every page). ValueError: no runs, or a report is being written.
        """
        protocol, rows = self._shown()
        task = partial(report_of_runs, [row.folder for row in rows], self._out / "report")
        name = f"report-{file_name(protocol)}.html"
        self._put("report", task, lambda path: self._send(page, path, name))

    def _put(
        self,
        name: str,
        task: Any,
        done: Callable[[Any], None],
        *,
        instead: bool = False,
        old: str = "",
    ) -> None:
        def on_message(kind: str, what: Any) -> None:
            self._controls.queue.put(name, partial(self._on_message, name, done, kind, what))

        self._does, self._old = f"{name}: being made", old
        self._elapsed.begin()
        self._write()
        self._worker.put(WorkItem(name, task, on_message), instead=instead)

    def _on_message(self, name: str, done: Callable[[Any], None], kind: str, what: Any) -> None:
        if kind == "progress":
            self._does = f"{name}: {plain(what[0])}"
            self._write()
        elif kind == "failed":
            self._does, self._words.content = "", f"{name}: {plain(what)}"
        elif kind == "done":
            self._does = self._words.content = ""
            done(what)

    def _write(self) -> None:
        self._words.content = f"{self._old} *{self._does}* ({self._elapsed.seconds} s)".strip()

    def _drawn(self, figures: DrawnFigures) -> None:
        for row in figures.rows:
            if row.centroid_cm is not None:
                self._centroids[row.folder.name] = row.centroid_cm
        self._card.content = card(figures)
        self.compared = self.compared or bool(figures.sentence)
        self._gallery.show(figures.pictures)
        self._table.content = table(self._rows, self._centroids)

    def draw(self, *, running: bool) -> None:
        """Write the centroid so far of a run that is on (`running`; k-means with one cluster is the
        mean), and for how long the worker has worked, once a second.
        """
        if self._does and self._elapsed.changed():
            self._write()
        mean = self._live.centroid
        xy, words = mean.xy_m, ""
        if xy is not None and running:
            x, y = 100 * xy
            words = (
                f"Centroid of the present run: **({x:+.2f}, {y:+.2f}) cm**, {hypot(x, y):.2f} cm "
                f"from the centre, {mean.n} frames (k-means, one cluster)"
            )
        if words != self._live_words:
            self._live_words = self._centroid.content = words
