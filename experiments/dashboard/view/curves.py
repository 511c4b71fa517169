"""Curves of the live table or of a film: five small charts over 20 s."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from math import degrees
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.samples import held
from rig.log import INDEX
from rig.parameters import Servo

if TYPE_CHECKING:
    from viser import ClientHandle, ViserServer

X, Y = "#7048e8", "#cf4708"
X_HERE, Y_HERE = f"var(--rig-x, {X})", f"var(--rig-y, {Y})"  # beside a chart, on light and dark
HERE = {X: X_HERE, Y: Y_HERE}
# Lines of a film in the greys of no curve, seen on light and dark.
CURSOR = {"stroke": "#868e96", "width": 2.5}
EVENT = {"stroke": "#adb5bd", "width": 1.2, "dash": (3, 3)}
LIVE, STOPPED = "The last 20 s", "<b>Stopped</b>: the last 20 s before"
REPLAYED = "Replay of {} (upright lines: thick the time shown, dashed events)"
TEXT = "padding: 0 1.2em 0 0.6em; font-size: 0.85em"
NUMBER = "text-align: right; padding-left: 0.5em"


def legend(what: str) -> str:
    """What is drawn, and in which colours, as HTML."""
    return (
        f'<div style="{TEXT}">{what}: '
        f'<b style="color: {X_HERE}">x</b>, <b style="color: {Y_HERE}">y</b>; dashed: wanted</div>'
    )


WAIT = "*Waiting for the first data.*"
TIMES: Any = {"size": 32, "space": 60, "label": "time [s]", "labelSize": 20}  # axes of a chart
VALUES: Any = {"size": 48, "space": 12}
FILM = "*This replay has no curves.*"
LINE_S = 1e-3  # half width of a line's foot; chosen: less than a pixel
_CM, _DEG = 100.0, degrees(1)


@dataclass(frozen=True)
class Chart:
    """A chart: its title, for each curve (column of the log, label, colour, factor from the
    column's unit to the chart's, dashed), and what is drawn how, where the legend does not say it.
    """

    title: str
    curves: tuple[tuple[str, str, str, float, bool], ...]
    note: str = ""


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
    Chart("torque in the shaft, estimated [mN\u00a0m]", (
        ("estimated_torque_x_Nm", "x", X, 1e3, False),
        ("estimated_torque_y_Nm", "y", Y, 1e3, False),
    )),
    Chart("play found [deg]", (
        ("estimated_gear_play_x_rad", "gear x", X, _DEG, False),
        ("estimated_gear_play_y_rad", "gear y", Y, _DEG, False),
        ("estimated_joint_play_x_rad", "joint x", X, _DEG, True),
        ("estimated_joint_play_y_rad", "joint y", Y, _DEG, True),
    ), ": gear, dashed joint"),
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


def has_data(chart: Chart, rows: np.ndarray) -> bool:
    """Whether log rows (n, len(COLUMNS)) hold anything of the full curves of a chart."""
    columns = [INDEX[name] for name, _, _, _, dashed in chart.curves if not dashed]
    return bool(np.isfinite(rows[:, columns]).any())


def with_lines(
    data: tuple[np.ndarray, ...], at_s: float, events_s: Sequence[float]
) -> tuple[np.ndarray, ...]:
    """Data of a chart, (n,) each, with two curves more that are upright lines: one at at_s [s], and
    one at each of events_s. They are 0 but there, and 1 there (one NaN empties a chart of viser).
    """
    t_s = data[0]
    marks = np.array([m for m in events_s if t_s[0] <= m <= t_s[-1]])
    feet = np.concatenate([[at_s], marks])
    times = np.unique(np.concatenate([t_s, feet, feet - LINE_S, feet + LINE_S]))
    before = np.clip(np.searchsorted(t_s, times, side="right") - 1, 0, None)
    lines = [np.isin(times, at).astype(float) for at in ([at_s], marks)]
    return (times, *(curve[before] for curve in data[1:]), *lines)


def values_at(charts: Sequence[Chart], runs: Mapping[str, np.ndarray], at_s: float) -> str:
    """What the full curves of runs are at at_s [s], as a table (HTML): of one run x beside y, of
    more a line an axis, one run beside the other; runs: by controller, their log rows (n,
    len(COLUMNS)).
    """
    past = [rows[rows[:, 0] <= at_s] for rows in runs.values()]

    def cell(text: str, colour: str = "inherit") -> str:
        return f'<td style="color: {colour}; {NUMBER}">{text}</td>'

    def line(name: str, cells: Iterable[str]) -> str:
        return f"<tr><td>{name}</td>{''.join(cells)}</tr>"

    many = len(runs) > 1
    lines = [line("", map(cell, map(escape, runs) if many else "xy"))]
    for chart in charts:
        found = {}
        for name, axis, colour, factor, dashed in chart.curves:
            if not dashed:
                last = [factor * held(rows[:, INDEX[name]], np.nan)[-1:] for rows in past]
                said = [f"{v[0]:+.2f}" if np.isfinite(v).all() and len(v) else "" for v in last]
                found[axis[-1]] = [cell(text, HERE[colour]) for text in said]
        if many:
            named = chart.title.replace(" [", " {} [")
            lines += [line(named.format(axis), cells) for axis, cells in found.items()]
        else:
            lines.append(line(chart.title, (text for cells in found.values() for text in cells)))
    table = f'<table style="line-height: 1.25">{"".join(lines)}</table>'
    return f'<div style="{TEXT}"><b>At {at_s:.2f} s</b>{table}</div>'


class Curves:
    """Builds the five charts in the GUI container of viser that is open; replayed: of which run,
    with a line at the film's time, "" for the live table; height: of one chart [px].

    Only the last one has numbers on its time axis, which all share; another one without any data is
    left out.
    """

    def __init__(
        self,
        server: "ViserServer | ClientHandle",
        servo: Servo,
        replayed: str = "",
        height: int = 70,
    ) -> None:
        self._charts = charts_of(servo)
        self._replays = bool(replayed)
        self._what = REPLAYED.format(escape(replayed)) if replayed else LIVE
        self._legend: Any = server.gui.add_html(legend(self._what))
        self._values: Any = server.gui.add_html("", visible=self._replays)
        self._words: Any = server.gui.add_markdown(WAIT)
        self._said, self._plots = WAIT, list[Any]()
        self._shown = [False] * len(self._charts)
        for chart in self._charts:
            last = chart is self._charts[-1]
            series: list[Any] = [{"label": "t [s]"}]
            for _, label, colour, _, dashed in chart.curves:
                one: dict[str, Any] = {"label": label, "stroke": colour, "width": 1.3}
                if dashed:
                    one["dash"] = (5, 4)
                series.append(one)
            data = chart_data(chart, np.empty((0, len(INDEX))))
            scales: dict[str, Any] = {"x": {"time": False}}
            if self._replays:
                data = with_lines(data, 0.0, ())
                scales["line"] = {"range": (0.1, 0.9)}  # where a line is 0 it is below the chart
                for label, looks in (("time", CURSOR), ("event", EVENT)):
                    series.append({"label": label, "scale": "line", **looks})
            self._plots.append(
                server.gui.add_uplot(
                    data,
                    tuple(series),
                    title=chart.title + chart.note,
                    scales=scales,
                    axes=(TIMES | {"show": last}, VALUES),
                    legend={"show": False},
                    height=height + (50 if last else 0),
                    padding=(10, 22, 0 if last else 6, 0),
                    visible=False,
                )
            )

    @property
    def handles(self) -> list[Any]:
        """The widgets."""
        return [self._legend, self._values, self._words, *self._plots]

    def rest(self, words: str) -> None:
        """Show `words` (Markdown) instead of curves and legend; "" takes the words away."""
        if words != self._said:
            self._said = self._words.content = words
            self._legend.visible = not words
        if words:
            self._show([False] * len(self._plots))

    def head(self, what: str) -> None:
        """Say above the curves what is drawn: LIVE, or STOPPED where nothing comes any more."""
        if what != self._what:
            self._what, self._legend.content = what, legend(what)

    def _show(self, shown: list[bool]) -> None:
        for plot, now, before in zip(self._plots, shown, self._shown, strict=True):
            if now != before:
                plot.visible = now
        self._shown = shown

    def draw(
        self,
        rows: np.ndarray,
        at_s: float = 0.0,
        events_s: Sequence[float] = (),
        runs: Mapping[str, np.ndarray] | None = None,
    ) -> None:
        """Show rows (n, len(COLUMNS)) of the log; of a replay the values of its `runs` at at_s [s]
        (by controller, their rows), and lines there and at the events.
        """
        self.rest("")
        self._show([has_data(chart, rows) for chart in self._charts[:-1]] + [True])
        for chart, plot, shown in zip(self._charts, self._plots, self._shown, strict=True):
            if shown:
                data = chart_data(chart, rows)
                plot.data = with_lines(data, at_s, events_s) if self._replays else data
        if self._replays:
            self._values.content = values_at(self._charts, runs or {"": rows}, at_s)
