"""A film of motions: where it stands, how fast it runs; scrubbed by hand or by the clock."""

import time
from collections.abc import Callable

from experiments.dashboard.sides import Motion
from experiments.dashboard.video import Video


class Player:
    """Time of a film of `end_s` seconds; `clock` stands for the system's in tests."""

    def __init__(
        self, end_s: float, *, loop: bool = False, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.end_s, self._loop, self._clock = max(end_s, 1e-3), loop, clock
        self._from_s, self._since, self._speed, self.playing = 0.0, clock(), 1.0, False

    @property
    def t_s(self) -> float:
        """Where it stands; at its end it stops, or begins again."""
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
        self._from_s, self._since = min(max(t_s, 0.0), self.end_s), self._clock()

    def play(self, playing: bool) -> None:
        """Run or stand; from its end it starts anew."""
        here = self.t_s
        self.seek(0.0 if playing and here >= self.end_s else here)
        self.playing = playing

    def set_speed(self, speed: float) -> None:
        self.seek(self.t_s)
        self._speed = speed


class Stage:
    """What is shown instead of the live table: one motion, or three beside each other; a video may
    come later."""

    def __init__(
        self,
        name: str,
        shown: Motion,
        others: tuple[Motion, Motion] | None = None,
        *,
        playing: bool = True,
    ) -> None:
        self.name, self.shown, self.others = name, shown, others
        self.player = Player(shown.end_s, loop=others is not None)
        self.player.play(playing)
        self.video: Video | None = None

    def close(self) -> None:
        if self.video is not None:
            self.video.close()
