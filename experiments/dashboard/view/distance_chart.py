"""How far the ball was from its target in two runs of one film: where they part is seen at once."""

from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.samples import held
from experiments.dashboard.session.live import POINTS
from experiments.dashboard.session.playback import RunFilm
from experiments.dashboard.view.curves import CURSOR, EVENT, TIMES, VALUES, with_lines
from experiments.dashboard.view.scene import ARMS
from experiments.gap.closed_loop_replay import TableMotion

if TYPE_CHECKING:
    from viser import ClientHandle

PARTED_S = 2.0  # after the release the way to the target would set the scale; chosen: it takes 1.5
TITLE = "off target [cm], scaled to what comes after {:.0f} s: red with compensation, blue without"


def distances_cm(motion: TableMotion, times_s: np.ndarray) -> np.ndarray:
    """How far the ball of a motion was from its target (n,) [cm] at times_s (n,) [s]; between two
    sights the last one stands, and before the first the first.
    """
    away = 100 * np.hypot(*(motion.ball_m - motion.target_m).T)
    at = np.clip(np.searchsorted(motion.t_s, times_s, side="right") - 1, 0, len(away) - 1)
    return held(held(away, np.nan)[::-1], 0.0)[::-1][at]


def scale_cm(times_s: np.ndarray, *curves: np.ndarray) -> tuple[float, float]:
    """Ends of the chart's axis for curves (n,) [cm] at times_s (n,) [s]: those of what comes after
    PARTED_S, or after half of a shorter film.
    """
    late = times_s >= min(PARTED_S, times_s[-1] / 2)
    return 0.0, 1.05 * max(0.1, *(float(curve[late].max()) for curve in curves))


class DistanceChart:
    """Builds the chart of a film with a run beside it in the GUI container of viser that is open;
    end_s: of the film.
    """

    def __init__(self, client: "ClientHandle", film: RunFilm, end_s: float) -> None:
        assert film.beside is not None
        times_s = np.linspace(0.0, end_s, POINTS)
        own, beside = (distances_cm(one, times_s) for one in (film.motion, film.beside))
        curves = (own, beside) if film.method == "with" else (beside, own)
        self._data, self._events_s = (times_s, *curves), [at_s for at_s, _ in film.events]
        series: list[Any] = [{"label": "t [s]"}]
        for arm in ("with", "without"):
            series.append({"label": arm, "stroke": f"rgb{ARMS[arm]}", "width": 1.5})
        for label, looks in (("time", CURSOR), ("event", EVENT)):
            series.append({"label": label, "scale": "line", **looks})
        self._plot: Any = client.gui.add_uplot(
            with_lines(self._data, 0.0, ()),
            tuple(series),
            title=TITLE.format(min(PARTED_S, end_s / 2)),
            scales={
                "x": {"time": False},
                "y": {"range": scale_cm(times_s, *curves)},
                "line": {"range": (0.1, 0.9)},
            },
            axes=(TIMES, VALUES),
            legend={"show": False},
            height=160,
            padding=(10, 22, 0, 0),
        )

    @property
    def handles(self) -> list[Any]:
        """The widgets."""
        return [self._plot]

    def draw(self, at_s: float) -> None:
        """Draw the line at the film's time at_s [s]."""
        self._plot.data = with_lines(self._data, at_s, self._events_s)
