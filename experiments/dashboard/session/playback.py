"""Playback of recorded or simulated motions in place of the live table."""

import time
from collections.abc import Callable

from experiments.dashboard.session.video import Video
from experiments.gap.closed_loop_replay import TableMotion


class PlaybackClock:
    """Position in a film of `end_s` seconds, with speed and pause; loop: begin again at its end.

    clock: monotonic [s], replaced in tests. `playing`: False while it is paused.
    """

    def __init__(
        self, end_s: float, *, loop: bool = False, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.end_s, self._loop, self._clock = max(end_s, 1e-3), loop, clock
        self._from_s, self._since, self._speed, self.playing = 0.0, clock(), 1.0, False

    @property
    def t_s(self) -> float:
        """Present position [s]; at the end it stops, or begins again."""
        if not self.playing:
            return self._from_s
        t_s = self._from_s + self._speed * (self._clock() - self._since)
        if t_s >= self.end_s and self._loop:
            return t_s % self.end_s
        if t_s >= self.end_s:
            self.playing, self._from_s = False, self.end_s
            return self.end_s
        return t_s

    def seek(self, t_s: float) -> None:
        """Go to a time [s], clamped to the film."""
        self._from_s, self._since = min(max(t_s, 0.0), self.end_s), self._clock()

    def play(self, playing: bool) -> None:
        """Play the film or, with `playing` False, pause it; from its end it plays from the
        beginning.
        """
        here = self.t_s
        self.seek(0.0 if playing and here >= self.end_s else here)
        self.playing = playing

    def set_speed(self, speed: float) -> None:
        """Play `speed` times as fast as it was recorded, from here on."""
        self.seek(self.t_s)
        self._speed = speed


class Playback:
    """A film of one recorded motion, called `name` on the page.

    models: the motions of the model before and after naming, shown beside it; playing: it begins at
    once. The attribute `video` is None until it is set to the run's video.
    """

    def __init__(
        self,
        name: str,
        motion: TableMotion,
        models: tuple[TableMotion, TableMotion] | None = None,
        *,
        playing: bool = True,
    ) -> None:
        self.name, self.motion, self.models = name, motion, models
        self.clock = PlaybackClock(motion.end_s, loop=models is not None)
        self.clock.play(playing)
        self.video: Video | None = None

    def close(self) -> None:
        """Close the video."""
        if self.video is not None:
            self.video.close()
