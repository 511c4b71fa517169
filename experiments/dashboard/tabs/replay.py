"""The tab Replay: any recorded run again, scrubbed and at any speed, with its video."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.dashboard.clamps import SPEED, Range, choice
from experiments.dashboard.controls import Controls
from experiments.dashboard.desk import Desk, Piece
from experiments.dashboard.player import Stage
from experiments.dashboard.sides import motion_of
from experiments.dashboard.tasks import RunRow
from experiments.dashboard.video import VIDEO, Video, render_video
from experiments.recording import read_run

if TYPE_CHECKING:
    from viser import ViserServer

NONE = "(no runs yet)"
PERCENT = Range(0.0, 100.0, 0.1)
LIVE = "The live table is shown."


class ReplayTab:
    """`play` shows a stage instead of the live table, or (None) goes back; `draw` follows it."""

    def __init__(
        self, server: "ViserServer", controls: Controls, desk: Desk,
        rows: Callable[[], list[RunRow]], play: Callable[[Stage | None], None],
    ) -> None:  # fmt: skip
        self._controls, self._desk, self._rows, self._play = controls, desk, rows, play
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
        controls.button(back, "live", lambda page: self._play(None))
        self._words: Any = gui.add_markdown(LIVE)
        blank = np.full((4, 4, 3), 128, np.uint8)
        self._image: Any = gui.add_image(blank, format="jpeg", visible=False)
        self._about: Any = gui.add_markdown("")  # the video
        self._stage: Stage | None = None
        self._shown = LIVE

    def refresh(self) -> None:
        """The list of runs has changed."""
        names = tuple(row.folder.name for row in self._rows()) or (NONE,)
        if names != self._picked.options:
            self._picked.options = names
            if self._run.now not in names:
                self._run.now = names[0]

    def show(self) -> None:
        """Read the chosen run and play it; its video comes with it, or as soon as it is made."""
        found = [row.folder for row in self._rows() if row.folder.name == self._run.now]
        if not found:
            raise ValueError("no such run: make one in the tab Run")
        stage = Stage(found[0].name, motion_of(read_run(found[0]).log))
        self._play(stage)
        if (found[0] / VIDEO).is_file():
            self._add_video(stage, found[0] / VIDEO)
            return

        def heard(kind: str, what: Any) -> None:
            self._controls.orders.put("video", partial(self._heard, stage, kind, what))

        self._desk.put(Piece("video", partial(render_video, found[0]), heard), instead=True)
        self._about.content = (
            "*The video is made from the recording: about a quarter of its length, more on a busy "
            "machine.*"
        )

    def _heard(self, stage: Stage, kind: str, what: Any) -> None:
        if stage is not self._stage:
            return
        if kind == "progress":
            self._about.content = f"*{what[0]}: {100 * what[1] // max(what[2], 1)} %*"
        elif kind == "failed":
            self._about.content = str(what)
        elif kind == "done":
            self._add_video(stage, what)

    def _add_video(self, stage: Stage, path: Path) -> None:
        stage.video = Video(path)
        self._about.content = "What the camera saw, and what the tracker makes of it."

    def on_stage(self, stage: Stage | None) -> None:
        """What is shown from now on; told by the app."""
        if self._stage is not None:
            self._stage.close()
        self._stage, self._image.visible, self._about.content = stage, False, ""
        self._speed.now = self._fast.value = 1.0

    def show_frame(self, image: np.ndarray) -> None:
        """The newest image of the video."""
        self._image.image = image
        if not self._image.visible:
            self._image.visible = True

    def _need(self) -> Stage:
        if self._stage is None:
            raise ValueError("choose a run and press Show first")
        return self._stage

    def _seek(self, percent: float) -> None:
        player = self._need().player
        player.seek(player.end_s * percent / 100)

    def _set_speed(self, speed: float) -> None:
        if self._stage is not None:
            self._stage.player.set_speed(speed)

    def _toggle(self) -> None:
        player = self._need().player
        player.play(not player.playing)

    def draw(self) -> None:
        """Where the film stands; the slider follows while it runs."""
        stage, words = self._stage, LIVE
        if stage is not None:
            t_s, end_s = stage.player.t_s, stage.player.end_s
            words = f"**Replay** of {stage.name}: {t_s:.1f} of {end_s:.1f} s"
            percent = round(100 * t_s / end_s, 1)
            if stage.player.playing and abs(percent - self._scrub.value) > 0.4:
                self._scrub.value = self._at.now = percent
        if words != self._shown:
            self._shown = self._words.content = words
