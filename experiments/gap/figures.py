"""The pictures of a gap report, each one plain function of the findings; PNG files.

Gaps are in noise floors: the line at 1 is a perfect model. Angles in degrees, lengths in mm.
"""

from collections.abc import Sequence
from math import ceil
from pathlib import Path
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullLocator

from calibration.gap.findings import PlateMap, Profile, ProofRow, RankedEffect, Step
from calibration.gap.report.units import effect_words, shown_unit, sig
from experiments.gap.words import channel_words, percent
from experiments.picture_files import (
    SHEET_HIGH_IN,
    SHEET_WIDE_IN,
    our_style,
    subplots,
    write_figure,
)
from experiments.reports.figures import CENTRE, WITH
from rig.parameters import CHANNELS

# x purple and y orange, as in the dashboard's curves; the ball's paler. Red and blue are the
# controllers' (with and without play compensation).
COLOURS: dict[str, str] = dict(
    zip(CHANNELS, ("#5f3dc4", "#cf4708", "#b197fc", "#ffa94d"), strict=True)
)
STYLES: dict[str, str] = dict(zip(CHANNELS, ("-", "--", "-", "--"), strict=True))
LOG_BEYOND = 8.0  # gaps that differ by more are drawn on a logarithmic axis
SHOWN_NAMES = 10
# Chosen: with more bars than that their values stand upright; letters in a line of a label.
MOST_LEVEL, LABEL_LETTERS, NARROW_LETTERS = 16, 36, 10
LINE_LETTERS, MOST_NUMBERS = 76, 25  # across a figure; chosen: they do not touch
SMALL = 9  # points


def save(figure: Figure, folder: Path, name: str) -> Path:
    """Write the figure as NAME.png in `folder` and return the file's path.

    OSError: the file cannot be written.
    """
    return write_figure(figure, folder / f"{name}.png", bbox_inches="tight", pad_inches=0.08)


def _floor_line(axis: Axes) -> None:
    axis.axhline(1.0, color=CENTRE, lw=1.2, ls=":", label="perfect model (1.0)")


def _gap_scale(axis: Axes, largest: float) -> None:
    """A gap axis that starts below the floor; logarithmic where gaps differ much."""
    if largest > LOG_BEYOND:
        axis.set_yscale("log")
        axis.set_ylim(0.7, 1.25 * largest)
        ticks = [t for t in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000) if t <= 1.25 * largest]
        axis.set_yticks(ticks)
        axis.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
        axis.yaxis.set_minor_locator(NullLocator())
    else:
        axis.set_ylim(0, 1.12 * max(largest, 1.2))


def _largest(profiles: Sequence[Profile]) -> float:
    values = np.concatenate([p.gap for p in profiles])
    values = values[np.isfinite(values)]
    return float(values.max()) if len(values) else 1.0


def _curve(axis: Axes, profile: Profile, factor: float) -> None:
    """One channel's gap as steps; a bin without samples is a hole."""
    axis.stairs(
        profile.gap,
        factor * np.asarray(profile.edges),
        baseline=None,
        color=COLOURS.get(profile.channel, "0.3"),
        ls=STYLES.get(profile.channel, "-"),
        lw=1.5,
        label=channel_words(profile.channel),
    )


def _runs(axis: Axes, profile: Profile, names: Sequence[str]) -> None:
    """An upright line where each run but the first begins, and the runs' names above; their numbers
    where a name has no room."""
    limits = np.append(profile.starts_s, profile.edges[-1])
    shares = np.diff(limits) / limits[-1]
    for start in limits[1:-1]:
        axis.axvline(start, color="0.3", lw=1.2)
    every = ceil(len(shares) / MOST_NUMBERS)
    labels = [str(i + 1) if i % every == 0 else "" for i in range(len(shares))]
    if len(names) == len(shares) and LINE_LETTERS * shares.min() >= NARROW_LETTERS:
        pairs = zip(names, shares, strict=True)
        labels = [fill(name, int(LINE_LETTERS * share)) for name, share in pairs]
    above = axis.secondary_xaxis("top")
    above.set_xticks((limits[1:] + limits[:-1]) / 2, labels)
    above.tick_params(length=0)


@our_style()
def over_time(profiles: Sequence[Profile], names: Sequence[str] = ()) -> Figure:
    """Gap of every channel [noise floors] over the time of the logs [s], as steps, one run after
    the other.

    profiles: those whose quantity is the time; names: of the runs.
    """
    figure, axis = subplots(figsize=(SHEET_WIDE_IN, 2.9))
    for profile in profiles:
        _curve(axis, profile, 1.0)
    _floor_line(axis)
    _gap_scale(axis, _largest(profiles))
    axis.set(xlabel="time [s]", ylabel="gap [noise floors]")
    if len(profiles[0].starts_s) > 1:
        _runs(axis, profiles[0], names)
    figure.legend(loc="outside upper center", ncols=5, frameon=False)
    return figure


@our_style()
def over_state(profiles: Sequence[Profile]) -> Figure:
    """Gap of one side's channels [noise floors] over each quantity of the table's state.

    One panel for each quantity of the profiles: position, speed, direction, reversals, voltage.
    """
    panels: dict[tuple[str, str], list[Profile]] = {}
    for profile in profiles:
        panels.setdefault((profile.quantity, profile.unit), []).append(profile)
    columns = 2 if len(panels) == 4 else min(3, len(panels))
    rows = ceil(len(panels) / columns)
    figure, axes = subplots(
        rows, columns, figsize=(SHEET_WIDE_IN, SHEET_HIGH_IN / 2 * rows), squeeze=False
    )
    for axis in axes.flat[len(panels) :]:
        axis.set_axis_off()
    largest = _largest(profiles)
    for axis, ((_, unit), curves) in zip(axes.flat, panels.items(), strict=False):
        _panel(axis, unit, curves)
        _gap_scale(axis, largest)
    figure.supylabel("gap [noise floors]", fontsize="medium")
    handles = {}
    for axis in axes.flat:
        handles |= {label: h for h, label in zip(*axis.get_legend_handles_labels(), strict=True)}
    figure.legend(
        handles.values(), handles.keys(), loc="outside upper center", ncols=5, frameon=False
    )
    return figure


def _panel(axis: Axes, unit: str, curves: Sequence[Profile]) -> None:
    shown, factor = shown_unit(unit)
    quantity = curves[0].quantity
    if quantity == "after reversal":
        quantity = "time since the last reversal"
    for profile in curves:
        _curve(axis, profile, factor)
    _floor_line(axis)
    axis.set_xlabel(f"{quantity} [{shown}]" if shown else quantity)
    if quantity == "direction":
        edges = np.asarray(curves[0].edges, float)
        words = {2: ("backwards", "forwards"), 3: ("backwards", "still", "forwards")}
        if len(edges) - 1 in words:
            axis.set_xticks((edges[1:] + edges[:-1]) / 2, words[len(edges) - 1])


@our_style()
def plate_map(found: PlateMap) -> Figure:
    """Mean innovation of the ball over the plate, one panel for x and y each [noise floors].

    Cells without samples are grey.
    """
    figure, axes = subplots(1, 2, figsize=(SHEET_WIDE_IN, SHEET_HIGH_IN), sharey=True)
    mean = np.where(np.asarray(found.count)[..., None] > 0, found.mean, np.nan)
    finite = mean[np.isfinite(mean)]
    top = max(1.0, float(np.abs(finite).max())) if len(finite) else 1.0
    mesh = None
    for a, axis in enumerate(axes):
        axis.set_facecolor("0.88")
        mesh = axis.pcolormesh(
            100 * found.x_edges,
            100 * found.y_edges,
            mean[..., a],
            cmap="RdBu_r",
            vmin=-top,
            vmax=top,
        )
        axis.set(xlabel="ball x [cm]", aspect="equal", title=f"ball {'xy'[a]}")
        axis.grid(False)
    axes[0].set_ylabel("ball y [cm]")
    if mesh is not None:
        figure.colorbar(mesh, ax=axes, label="mean error [noise floors]", shrink=0.85)
    return figure


@our_style()
def ranking(candidates: Sequence[RankedEffect], accepted: Sequence[str]) -> Figure:
    """Probability [%] of the SHOWN_NAMES likeliest effects, as bars.

    Effects named in `accepted` are coloured; those that were refused say so in place of a bar.
    """
    shown = sorted(candidates, key=lambda c: (-c.probability, not c.refused, -c.score))
    shown = shown[:SHOWN_NAMES]
    figure, axis = subplots(figsize=(SHEET_WIDE_IN, 0.36 * len(shown) + 1.0))
    for row, c in enumerate(shown):
        colour = WITH if c.name in accepted else "0.6"
        axis.barh(row, 100 * c.probability, color=colour, height=0.7)
        text = "refused, see the notes" if c.refused else percent(c.probability)
        axis.text(100 * c.probability + 1.2, row, text, va="center", fontsize=SMALL)
    labels = [c.name + (f" = {' = '.join(c.twins)}" if c.twins else "") for c in shown]
    axis.set_yticks(range(len(shown)), [_wrapped(effect_words(label)) for label in labels])
    axis.set(xlabel="probability [%]", xlim=(0, 130), xticks=range(0, 101, 20))
    axis.invert_yaxis()
    axis.grid(axis="y", visible=False)
    return figure


def _wrapped(label: str, width: int = 38) -> str:
    """A long class of twins in two lines."""
    if len(label) <= width:
        return label
    cut = label.rfind(" = ", 0, width)
    return label if cut < 0 else f"{label[: cut + 2]}\n{label[cut + 3 :]}"


@our_style()
def shrinking(steps: Sequence[Step]) -> Figure:
    """Gap of every channel [noise floors] after each added effect, as groups of bars."""
    figure, axis = subplots(figsize=(SHEET_WIDE_IN, SHEET_HIGH_IN))
    channels = [c for c in CHANNELS if any(c in step.gap for step in steps)]
    at = np.arange(len(steps))
    width = 0.8 / max(len(channels), 1)
    largest = max((v for step in steps for v in step.gap.values() if np.isfinite(v)), default=1.0)
    _gap_scale(axis, largest)
    bottom = axis.get_ylim()[0]
    upright = len(steps) * len(channels) > MOST_LEVEL
    for i, channel in enumerate(channels):
        gaps = np.array([step.gap.get(channel, np.nan) for step in steps])
        where = at + (i - (len(channels) - 1) / 2) * width
        axis.bar(
            where,
            gaps - bottom,
            width * 0.9,
            bottom=bottom,
            color=COLOURS[channel],
            label=channel_words(channel),
        )
        for x, gap in zip(where, gaps, strict=True):
            if np.isfinite(gap):
                axis.text(
                    x,
                    gap,
                    " " + _three_digits(gap),
                    ha="center",
                    va="bottom",
                    rotation=90 if upright else 0,
                    fontsize=SMALL,
                )
    _floor_line(axis)
    labels = [_step_label(step.added, len(steps)) for step in steps]
    axis.set_xticks(at, labels, fontsize=SMALL)
    axis.set_xlim(-0.5, len(steps) - 0.5)
    axis.set_ylabel("gap [noise floors]")
    axis.grid(axis="x", visible=False)
    axis.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=5, frameon=False)
    _make_room(figure, axis)
    return figure


def _three_digits(gap: float) -> str:
    """A gap in three digits or more, without a power of ten: 1.25, 12.5, 1250."""
    return f"{gap:.2f}" if gap < 10 else f"{gap:.1f}" if gap < 100 else f"{gap:.0f}"


def _make_room(figure: Figure, axis: Axes) -> None:
    """Raise the upper end of an axis of values until the texts above its bars lie inside."""
    figure.draw_without_rendering()  # places the axis and measures the texts
    frame, scale = axis.get_window_extent(), axis.yaxis.get_transform()
    low, high = scale.transform(axis.get_ylim())
    for text in axis.texts:
        value = scale.transform([text.get_position()[1]])[0]
        share = 1.2 * text.get_window_extent().height / frame.height  # with a gap above; chosen
        high = max(high, low + (value - low) / (1.0 - share))
    axis.set_ylim(top=scale.inverted().transform([high])[0])


def _step_label(added: str, steps: int) -> str:
    """What a step added, in narrow lines where there are many steps."""
    if not added:
        return "model\nas it came"
    label = "+ " + effect_words(added).replace(" + ", "\n+ ")
    if steps <= 4:
        return label
    letters = min(NARROW_LETTERS, LINE_LETTERS // steps)
    lines = [fill(line, letters, break_long_words=False) for line in label.splitlines()]
    return "\n".join(lines)


@our_style()
def ahead(rows: Sequence[ProofRow], floor_mm: float | None) -> Figure:
    """RMS error of the ball one second ahead [mm] of each model, on held-out data, as bars.

    floor_mm: error of a perfect model, drawn as a line; None where it is not known. Models without
    this error are left out.
    """
    shown = [row for row in rows if row.ahead_1s_mm is not None]
    labels = [fill(effect_words(row.model), LABEL_LETTERS) for row in shown]
    lines = max((label.count("\n") + 1 for label in labels), default=1)
    each = max(0.42, 0.19 * lines)  # inches
    figure, axis = subplots(figsize=(SHEET_WIDE_IN, each * len(shown) + 1.1))
    values = [float(row.ahead_1s_mm or 0.0) for row in shown]
    colours = [WITH if row.model.startswith("named") else "0.6" for row in shown]
    axis.barh(range(len(shown)), values, color=colours, height=0.65)
    top = max([*values, floor_mm or 0.0])
    for i, value in enumerate(values):
        axis.text(value + 0.01 * top, i, f"{sig(value)} mm", va="center", fontsize=SMALL)
    if floor_mm is not None:
        axis.axvline(floor_mm, color=CENTRE, ls=":", lw=1.4, label=f"floor {sig(floor_mm)} mm")
        axis.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
    axis.set_yticks(range(len(shown)), labels)
    axis.set(xlabel="error 1 s ahead, ball [mm RMS]", xlim=(0, 1.18 * top or 1))
    axis.invert_yaxis()
    axis.grid(axis="y", visible=False)
    return figure
