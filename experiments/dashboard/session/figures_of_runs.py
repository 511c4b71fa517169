"""The figures that the completed runs of one protocol allow, with and without play compensation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from experiments.analysis.numbers import Recorded, resting_centroid_cm, resting_centroids_cm
from experiments.reports import figures

PUSHED = "pushed"  # protocol of the paper's Figs. 12 and 13
RELEASED = "free-release"  # of its Figs. 7, 10, 11 and 14
RUNS_OF_FIG14 = 4  # of either method: the paper's figure shows eight

Drawn = tuple[Figure, str, str]  # figure, name of its file, caption


@dataclass(frozen=True, eq=False)
class Completed:
    """Completed runs of one protocol by method, newest first, and what their figures need.

    marks: by folder, when a run was disturbed by hand [s from release]; side_cm: by folder, side of
    the plate.
    """

    protocol: str
    without: Sequence[Recorded]
    with_: Sequence[Recorded]
    marks: Mapping[Path, Sequence[float]]
    side_cm: Mapping[Path, float]

    def figures(self) -> list[Drawn]:
        """The figures of the newest runs; the paper's number where the runs are of its protocol."""
        if not (self.without and self.with_):
            return self._of_one() if self.without or self.with_ else []
        return self._pushed() if self.protocol == PUSHED else self._of_both()

    def _pushed(self) -> list[Drawn]:
        arms = (("12", "without", self.without[0]), ("13", "with", self.with_[0]))
        caption = "Fig. {}: the pushed ball, {} play compensation"
        return [(self._plate(run, arm), f"fig{n}", caption.format(n, arm)) for n, arm, run in arms]

    def _of_both(self) -> list[Drawn]:
        a, b = self.without[0], self.with_[0]
        centres = resting_centroids_cm(a, b)
        place = figures.release_scatter(a.log, b.log, centres, self.side_cm[b.folder])
        over_time = figures.ball_over_time(a.log, b.log)
        servo = figures.servo_over_time(a.log, b.log)
        for figure in (over_time, servo):
            figures.mark_times(figure, [*self.marks[a.folder], *self.marks[b.folder]], "by hand")
        where = "the ball in the newest run without (blue) and with (red) play compensation"
        drawn = [
            (place, "fig10", self._caption(10, where)),
            (over_time, "ball-time", self._caption(7, "the same ball over time")),
            (servo, "fig11", self._caption(11, "the same runs' servo angles")),
        ]
        n = RUNS_OF_FIG14
        if min(len(self.without), len(self.with_)) >= n and centres:
            without, with_ = ([one.log for one in runs[:n]] for runs in (self.without, self.with_))
            eight = figures.eight_runs(without, with_)
            drawn.append((eight, "fig14", self._caption(14, f"the newest {n} runs of each")))
        return drawn

    def _of_one(self) -> list[Drawn]:
        method, run = ("without", self.without[0]) if self.without else ("with", self.with_[0])
        over_time = figures.ball_of_run(run.log, figures.colour_of(method))
        figures.mark_times(over_time, self.marks[run.folder], "by hand")
        caption = f"The ball, {method} play compensation; the other run is still to come"
        return [
            (self._plate(run, method), "ball", caption),
            (over_time, "ball-time", "Ball over time"),
        ]

    def _plate(self, run: Recorded, arm: str) -> Figure:
        side_cm = self.side_cm[run.folder]
        return figures.pushed_scatter(run.log, resting_centroid_cm(run), arm, side_cm)

    def _caption(self, number: int, words: str) -> str:
        """`words`, after the number of the paper's figure where the runs are of its protocol."""
        if self.protocol == RELEASED:
            return f"Fig. {number}: {words}"
        return words[0].upper() + words[1:]
