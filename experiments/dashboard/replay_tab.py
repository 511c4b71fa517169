"""The tab Replay: any recorded run again, scrubbed and at any speed, with its video if any."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.dashboard.clamps import SPEED, Range, choice
from experiments.dashboard.controls import Controls
from experiments.dashboard.player import Stage
from experiments.dashboard.sides import motion_of
from experiments.dashboard.tasks import RunRow
from experiments.recording import read_run

if TYPE_CHECKING:
    from viser import ViserServer

NONE = "(no runs yet)"
PERCENT = Range(0.0, 100.0, 0.1)
VIDEO = "video.mkv"


class Film:
    """Frames of a run's video by time, read forward where it can be."""

    def __init__(self, path: Path) -> None:
        import av

        self._container: Any = av.open(str(path))
        self._stream: Any = self._container.streams.video[0]
        self._last_s, self._frames = -1.0, iter(())

    def at(self, t_s: float) -> Any:
        """The frame (h, w, 3) RGB at a time; None past the end."""
        if not 0.0 <= t_s - self._last_s < 2.0:
            self._container.seek(int(t_s / self._stream.time_base), stream=self._stream)
            self._frames = self._container.decode(self._stream)
        for frame in self._frames:
            self._last_s = float(frame.time)
            if self._last_s >= t_s - 0.02:
                return frame.to_ndarray(format="rgb24")
        return None

    def close(self) -> None:
        self._container.close()


class ReplayTab:
    """`play` shows a stage instead of the live table, `live` goes back; `draw` keeps the slider."""

    def __init__(
        self, server: "ViserServer", controls: Controls, rows: Callable[[], list[RunRow]],
        play: Callable[[Stage | None], None],
    ) -> None:  # fmt: skip
        self._rows, self._play = rows, play
        gui = server.gui
        gui.add_markdown("Choose a run and press **Show**; drag the slider to look anywhere.")
        self._picked: Any = gui.add_dropdown("Run", (NONE,))
        self._run = controls.value(self._picked, "run", lambda v: choice(v, self._picked.options))
        show = gui.add_button("Show", color="green")
        controls.button(show, "replay", lambda page: self.show())
        self._scrub: Any = gui.add_slider("Time [%]", 0.0, 100.0, 0.1, 0.0)
        self._at = controls.value(self._scrub, "time", PERCENT.clamp, self._seek)
        self._speed = controls.value(
            gui.add_slider("Speed", SPEED.low, SPEED.high, SPEED.step, 1.0),
            "speed", SPEED.clamp, self._set_speed,
        )  # fmt: skip
        pause = gui.add_button("Play / pause")
        controls.button(pause, "play", lambda page: self._toggle())
        back = gui.add_button("Back to the live table", color="gray")
        controls.button(back, "live", lambda page: self._play(None))
        self._words: Any = gui.add_markdown("live")
        self._video: Any = None
        self._film: Film | None = None
        self._gui, self._stage, self._shown = gui, None, ""

    def refresh(self) -> None:
        """The list of runs has changed."""
        names = tuple(row.folder.name for row in self._rows()) or (NONE,)
        if names != self._picked.options:
            self._picked.options = names
            if self._run.now not in names:
                self._run.now = names[0]

    def show(self) -> None:
        """Read the chosen run and play it."""
        found = [row for row in self._rows() if row.folder.name == self._run.now]
        if not found:
            raise ValueError("no such run: make one in the tab Run")
        whole = read_run(found[0].folder)
        self._open_video(found[0].folder / VIDEO)
        self._play(Stage(found[0].folder.name, motion_of(whole.log)))

    def _open_video(self, path: Path) -> None:
        if self._film is not None:
            self._film.close()
        self._film = Film(path) if path.is_file() else None

    def on_stage(self, stage: Stage | None) -> None:
        """What is shown from now on; told by the app."""
        self._stage = stage
        if stage is not None:
            stage.player.set_speed(self._speed.now)
        else:
            self._open_video(Path())

    def video(self, t_s: float) -> Any:
        """The frame of the run's video at a time, None without one."""
        return self._film.at(t_s) if self._film is not None else None

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
        stage, words = self._stage, "The live table is shown."
        if stage is not None:
            t_s, end_s = stage.player.t_s, stage.player.end_s
            words = f"**Replay** of {stage.name}: {t_s:.1f} of {end_s:.1f} s"
            percent = round(100 * t_s / end_s, 1)
            if stage.player.playing and abs(percent - self._scrub.value) > 0.4:
                self._scrub.value = self._at.now = percent
        if words != self._shown:
            self._shown = self._words.content = words
