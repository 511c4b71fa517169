"""The tab Replay: any recorded run again, scrubbed and at any speed, with its video."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.dashboard.server.controls import Controls
from experiments.dashboard.server.input_limits import SPEED, Range, choice, flag
from experiments.dashboard.server.untrusted_text import plain
from experiments.dashboard.session.playback import Playback
from experiments.dashboard.session.tasks import RunSummary
from experiments.dashboard.session.video import Video, replay_run
from experiments.dashboard.session.worker_process import WorkerProcess, WorkItem

if TYPE_CHECKING:
    from viser import ViserServer

NONE = "(no runs yet)"
STEP_S = 0.1  # of the slider; the keys step a frame of FRAME_S
FRAME_S = 1 / 60
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


class ReplayTab:
    """Builds the tab Replay in the GUI container of viser that is open: run, time, speed, video.

    worker: reads runs and makes videos; rows: lists the recorded runs; show_playback: puts a film
    in place of the live table, None ends it.
    """

    def __init__(
        self,
        server: "ViserServer",
        controls: Controls,
        worker: WorkerProcess,
        rows: Callable[[], list[RunSummary]],
        show_playback: Callable[[Playback | None], None],
    ) -> None:
        self._controls, self._worker, self._rows, self._show_playback = (
            controls,
            worker,
            rows,
            show_playback,
        )
        self._playback: Playback | None = None
        gui = server.gui
        gui.add_markdown("Choose a run and press **Show**; drag the slider to look anywhere.")
        self._picked: Any = gui.add_dropdown("Run", (NONE,))
        self._run = controls.value(self._picked, "run", lambda v: choice(v, self._picked.options))
        both = gui.add_checkbox("Both controllers on one plate", False, hint=BOTH)
        self._both = controls.value(both, "both controllers", flag)
        show = gui.add_button("Show", color="green")
        controls.button(show, "replay", lambda page: self.show())
        self._scrub: Any = gui.add_slider("Time [s]", 0.0, 1.0, STEP_S, 0.0)
        self._at = controls.value(self._scrub, "time", self._on_film, self._seek)
        self._fast: Any = gui.add_slider("Speed", SPEED.low, SPEED.high, SPEED.step, 1.0)
        self._speed = controls.value(self._fast, "speed", SPEED.clamp, self._set_speed)
        self._play: Any = gui.add_button(PLAY)
        controls.button(self._play, "play", lambda page: self.toggle())
        back = gui.add_button("Back to the live table", color="gray")
        controls.button(back, "live", lambda page: self._show_playback(None))
        self._words: Any = gui.add_markdown(LIVE)
        self._events: Any = gui.add_markdown("")
        self._about: Any = gui.add_markdown("")  # the video, which the panel Camera shows
        self._drawn_s = 0.0
        self._item: WorkItem | None = None  # that reads the chosen run
        self._shown = LIVE

    def refresh(self) -> None:
        """List the recorded runs anew."""
        names = tuple(row.folder.name for row in self._rows()) or (NONE,)
        if names != self._picked.options:
            self._picked.options = names
            if self._run.now not in names:
                self._run.now = names[0]

    def show(self) -> None:
        """Have the worker read the chosen run and make its video; what it read before is dropped.

        ValueError: there is no such run.
        """
        found = [row for row in self._rows() if row.folder.name == self._run.now]
        if not found:
            raise ValueError("no such run: make one in the tab Run")
        folder = found[0].folder
        beside = partner(found[0], self._rows()) if self._both.now else None
        if self._both.now and beside is None:
            raise ValueError("no run of the other controller with this protocol and seed")

        def on_message(kind: str, what: Any) -> None:
            self._controls.queue.put("replay", partial(self._on_message, item, kind, what))

        item = WorkItem("replay", partial(replay_run, folder, beside), on_message)
        self._item, self._about.content = item, f"*{plain(folder.name)} is read.*"
        self._worker.put(item, instead=True)

    def _on_message(self, item: WorkItem, kind: str, what: Any) -> None:
        if item is not self._item:  # another run was chosen, or another film is shown
            return
        if kind == "shown":
            self._show_playback(Playback(what.name, what.motion, film=what))
            self._item, self._about.content = item, MAKING
        elif kind == "progress":
            self._about.content = f"*{plain(what[0])}: {100 * what[1] // max(what[2], 1)} %*"
        elif kind == "failed":
            self._about.content = plain(what)
        elif kind == "done":
            self._need().video = Video(what)
            self._about.content = "What the camera saw is shown left, in the panel Camera."

    def on_playback(self, playback: Playback | None) -> None:
        """Take note of the film that the app shows from now on, None for the live table: the film
        before is closed, and a run that is still being read will not be shown.
        """
        self._item = None
        if self._playback is not None:
            self._playback.close()
        self._playback, self._about.content, self._events.content = playback, "", ""
        end_s = playback.clock.end_s if playback is not None else 1.0
        self._scrub.max = round(end_s, 1)
        self._speed.now = self._fast.value = 1.0

    def _need(self) -> Playback:
        if self._playback is None:
            raise ValueError("choose a run and press Show first")
        return self._playback

    def _on_film(self, value: Any) -> float:
        return Range(0.0, self._playback.clock.end_s if self._playback else 1.0, STEP_S).clamp(
            value
        )

    def _seek(self, t_s: float) -> None:
        self._need().clock.seek(t_s)

    def step(self, frames: int) -> None:
        """Pause the film and go so many frames on (or back). ValueError: no film is shown."""
        clock = self._need().clock
        clock.play(False)
        clock.seek(clock.t_s + frames * FRAME_S)

    def _set_speed(self, speed: float) -> None:
        if self._playback is not None:
            self._playback.clock.set_speed(speed)

    def toggle(self) -> None:
        """Play the film, or pause it. ValueError: no film is shown."""
        clock = self._need().clock
        clock.play(not clock.playing)

    def draw(self) -> None:
        """Write the film's time, and move the slider with a film that runs."""
        playback, words, label = self._playback, LIVE, PLAY
        if playback is not None:
            t_s, end_s = playback.clock.t_s, playback.clock.end_s
            words = f"**Replay** of {plain(playback.name)}: {t_s:.1f} of {end_s:.1f} s"
            label = PAUSE if playback.clock.playing else PLAY
            lines = event_lines(playback.film.events, t_s) if playback.film else ""
            if self._events.content != lines:
                self._events.content = lines
            at_s = min(round(t_s, 1), self._scrub.max)
            if at_s != self._drawn_s:  # not a slider that is just dragged
                self._drawn_s = self._scrub.value = self._at.now = at_s
        if self._play.label != label:
            self._play.label = label
        if words != self._shown:
            self._shown = self._words.content = words
