"""The tab Replay: any recorded run again, scrubbed and at any speed, with its video.

What a page shows in place of the live table is called a replay there, and a film here; a video is
what a camera saw.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.dashboard.server.controls import Controls
from experiments.dashboard.server.input_limits import SPEED, Range, choice, flag
from experiments.dashboard.server.messages import tell_page
from experiments.dashboard.server.pages import Pages
from experiments.dashboard.server.untrusted_text import plain
from experiments.dashboard.session.playback import Playback
from experiments.dashboard.session.tasks import RunSummary
from experiments.dashboard.session.video import Video, replay_run
from experiments.dashboard.session.worker_process import WorkerProcess, WorkItem
from experiments.dashboard.tabs.header import with_mouse

if TYPE_CHECKING:
    from viser import ViserServer

NONE = "(no runs yet)"
STEP_S = 0.1  # of the slider; the keys step a frame of FRAME_S
FRAME_S = 1 / 60
FILM_S = Range(0.0, 1e6, STEP_S)  # the clock keeps within its own film
WHAT = (
    "Choose a run and press **Show**: this page alone shows its replay in place of the live table, "
    "and what its camera saw, its video, in the panel Camera. "
)
KEYS = "Keys: **Space** plays, **left** and **right** go a frame (0.02 s)."
BOTH = "the run of the same protocol and seed with the other controller beside it"
EVENTS_SHOWN = 6
PLAY, PAUSE = "▶ Play", "❚❚ Pause"
LIVE = "The live table is shown."
MAKING = (
    "*The video is made from the recording: about a quarter of its length, more on a busy machine.*"
)


def partner(row: RunSummary, rows: list[RunSummary]) -> Path | None:
    """The completed run of the same protocol and seed with the other controller that was made
    nearest to this one; None: there is none.
    """
    others = [
        other.folder
        for other in rows
        if (other.protocol, other.seed) == (row.protocol, row.seed)
        and {other.method, row.method} == {"with", "without"}
        and other.outcome == "completed"
    ]
    if not others:
        return None
    names = sorted([row.folder.name, *(folder.name for folder in others)])
    at = names.index(row.folder.name)
    return min(others, key=lambda folder: abs(names.index(folder.name) - at))


def event_lines(events: list[tuple[float, str]], t_s: float) -> str:
    """The events about the time t_s [s] as Markdown; those that have happened are marked."""
    at = sum(1 for when, _ in events if when <= t_s)
    first = max(0, min(at - EVENTS_SHOWN // 2, len(events) - EVENTS_SHOWN))
    return "  \n".join(
        f"{'●' if i < at else '○'} {when:.1f} s: {plain(text)}"
        for i, (when, text) in enumerate(events[first : first + EVENTS_SHOWN], first)
    )


@dataclass
class Viewer:
    """What one page has set and is shown in the tab.

    picked: label of a run, "" for the first of the list; name: of what was asked for last; item:
    what reads the run that it asked for; about: of the video, which the panel Camera shows.
    """

    picked: str = ""
    name: str = ""
    both: bool = False
    playback: Playback | None = None
    item: WorkItem | None = None
    about: str = ""


class ReplayTab:
    """Builds the tab Replay in the GUI container of viser that is open: run, time, speed, video.
    Every page has a film of its own, whether it holds the controls or not.

    pages: those that are connected; worker: reads runs and makes videos; rows: lists the recorded
    runs; show_playback: puts a film in place of the live table on a page, None ends it.
    """

    def __init__(
        self,
        server: "ViserServer",
        controls: Controls,
        pages: Pages,
        worker: WorkerProcess,
        rows: Callable[[], list[RunSummary]],
        show_playback: Callable[[int, Playback | None], None],
    ) -> None:
        self._controls, self._pages, self._worker = controls, pages, worker
        self._rows, self._show_playback = rows, show_playback
        self._viewers: dict[int, Viewer] = {}
        gui = server.gui
        gui.add_markdown(WHAT + with_mouse(KEYS))
        self._picked: Any = gui.add_dropdown("Run", (NONE,))
        controls.own_value(
            self._picked, "run", lambda v: choice(v, self._picked.options), self._pick
        )
        both = gui.add_checkbox("Both controllers on one plate", False, hint=BOTH)
        controls.own_value(both, "both controllers", flag, self._set_both)
        show = gui.add_button("Show", color="green")
        self.key(show, "show the run", self.show)
        controls.needs(self._wanted, show)
        self._scrub: Any = gui.add_slider("Time [s]", 0.0, 1.0, STEP_S, 0.0)
        controls.own_value(self._scrub, "time", FILM_S.clamp, self._seek)
        self._fast: Any = gui.add_slider("Speed [x]", SPEED.low, SPEED.high, SPEED.step, 1.0)
        controls.own_value(self._fast, "speed", SPEED.clamp, self._set_speed)
        self._play: Any = gui.add_button(PLAY)
        self.key(self._play, "play", self.toggle)
        back = gui.add_button("Back to the live table", color="gray")
        self.key(back, "back to the live table", lambda page: self._show_playback(page, None))
        controls.needs(self._need, self._scrub, self._fast, self._play)
        controls.needs(lambda page: self._of(page).item or self._need(page), back)
        self._words: Any = gui.add_markdown(LIVE)
        self._events: Any = gui.add_markdown("")
        self._about: Any = gui.add_markdown("")

    def key(self, handle: Any, what: str, act: Callable[[int], None]) -> None:
        """Have any page use a button or a command for itself alone."""

        def for_page(page: int | None) -> None:
            if page is not None:
                act(page)

        self._controls.button(handle, what, for_page, everybody=True)

    def _of(self, page: int) -> Viewer:
        return self._viewers.setdefault(page, Viewer())

    def refresh(self) -> None:
        """List the recorded runs anew."""
        names = tuple(row.label for row in self._rows()) or (NONE,)
        if names != self._picked.options:
            self._picked.options = names

    def _pick(self, page: int, name: str) -> None:
        self._of(page).picked = name

    def _set_both(self, page: int, both: bool) -> None:
        self._of(page).both = both

    def _wanted(self, page: int) -> tuple[RunSummary, Path | None]:
        """The run that a page chose, and the one beside it if it wants both. ValueError: there is
        none.
        """
        viewer, rows = self._of(page), self._rows()
        name = viewer.picked or self._picked.value
        row = next((row for row in rows if row.label == name), None)
        if row is None:
            raise ValueError("no such run: make one in the tab Run")
        beside = partner(row, rows) if viewer.both else None
        if viewer.both and beside is None:
            raise ValueError("no run of the other controller with this protocol and seed")
        return row, beside

    def _why_not(self, page: int) -> list[str]:
        """Why a page cannot press Show: a finger gets no hint of a button that is greyed."""
        try:
            self._wanted(page)
        except ValueError as why:
            return [f"**Show** is greyed: {plain(why)}."]
        return []

    def show(self, page: int) -> None:
        """Have the worker read the run that a page chose and make its video; what it read for this
        page before is dropped.

        ValueError: there is no such run.
        """
        viewer, (row, beside) = self._of(page), self._wanted(page)

        def on_message(kind: str, what: Any) -> None:
            self._controls.queue.put("replay", partial(self._on_message, page, item, kind, what))

        viewer.name = row.label + (" and its pair" if beside else "")
        item = WorkItem(
            f"replay {page}", partial(replay_run, row.folder, beside, viewer.name), on_message
        )
        viewer.item, viewer.about = item, f"*{plain(row.label)} is being read ...*"
        self._worker.put(item, instead=True)

    def _on_message(self, page: int, item: WorkItem, kind: str, what: Any) -> None:
        viewer = self._viewers.get(page)
        if viewer is None or item is not viewer.item:  # another run was chosen, or the page is gone
            return
        if kind == "shown":
            self._show_playback(page, Playback(what.name, what.motion, film=what))
            viewer.item, viewer.about = item, MAKING
        elif kind == "progress":
            viewer.about = f"*{plain(what[0])}: {100 * what[1] // max(what[2], 1)} %*"
        elif kind == "failed":
            viewer.about = plain(what)
        elif kind == "done":
            self._need(page).video = Video(what)
            viewer.about = "The video, what the camera saw, is shown left, in the panel Camera."

    def on_playback(self, page: int, playback: Playback | None) -> None:
        """Take note of the film that a page is shown from now on, None for the live table: a run
        that is still being read for it will not be shown.
        """
        viewer = self._of(page)
        if playback is None and viewer.item is not None:
            self._worker.cancel(viewer.item.name)  # its video, which nobody waits for
        viewer.item, viewer.playback, viewer.about = None, playback, ""
        end_s = playback.clock.end_s if playback is not None else 1.0
        self._pages.tell(page, self._scrub, max=round(end_s, 1))
        client = self._pages.clients.get(page)
        if client is not None:  # whatever it was set to there
            tell_page(client, self._fast, value=1.0)

    def left(self, page: int) -> None:
        """Forget a page that is gone; what was made for it ends."""
        viewer = self._viewers.pop(page, None)
        if viewer is not None and viewer.item is not None:
            self._worker.cancel(viewer.item.name)

    def _need(self, page: int) -> Playback:
        playback = self._of(page).playback
        if playback is None:
            raise ValueError("choose a run and press Show first")
        return playback

    def _seek(self, page: int, t_s: float) -> None:
        self._need(page).clock.seek(t_s)

    def step(self, page: int, frames: int) -> None:
        """Pause a page's film and go so many frames on (or back). ValueError: no film is shown."""
        clock = self._need(page).clock
        clock.play(False)
        clock.seek(clock.t_s + frames * FRAME_S)

    def _set_speed(self, page: int, speed: float) -> None:
        self._need(page).clock.set_speed(speed)

    def toggle(self, page: int) -> None:
        """Play a page's film, or pause it. ValueError: no film is shown."""
        clock = self._need(page).clock
        clock.play(not clock.playing)

    def draw(self) -> None:
        """Write each film's time on its page, and move the slider with a film that runs."""
        for page, viewer in list(self._viewers.items()):
            tell, playback = partial(self._pages.tell, page), viewer.playback
            words, label, lines, at_s = LIVE, PLAY, "", 0.0
            if playback is not None:
                t_s, end_s = playback.clock.t_s, playback.clock.end_s
                words = f"**Replay** of {plain(playback.name)}"
                words += f": {t_s:.2f} of {end_s:.2f} s"
                words += f" {playback.film.since}" if playback.film else ""
                label = PAUSE if playback.clock.playing else PLAY
                lines = event_lines(playback.film.events, t_s) if playback.film else ""
                at_s = min(round(t_s, 1), round(end_s, 1))
            words = " ".join([words, *self._why_not(page)])
            tell(self._scrub, value=at_s)
            tell(self._play, label=label)
            tell(self._words, _markdown=words)  # viser's name of a paragraph's content
            tell(self._events, _markdown=lines)
            tell(self._about, _markdown=viewer.about)
