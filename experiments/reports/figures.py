"""The paper's figures 7, 8 and 10 to 14, and the map of play: PNG and SVG, source marked.

Each figure is one plain function of logs; with = red, without = blue, reference and centre green,
centroids crosses and squares of these colours, where the paper has black crosses. Figures show
centimetres and seconds from release.
"""

from collections.abc import Mapping, Sequence
from math import ceil, degrees, log10
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.transforms import blended_transform_factory

from experiments.analysis.samples import ball_samples, run_part
from experiments.picture_files import our_style, subplots, write_figure
from rig.log import Log, shown_angles

# With, without, and what is wanted, in every figure; told apart by the colour-blind, too (a test).
WITH, WITHOUT, CENTRE = "#d62728", "#1f4fd8", "#00b39b"
ARMS = {"without": "without play compensation", "with": "with play compensation"}
# Green-blue helps, brown hurts: neither is the colour of an arm, or of red-green. The pale part of
# it: black letters have a contrast above 4.5 on every cell, and in the dark, where they are
# turned into white ones, too (a test).
HELPS_HURTS = ListedColormap(colormaps["BrBG"](np.linspace(0.27, 0.73, 256)), "helps-hurts")
SOURCES = {"simulated": "virtual rig", "measured": "measured"}
_CM = 100.0
TIME_IN = 4.8, 2.5  # of figures over time; chosen: half a sheet's width leaves letters of 7 points


def shown_unit(unit: str) -> tuple[float, str]:
    """Factor to the unit in which a person is shown numbers in `unit`, and it: angles in deg."""
    return (degrees(1), "deg") if unit == "rad" else (1.0, unit)


def colour_of(arm: str) -> str:
    """Colour of an arm: red with compensation, blue for "without"."""
    return WITHOUT if arm == "without" else WITH


@our_style()
def mark_times(figure: Figure, times_s: Sequence[float], text: str) -> None:
    """A dotted line at each of these times [s from release] in every axes; `text` at the first."""
    for axis in figure.axes:
        for i, t_s in enumerate(times_s):
            axis.axvline(t_s, color="0.35", lw=0.9, ls=":")
            if i == 0 and axis is figure.axes[0]:
                top = axis.get_xaxis_transform()
                axis.text(t_s, 0.98, f" {text}", transform=top, va="top", fontsize=9, color="0.35")


def ball_cm(log: Log) -> tuple[np.ndarray, np.ndarray]:
    """Seconds from release (k,) and positions (k, 2) [cm] of the ball's new observations."""
    ball = ball_samples(log)
    return ball.t_s, _CM * ball.xy_m


def _servo(log: Log) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Seconds from release, servo angles (commands where none are measured) and desired angles
    (n, 2) [deg]."""
    run = run_part(log)
    theta = shown_angles(run.rows)
    desired = np.column_stack([run["desired_theta_x_rad"], run["desired_theta_y_rad"]])
    return run["t_s"] - run["t_s"][0], np.degrees(theta), np.degrees(desired)


def servo_word(log: Log) -> str:
    """What a curve of `shown_angles` is: "servo", or "command" where no angle is measured."""
    return "servo" if log.has("theta_x_rad") or not log.has("command_x_rad") else "command"


def _angle_label(log: Log, a: int) -> str:
    return f"{servo_word(log)} {'xy'[a]}\n[deg]"


@our_style()
def save(figure: Figure, folder: Path, name: str, source: str) -> Path:
    """Mark the figure with its source, write NAME.png and NAME.svg, and return the PNG's path.

    source: "simulated" or "measured". OSError: a file cannot be written.
    """
    engine = figure.get_layout_engine()
    if engine is not None:  # room for the mark above everything else
        engine.set(rect=(0, 0, 1, 1 - 0.17 / figure.get_figheight()))  # pyright: ignore
    figure.text(0.995, 0.995, SOURCES[source], ha="right", va="top", fontsize=9, color="0.4")
    # First: letters are widest here, and the places are found for them.
    path = write_figure(figure, folder / f"{name}.png")
    if engine is not None:
        figure.set_layout_engine("none")  # everything has its place: not sought again for the SVG
    write_figure(figure, folder / f"{name}.svg", metadata={"Date": None})
    return path


def ball_over_time(without: Log, with_: Log) -> Figure:
    """Fig. 7: ball position x, y [cm] over time of both arms, with the reference."""
    return _two_axes(_arms(without, with_), with_)


@our_style()
def _two_axes(curves: Sequence[tuple[Log, str, str]], referred: Log) -> Figure:
    """Ball x and y over time, one above the other; the reference is that of `referred`."""
    figure, axes = subplots(2, 1, figsize=TIME_IN, sharex=True)
    for a, axis in enumerate(axes):
        run = run_part(referred)
        reference = _CM * run["target_" + "xy"[a] + "_m"]
        axis.plot(run["t_s"] - run["t_s"][0], reference, "--", color=CENTRE, label="reference")
        for log, colour, label in curves:
            t, xy = ball_cm(log)
            axis.plot(t, xy[:, a], colour, lw=1.1, label=label)
        axis.set_ylabel(f"ball {'xy'[a]}\n[cm]")
    _legend_above(axes[0])
    axes[1].set_xlabel("time from release [s]")
    return figure


def ball_of_run(log: Log, colour: str) -> Figure:
    """Ball position x, y [cm] over time of one run in this colour, with its reference."""
    return _two_axes([(log, colour, "ball")], log)


@our_style()
def servo_of_run(log: Log, colour: str) -> Figure:
    """Servo angles x, y [deg] over time of one run in this colour, with the desired angles."""
    figure, axes = subplots(2, 1, figsize=TIME_IN, sharex=True)
    t, theta, desired = _servo(log)
    for a, axis in enumerate(axes):
        axis.plot(t, theta[:, a], color=colour, lw=1.0, label=servo_word(log))
        axis.plot(t, desired[:, a], "--", color=CENTRE, lw=0.9, label="desired")
        axis.set_ylabel(_angle_label(log, a))
    _legend_above(axes[0])
    axes[1].set_xlabel("time from release [s]")
    return figure


def _legend_above(axis: Axes) -> None:
    """Curves fill the axes: their names stand above in a line, which may be wider than the axes and
    ends where the figure does."""
    axis.set_title(" ", fontsize=8)  # the line's room
    names = axis.legend(
        loc="lower right",
        bbox_to_anchor=(0.99, 1.0),
        bbox_transform=blended_transform_factory(axis.figure.transFigure, axis.transAxes),
        ncols=3,
        fontsize=8,
        frameon=False,
        borderaxespad=0.0,
        handlelength=1.5,
        handletextpad=0.5,
        columnspacing=1.0,
    )
    names.set_in_layout(False)


def _arms(without: Log, with_: Log) -> list[tuple[Log, str, str]]:
    return [(without, WITHOUT, ARMS["without"]), (with_, WITH, ARMS["with"])]


@our_style()
def servo_over_time(without: Log, with_: Log, *, panels: Sequence[str] = ("", "")) -> Figure:
    """Figs. 8 and 11: servo angles (or commands); without blue, with red, desired green and
    alone dashed.

    The desired angle drawn is that of the arm with play compensation (each arm has its own and is
    judged by it). panels: letters of the two axes.
    """
    figure, axes = subplots(2, 1, figsize=TIME_IN, sharex=True)
    for a, axis in enumerate(axes):
        for log, colour, label in _arms(without, with_):
            t, theta, _ = _servo(log)
            axis.plot(t, theta[:, a], color=colour, lw=1.0, label=label)
        t, _, desired = _servo(with_)
        axis.plot(t, desired[:, a], "--", color=CENTRE, lw=0.9, label="desired, with it")
        axis.set_ylabel(_angle_label(with_, a))
        if panels[a]:
            axis.text(1.015, 0.5, panels[a], transform=axis.transAxes, va="center", fontsize=10)
    _legend_above(axes[0])
    axes[1].set_xlabel("time from release [s]")
    return figure


def _plate(axis: Axes, side_cm: float = 27.5) -> None:
    half = side_cm / 2
    axis.set(xlim=(-half - 0.6, half + 0.6), ylim=(-half - 0.6, half + 0.6), aspect="equal")
    axis.plot([-half, half, half, -half, -half], [-half, -half, half, half, -half], "0.6", lw=0.8)
    axis.set(xlabel="x [cm]", ylabel="y [cm]")


def _inset(axis: Axes, size_cm: float, bounds: tuple[float, float, float, float]) -> Axes:
    """A magnified view of the centre."""
    inset = axis.inset_axes(bounds)
    inset.set(xlim=(-size_cm, size_cm), ylim=(-size_cm, size_cm), aspect="equal")
    inset.tick_params(labelsize=9)
    axis.indicate_inset_zoom(inset, edgecolor="0.5")
    return inset


def _wanted(axis: Axes, log: Log, size: float) -> None:
    """The centre, where the ball is wanted, or the way of a target that moves."""
    ball = ball_samples(log)
    if ball.target_moves:
        axis.plot(*(_CM * ball.target_m).T, "--", color=CENTRE, lw=1.4, label="target", zorder=4)
    else:
        axis.plot(0, 0, "o", color=CENTRE, ms=size, label="centre (desired)", zorder=6)


ASIDE_PT = {"without": (14, 26), "with": (-44, -34)}  # of an arm's name from its centroid
# Where both lie on one point, each leaves the other one and the centre seen.
CENTROIDS: dict[str, dict[str, Any]] = {
    "without": {"marker": "s", "ms": 14, "mew": 2.2, "mfc": "none"},
    "with": {"marker": "x", "ms": 11, "mew": 2.6},
}
HALO = [withStroke(linewidth=4.5, foreground="w")]


def _centroid(axis: Axes, arm: str, xy_cm: np.ndarray) -> None:
    """An arm's centroid in its colour: a square without, a cross with."""
    shape = CENTROIDS["without" if arm == "without" else "with"]
    label = f"centroid, {arm}" if arm in CENTROIDS else "centroid"
    axis.plot(
        *xy_cm, color=colour_of(arm), ls="", label=label, zorder=5, path_effects=HALO, **shape
    )


@our_style()
def release_scatter(
    without: Log, with_: Log, centroids_cm: Mapping[str, np.ndarray], side_cm: float = 27.5
) -> Figure:
    """Fig. 10: with = red crosses, without = blue dots, centroids as `_centroid`, centre green.

    centroids_cm: arm -> (2,), empty where the target moves: then without the view of the centre;
    side_cm: side of the plate.
    """
    figure, axis = subplots(figsize=(4.8, 4.6))
    _plate(axis, side_cm)
    views = [(axis, 1.0)]
    if centroids_cm:
        views.append((_inset(axis, 2.5, (0.56, 0.56, 0.42, 0.42)), 1.4))
    for where, size in views:
        xy = ball_cm(without)[1]
        where.plot(*xy.T, ".", color=WITHOUT, ms=2.2 * size, label=ARMS["without"])
        xy = ball_cm(with_)[1]
        where.plot(*xy.T, "x", color=WITH, ms=3 * size, mew=0.6, label=ARMS["with"])
        _wanted(where, with_, 4.5 * size)
        for arm in sorted(centroids_cm, reverse=True):
            _centroid(where, arm, centroids_cm[arm])
    arrow = {"arrowstyle": "-", "lw": 0.6}
    for arm, xy in centroids_cm.items():
        views[-1][0].annotate(
            arm,
            (xy[0], xy[1]),
            xytext=ASIDE_PT[arm],
            textcoords="offset points",
            fontsize=9,
            arrowprops=arrow,
        )
    axis.legend(loc="lower left", fontsize=9)
    return figure


@our_style()
def pushed_scatter(
    log: Log, centroid_cm: np.ndarray | None, arm: str, side_cm: float = 27.5
) -> Figure:
    """Figs. 12 and 13: positions of the pushed ball in the arm's colour, as its centroid; centre
    green dot.

    centroid_cm (2,), None where the target moves; arm: for the legend; side_cm: side of the plate.
    """
    figure, axis = subplots(figsize=(4.8, 4.6))
    _plate(axis, side_cm)
    xy = ball_cm(log)[1]
    axis.plot(*xy.T, ".", color=colour_of(arm), ms=2.6, label=f"ball, {ARMS.get(arm, arm)}")
    _wanted(axis, log, 6)
    if centroid_cm is not None:
        _centroid(axis, arm, centroid_cm)
    axis.legend(loc="lower left", fontsize=9)
    return figure


@our_style()
def eight_runs(without: Sequence[Log], with_: Sequence[Log], size_cm: float = 3.0) -> Figure:
    """Fig. 14: a_1..a_n without (blue), b_1..b_n with (red), as many runs of both arms.

    size_cm: half the side of the square shown about the centre.
    """
    n = len(without)
    figure, axes = subplots(2, n, figsize=(2.0 * n + 0.6, 4.6), sharex=True, sharey=True)
    arms = ((without, "without", "a"), (with_, "with", "b"))
    for row, (logs, arm, letter) in enumerate(arms):
        colour = colour_of(arm)
        for i, log in enumerate(logs):
            axis = axes[row, i]
            axis.plot(*ball_cm(log)[1].T, ".", color=colour, ms=2)
            axis.plot(0, 0, "o", color=CENTRE, ms=5)
            axis.set_title(f"{letter}{chr(0x2081 + i)}", fontsize=11)  # a₁: not mathematics
            axis.set(xlim=(-size_cm, size_cm), ylim=(-size_cm, size_cm), aspect="equal")
        axes[row, 0].set_ylabel("y [cm]")
        axes[row, -1].yaxis.set_label_position("right")
        axes[row, -1].set_ylabel(ARMS[arm], color=colour)
    for axis in axes[1]:
        axis.set_xlabel("x [cm]")
    return figure


@our_style()
def play_map(cells: Sequence[dict], measure: str, title: str, unit: str) -> Figure:
    """Map of the effect (without - with) over gear and joint play, with verdicts.

    cells: {"gear_deg", "joint_deg", measure: dict with effect, low, high, relevant}; unit: of the
    measure, of which angles are shown in degrees.
    """
    gears = sorted({cell["gear_deg"] for cell in cells})
    joints = sorted({cell["joint_deg"] for cell in cells})
    value = np.full((len(joints), len(gears)), np.nan)
    # Colour tells sizes that matter: the scale never ends below twice the relevant size.
    factor, shown = shown_unit(unit)
    matters = factor * max(cell[measure]["relevant"] for cell in cells)
    digits = max(0, ceil(-log10(matters / 10)))  # down to a tenth of what decides the verdict
    largest = factor * max(abs(cell[measure]["effect"]) for cell in cells)
    top = max(largest, 2 * matters)
    # 4 by 4 cells fit a sheet as they are (style.css): 9 points stay 9 points.
    size_in = max(1.35 * len(gears), 2.6) + 1.8, 0.55 * len(joints) + 1.13
    figure, axis = subplots(figsize=size_in)
    for cell in cells:
        i, j = joints.index(cell["joint_deg"]), gears.index(cell["gear_deg"])
        result = cell[measure]
        value[i, j] = factor * result["effect"]
        word = verdict_word(result)
        numbers = (f"{factor * result[key]:+z.{digits}f}" for key in ("effect", "low", "high"))
        text = "{}\n[{}, {}]\n".format(*numbers) + word
        axis.text(j, i, text, ha="center", va="center", fontsize=9)
    image = axis.imshow(value, cmap=HELPS_HURTS, vmin=-top, vmax=top, origin="lower", aspect="auto")
    axis.set_xticks(range(len(gears)), [f"{g:g}" for g in gears])
    axis.set_yticks(range(len(joints)), [f"{g:g}" for g in joints])
    axis.grid(False)
    axis.set(xlabel="gear play [deg at the servo]", ylabel="joint play [deg at the servo]")
    axis.set_title(title, fontsize=9)
    figure.colorbar(image, ax=axis, label=f"without - with [{shown}]\nabove 0: better with")
    return figure


def verdict_word(result: dict) -> str:
    """Verdict on an effect by its interval: "helps", "hurts", "neutral" or "unclear".

    result: fields of `Paired`, as `play_map` gets them. helps, hurts: the whole interval lies
    beyond the relevant size, above or below zero; neutral: it lies within the relevant size on both
    sides; unclear: none of these.
    """
    relevant = result["relevant"]
    if result["low"] > relevant:
        return "helps"
    if result["high"] < -relevant:
        return "hurts"
    if -relevant < result["low"] and result["high"] < relevant:
        return "neutral"
    return "unclear"


@our_style()
def play_estimates(logs: Sequence[Log], truth_deg: Mapping[str, float]) -> Figure:
    """Estimated gear and joint play of both axes [deg, full width] over time, with 2 sigma bands.

    truth_deg: true play of the table for "gear" and "joint".
    """
    figure, axes = subplots(1, 2, figsize=(6.8, 2.8), sharex=True, sharey=True)
    for axis, place in zip(axes, ("gear", "joint"), strict=True):
        for log in logs:
            run = run_part(log)
            t = run["t_s"] - run["t_s"][0]
            for a, colour in zip("xy", ("#7b3294", "#e08214"), strict=True):
                width = np.degrees(run[f"estimated_{place}_play_{a}_rad"])
                std = np.degrees(run[f"estimated_{place}_play_std_{a}_rad"])
                axis.plot(t, width, color=colour, lw=1, label=f"estimate {a}, ± 2 std")
                axis.fill_between(t, width - 2 * std, width + 2 * std, color=colour, alpha=0.15)
        axis.axhline(truth_deg[place], color="k", ls=":", lw=1, label="true")
        axis.set(xlabel="time from release [s]", ylim=(0.0, 2 * max(truth_deg.values()) + 1))
        axis.set_title(f"{place} play", fontsize=9)
    axes[0].set_ylabel("full width [deg at the servo]")
    axes[0].legend(fontsize=9, loc="upper right")
    return figure
