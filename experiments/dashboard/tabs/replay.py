"""The tab Replay: any recorded run again, scrubbed and at any speed, with its video."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.dashboard.server.controls import Controls
from experiments.dashboard.server.input_limits import SPEED, Range, choice
from experiments.dashboard.server.untrusted_text import plain
from experiments.dashboard.session.playback import Playback
from experiments.dashboard.session.tasks import RunSummary
from experiments.dashboard.session.video import Video, replay_run
from experiments.dashboard.session.worker_process import WorkerProcess, WorkItem

if TYPE_CHECKING:
    from viser import ViserServer

NONE = "(no runs yet)"
PERCENT = Range(0.0, 100.0, 0.1)
LIVE = "The live table is shown."
MAKING = (
    "*The video is made from the recording: about a quarter of its length, more on a busy machine.*"
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
        gui = server.gui
        gui.add_markdown("Choose a run and press **Show**; drag the slider to look anywhere.")
        self._picked: Any = gui.add_dropdown("Run", (NONE,))
        self._run = controls.value(self._picked, "run", lambda v: choice(v, self._picked.options))
        show = gui.add_button("Show", color="green")
        controls.button(show, "replay", lambda page: self.show())
        self._scrub: Any = gui.add_slider("Time [%]", 0.0, 100.0, 0.1, 0.0)
        self._at = controls.value(self._scrub, "time", PERCENT.clamp, self._seek)
        self._fast: Any = gui.add_slider("Speed", SPEED.low, SPEED.high, SPEED.step, 1.0)
        self._speed = controls.value(self._fast, "speed", SPEED.clamp, self._set_speed)
        pause = gui.add_button("Play / pause")
        controls.button(pause, "play", lambda page: self._toggle())
        back = gui.add_button("Back to the live table", color="gray")
        controls.button(back, "live", lambda page: self._show_playback(None))
        self._words: Any = gui.add_markdown(LIVE)
        blank = np.full((4, 4, 3), 128, np.uint8)
        self._image: Any = gui.add_image(blank, format="jpeg", visible=False)
        self._about: Any = gui.add_markdown("")  # the video
        self._playback: Playback | None = None
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
        found = [row.folder for row in self._rows() if row.folder.name == self._run.now]
        if not found:
            raise ValueError("no such run: make one in the tab Run")
        folder = found[0]

        def on_message(kind: str, what: Any) -> None:
            self._controls.queue.put("replay", partial(self._on_message, item, kind, what))

        item = WorkItem("replay", partial(replay_run, folder), on_message)
        self._item, self._about.content = item, f"*{plain(folder.name)} is read.*"
        self._worker.put(item, instead=True)

    def _on_message(self, item: WorkItem, kind: str, what: Any) -> None:
        if item is not self._item:  # another run was chosen, or another film is shown
            return
        if kind == "shown":
            self._show_playback(Playback(*what))
            self._item, self._about.content = item, MAKING
        elif kind == "progress":
            self._about.content = f"*{plain(what[0])}: {100 * what[1] // max(what[2], 1)} %*"
        elif kind == "failed":
            self._about.content = plain(what)
        elif kind == "done":
            self._need().video = Video(what)
            self._about.content = "What the camera saw, and what the tracker makes of it."

    def on_playback(self, playback: Playback | None) -> None:
        """Take note of the film that the app shows from now on, None for the live table: the film
        before is closed, and a run that is still being read will not be shown.
        """
        self._item = None
        if self._playback is not None:
            self._playback.close()
        self._playback, self._image.visible, self._about.content = playback, False, ""
        self._speed.now = self._fast.value = 1.0

    def show_frame(self, image: np.ndarray) -> None:
        """Show a frame (h, w, 3) uint8 RGB of the video."""
        self._image.image = image
        if not self._image.visible:
            self._image.visible = True

    def _need(self) -> Playback:
        if self._playback is None:
            raise ValueError("choose a run and press Show first")
        return self._playback

    def _seek(self, percent: float) -> None:
        clock = self._need().clock
        clock.seek(clock.end_s * percent / 100)

    def _set_speed(self, speed: float) -> None:
        if self._playback is not None:
            self._playback.clock.set_speed(speed)

    def _toggle(self) -> None:
        clock = self._need().clock
        clock.play(not clock.playing)

    def draw(self) -> None:
        """Write the film's time, and move the slider with a film that runs."""
        playback, words = self._playback, LIVE
        if playback is not None:
            t_s, end_s = playback.clock.t_s, playback.clock.end_s
            words = f"**Replay** of {plain(playback.name)}: {t_s:.1f} of {end_s:.1f} s"
            percent = round(100 * t_s / end_s, 1)
            if playback.clock.playing and abs(percent - self._scrub.value) > 0.4:
                self._scrub.value = self._at.now = percent
        if words != self._shown:
            self._shown = self._words.content = words
