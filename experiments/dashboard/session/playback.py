"""Playback of recorded or simulated motions in place of the live table."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from experiments.analysis.samples import held, run_part
from experiments.dashboard.session.live import CURVE_S, POINTS
from experiments.dashboard.session.plan import METHOD_WORDS
from experiments.dashboard.session.video import Video
from experiments.gap.closed_loop_replay import TableMotion, table_motion
from experiments.records.recording import Run
from experiments.records.run_folder import protocol_of
from rig.log import INDEX, Log


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


@dataclass(frozen=True, eq=False)
class RunFilm:
    """A recorded run as the page replays it.

    rows (n, len(COLUMNS)): thinned, for the curves, t_s from 0; events: (time [s], text) in order
    of time; method: the controller ("with" or "without" in a comparison); beside: the same run with
    the other one, beside_rows: its rows, None: there is none. Times are those of the motion, as
    `since` says.
    """

    name: str
    motion: TableMotion
    rows: np.ndarray
    events: list[tuple[float, str]]
    method: str = ""
    beside: TableMotion | None = None
    beside_method: str = ""
    beside_rows: np.ndarray | None = None

    @property
    def since(self) -> str:
        """From when its times count, in words: two runs begin together with the release."""
        return "from the release" if self.beside is not None else "from the run's start"

    @property
    def of(self) -> str:
        """Which run the curves are of, in words: the name, or of two runs the controller."""
        return _run_words(self.method) if self.beside is not None else self.name

    @property
    def beside_of(self) -> str:
        """The same of the run beside it."""
        return _run_words(self.beside_method)


def _run_words(method: str) -> str:
    return f"the run {METHOD_WORDS.get(method, method)}"


class Playback:
    """A film of one recorded motion, called `name` on the page.

    models: the motions of the model before and after naming, shown beside it; plate_map: the map of
    disagreement on its plate (`GapAnswer.plate_map`), None: none; film: the run's curves, events
    and the run beside it, None: the motion alone; playing: it begins at once. The attribute
    `video` is None until it is set to the run's video.
    """

    def __init__(
        self,
        name: str,
        motion: TableMotion,
        models: tuple[TableMotion, TableMotion] | None = None,
        *,
        plate_map: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None,
        film: RunFilm | None = None,
        playing: bool = True,
    ) -> None:
        self.film, self.plate_map = film, plate_map
        self.name, self.motion, self.models = name, motion, models
        self.clock = PlaybackClock(motion.end_s, loop=models is not None)
        self.clock.play(playing)
        self.video: Video | None = None

    def curve(self) -> np.ndarray | None:
        """Rows (n, len(COLUMNS)) of CURVE_S seconds with the film's time in the middle, or of the
        film's ends; None: the film has no curves.
        """
        last_s = max(self.clock.end_s - CURVE_S, 0.0)
        return self._rows_from(min(max(self.clock.t_s - CURVE_S / 2, 0.0), last_s))

    def past(self) -> np.ndarray | None:
        """Rows (n, len(COLUMNS)) of the CURVE_S seconds up to the film's time; None: the film has
        no curves.
        """
        return self._rows_from(self.clock.t_s - CURVE_S)

    def past_beside(self) -> np.ndarray | None:
        """As `past`, of the run beside it; None: there is none."""
        rows = None if self.film is None else self.film.beside_rows
        return None if rows is None else _window(rows, self.clock.t_s - CURVE_S)

    def _rows_from(self, begin_s: float) -> np.ndarray | None:
        return None if self.film is None else _window(self.film.rows, begin_s)

    def close(self) -> None:
        """Close the video."""
        if self.video is not None:
            self.video.close()


def _window(rows: np.ndarray, begin_s: float) -> np.ndarray:
    """The rows of CURVE_S seconds."""
    return rows[(rows[:, 0] >= begin_s) & (rows[:, 0] <= begin_s + CURVE_S)]


def without_targets(log: Log) -> Log:
    """A copy of the log of a run of the servos alone, whose targets are angles and no places on the
    plate: it has none.
    """
    rows = log.rows.copy()
    rows[:, [INDEX["target_x_m"], INDEX["target_y_m"]]] = np.nan
    return Log.from_rows(rows)


def run_film(name: str, run: Run, other: Run | None = None) -> RunFilm:
    """The film of a recorded run; other: the same run with the other controller.

    ValueError: a run has no rows.
    """
    both = other is not None
    log = run_part(run.log) if both else run.log
    if protocol_of(run.meta).get("servo_only"):
        log = without_targets(log)
    motion = table_motion(log)
    begin_s = float(log["t_s"][0])
    # A recording holds them as they were written: pushes that were detected come at its end.
    events = sorted((float(e["t_s"]) - begin_s, str(e["text"])) for e in run.events)
    beside = table_motion(other.log, run_only=True) if other is not None else None
    method = str(other.meta.get("arm")) if other is not None else ""
    rows = None if other is None else _thinned(run_part(other.log))
    own = str(run.meta.get("arm"))
    return RunFilm(name, motion, _thinned(log), events, own, beside, method, rows)


def _thinned(log: Log) -> np.ndarray:
    """The log's rows as a curve shows them, from 0 s."""
    rows = log.rows.copy()
    length_s = max(float(rows[-1, 0] - rows[0, 0]), 1e-3)
    for axis in "xy":  # between two observations the last one stands
        rows[:, INDEX[f"ball_{axis}_m"]] = held(log[f"ball_{axis}_m"], np.nan)
    rows = rows[:: max(1, round(len(log) / length_s * CURVE_S / POINTS))]
    rows[:, 0] -= rows[0, 0]
    return rows
