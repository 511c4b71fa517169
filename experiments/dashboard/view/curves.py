"""Curves of the live table or of a film: five small charts over 20 s."""

from dataclasses import dataclass
from math import degrees
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.samples import held
from rig.log import INDEX
from rig.parameters import Servo

if TYPE_CHECKING:
    from viser import ClientHandle, ViserServer

X, Y = "#7048e8", "#e8590c"
LIVE, REPLAYED = "The last 20 s", "Replay: 20 s up to the film's time, at the right end"


def legend(what: str) -> str:
    """What is drawn (LIVE or REPLAYED), and in which colours, as HTML."""
    return (
        f'<div style="padding: 0 0.6em; font-size: 0.85em">{what}: '
        f'<b style="color: {X}">x</b>, <b style="color: {Y}">y</b>; - - what is wanted (play: - - '
        "of the joint, full of the gear)</div>"
    )


WAIT = "*Waiting for the first data.*"
FILM = "*This film has no curves.*"
_CM, _DEG = 100.0, degrees(1)


@dataclass(frozen=True)
class Chart:
    """A chart: its title, and for each curve (column of the log, label, colour,
    factor from the column's unit to the chart's, dashed).
    """

    title: str
    curves: tuple[tuple[str, str, str, float, bool], ...]


CHARTS = (
    Chart("ball [cm]", (
        ("ball_x_m", "x", X, _CM, False), ("ball_y_m", "y", Y, _CM, False),
        ("target_x_m", "target x", X, _CM, True), ("target_y_m", "target y", Y, _CM, True),
    )),
    Chart("servo angles [deg]", (
        ("theta_x_rad", "x", X, _DEG, False), ("theta_y_rad", "y", Y, _DEG, False),
        ("desired_theta_x_rad", "wanted x", X, _DEG, True),
        ("desired_theta_y_rad", "wanted y", Y, _DEG, True),
    )),
    Chart("volts applied [V]", (
        ("voltage_x_V", "x", X, 1.0, False), ("voltage_y_V", "y", Y, 1.0, False),
    )),
    Chart("torque in the shaft, estimated [mN m]", (
        ("estimated_torque_x_Nm", "x", X, 1e3, False),
        ("estimated_torque_y_Nm", "y", Y, 1e3, False),
    )),
    Chart("play found so far: gear, joint [deg]", (
        ("estimated_gear_play_x_rad", "gear x", X, _DEG, False),
        ("estimated_gear_play_y_rad", "gear y", Y, _DEG, False),
        ("estimated_joint_play_x_rad", "joint x", X, _DEG, True),
        ("estimated_joint_play_y_rad", "joint y", Y, _DEG, True),
    )),
)  # fmt: skip


COMMANDS = Chart("servo commands [deg]", (
    ("command_x_rad", "x", X, _DEG, False), ("command_y_rad", "y", Y, _DEG, False),
    ("desired_theta_x_rad", "wanted x", X, _DEG, True),
    ("desired_theta_y_rad", "wanted y", Y, _DEG, True),
))  # fmt: skip


def charts_of(servo: Servo) -> tuple[Chart, ...]:
    """The charts of a table: without volts and torques where its servos take an angle, and without
    angles where nobody measures them."""
    if not servo.takes_angle:
        return CHARTS
    ball, angles, _, _, play = CHARTS
    return (ball, *((angles,) if servo.has_angle else ()), COMMANDS, play)


def chart_data(chart: Chart, rows: np.ndarray) -> tuple[np.ndarray, ...]:
    """What a chart shows of log rows (n, len(COLUMNS)): the times [s], then each curve in its unit,
    (n,) each; a blank is the value before it, 0 where there was none (one NaN empties a chart of
    viser). Fewer than two rows give two points of zeros.
    """
    if len(rows) < 2:
        return tuple(
            np.arange(2.0) if i == 0 else np.zeros(2) for i in range(len(chart.curves) + 1)
        )
    found = [rows[:, INDEX["t_s"]]]
    found += [held(factor * rows[:, INDEX[name]]) for name, _, _, factor, _ in chart.curves]
    return tuple(found)


class Curves:
    """Builds the five charts in the GUI container of viser that is open; what: LIVE or REPLAYED;
    height: of one chart [px].

    Only the last one has numbers on its time axis, which all share.
    """

    def __init__(
        self,
        server: "ViserServer | ClientHandle",
        servo: Servo,
        what: str = LIVE,
        height: int = 84,
    ) -> None:
        self._charts = charts_of(servo)
        self._legend: Any = server.gui.add_html(legend(what))
        self._words: Any = server.gui.add_markdown(WAIT)
        self._said, self._plots = WAIT, list[Any]()
        for chart in self._charts:
            last = chart is self._charts[-1]
            series: list[Any] = [{"label": "t [s]"}]
            for _, label, colour, _, dashed in chart.curves:
                one: dict[str, Any] = {"label": label, "stroke": colour, "width": 1.3}
                if dashed:
                    one["dash"] = (5, 4)
                series.append(one)
            self._plots.append(
                server.gui.add_uplot(
                    chart_data(chart, np.empty((0, len(INDEX)))),
                    tuple(series),
                    title=chart.title,
                    scales={"x": {"time": False}},
                    axes=({"show": last, "size": 32, "space": 60}, {"size": 48, "space": 15}),
                    legend={"show": False},
                    height=height + (30 if last else 0),
                    padding=(10, 22, 0 if last else 6, 0),
                    visible=False,
                )
            )

    @property
    def handles(self) -> list[Any]:
        """The widgets."""
        return [self._legend, self._words, *self._plots]

    def rest(self, words: str) -> None:
        """Show `words` (Markdown) instead of the curves; "" shows the curves again."""
        if words != self._said:
            self._said = self._words.content = words
            for plot in self._plots:
                plot.visible = not words

    def draw(self, rows: np.ndarray) -> None:
        """Show rows (n, len(COLUMNS)) of the log."""
        self.rest("")
        for chart, plot in zip(self._charts, self._plots, strict=True):
            plot.data = chart_data(chart, rows)
