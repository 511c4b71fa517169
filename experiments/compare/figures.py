"""Figures of a comparison: map, intervals, a telling case, one crossing, what was learnt."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.ticker import MaxNLocator

from experiments.compare.case import Case
from experiments.compare.statistics import HARMS, HELPS
from experiments.compare.words import conditions as conditions_of
from experiments.picture_files import SHEET_HIGH_IN, SHEET_WIDE_IN, our_style, subplots
from experiments.reports.figures import HELPS_HURTS, ball_cm, save, servo_word
from rig.log import Log, shown_angles

COLOURS = {"without": "#1f4fd8", "with": "#d62728", "adaptive": "#9467bd", "neural": "#2ca02c",
           "hybrid": "#ff7f0e", "disturbance": "#8c564b", "smooth": "#17becf",
           "adaptive-asymmetric": "#e377c2", "sham": "0.6", "misplaced": "0.4",
           "lqg": "#bcbd22", "mpc": "#393b79"}  # fmt: skip


PANELS = 8  # in a line; chosen: the shipped grid's plays


@our_style()
def map_figure(results: Mapping, out: Path) -> Path:
    """Draw the gain over no compensator [cm] of every condition in every cell; returns the PNG
    file's path.

    results: as of `run_comparison`. Bold: the sign is certain after Holm's correction; "lost": no
    mean gain is known. OSError: `out` cannot be written.
    """
    conditions, cells = conditions_of(results["cells"]), results["cells"]
    gain = np.array(
        [[c["arms"][a]["against_without"]["effect"] for a in conditions] for c in cells]
    )
    names = [c["key"].replace(" | ", " · ") for c in cells]
    # As narrow as its numbers and names are: a sheet is half as wide, and shows them half as large.
    wide = 0.6 + 0.077 * max(map(len, names)) + 0.48 * len(conditions)
    high = 1.5 + 0.045 * max(map(len, conditions)) + 0.21 * len(cells)
    figure, ax = subplots(figsize=(wide, high))
    image = ax.imshow(gain, cmap=HELPS_HURTS, vmin=-1.0, vmax=1.0, aspect="auto")
    for i, cell in enumerate(cells):
        for j, condition in enumerate(conditions):
            verdict = cell["arms"][condition]["against_without"]["verdict"]
            sure = verdict in (HELPS, HARMS)
            known = bool(np.isfinite(gain[i, j]))  # else the field is white
            text = f"{gain[i, j]:+z.2f}" if known else "lost"
            weight, style = ("bold", "normal") if sure else ("normal", "italic")
            ax.text(
                j,
                i,
                text,
                ha="center",
                va="center",
                fontsize=9,
                weight=weight,
                style=style,
            )
    ax.set_xticks(range(len(conditions)), conditions, rotation=30, ha="left")
    ax.xaxis.tick_top()
    ax.set_yticks(range(len(cells)), names, fontsize=9)
    ax.grid(False)
    bar = figure.colorbar(image, location="bottom", aspect=40, pad=0.01, extend="both")
    bar.set_ticks([-1.0, -0.5, 0.0, 0.5, 1.0])
    bar.set_label("gain over no compensator [cm RMS]\ngreen-blue helps, brown harms", fontsize=9)
    return save(figure, out, "compare_map", "simulated")


@our_style()
def effect_figure(results: Mapping, out: Path) -> Path:
    """Draw gains [cm] with 95 % intervals, one panel for each play; returns the PNG file's path.

    results: as of `run_comparison`, of which the cells of the first friction and protocol, without
    a fault, are drawn. OSError: `out` cannot be written.
    """
    first = next(iter(results["grid"]["frictions"]))
    cells = [c for c in results["cells"] if c["friction"] == first and not c["fault"]]
    cells = [c for c in cells if c["protocol"] == cells[0]["protocol"]]
    conditions = conditions_of(results["cells"])
    columns = min(PANELS, len(cells))
    lines = -(-len(cells) // columns)
    figure, axes = subplots(
        lines,
        columns,
        figsize=(SHEET_WIDE_IN, 1.0 + 0.15 * len(conditions) * lines),
        sharex=True,
        sharey=True,
        squeeze=False,
    )
    for ax in axes.flat[len(cells) :]:
        ax.set_visible(False)
    for ax, cell in zip(axes.flat, cells, strict=False):
        for j, condition in enumerate(conditions):
            t = cell["arms"][condition]["against_without"]
            colour = COLOURS.get(condition, "black")
            if np.isfinite(t["effect"]):
                ax.plot([t["low"], t["high"]], [j, j], color=colour, lw=2)
                ax.plot(t["effect"], j, "o", color=colour, ms=4)
        relevant = cell["arms"][conditions[0]]["against_without"]["relevant"]
        ax.axvspan(-relevant, relevant, color="0.85", zorder=0)
        ax.set_title(cell["play"].replace(", ", ",\n"), fontsize=9)
        ax.set_yticks(range(len(conditions)), conditions, fontsize=9)
        ax.tick_params("x", labelsize=9)
    axes[0, 0].set_ylim(len(conditions) - 0.5, -0.5)
    axes[0, 0].xaxis.set_major_locator(MaxNLocator(2 if columns > 4 else 3, steps=[1, 2, 5, 10]))
    figure.supxlabel("gain over no compensator [cm RMS], right: it helps", fontsize=9)
    return save(figure, out, "compare_effects", "simulated")


def _seconds(log: Log) -> np.ndarray:
    return log["t_s"]


@our_style()
def case_figure(case: Case, out: Path) -> Path:
    """Draw ball [cm] and servo [deg] over time on axis x, one row for each condition; returns the
    PNG file's path. OSError: `out` cannot be written.
    """
    figure, axes = subplots(
        len(case.runs),
        2,
        figsize=(SHEET_WIDE_IN, min(0.6 + 0.62 * len(case.runs), SHEET_HIGH_IN)),
        sharex=True,
        sharey="col",
        squeeze=False,
    )
    for (condition, run), (left, right) in zip(case.runs.items(), axes, strict=True):
        t, xy = ball_cm(run.log)
        colour = COLOURS.get(condition, "black")
        left.plot(t, xy[:, 0], color=colour, lw=0.9)
        name = condition.replace("-", "-\n")
        left.set_ylabel(name, fontsize=9, rotation=0, ha="right", va="center")
        angle = np.degrees(shown_angles(run.log.rows)[:, 0])
        right.plot(_seconds(run.log), angle, color=colour, lw=0.7)
        axes[0, 1].set_title(f"{servo_word(run.log)} [deg]", fontsize=9)
    axes[0, 0].set_title("ball x [cm]", fontsize=9)
    for ax in axes.flat:
        ax.yaxis.set_major_locator(MaxNLocator(2, steps=[1, 2, 5, 10]))
        ax.tick_params("y", labelsize=9)
    for ax in axes[:-1].flat:
        ax.tick_params("x", length=0)
    for ax in axes[-1]:
        ax.set_xlabel("t [s]")
    return save(figure, out, "compare_case", "simulated")


@our_style()
def crossing_figure(case: Case, out: Path) -> Path:
    """Draw one reversal of up to four conditions: wanted, reference, servo and plate [deg]; returns
    the PNG file's path. OSError: `out` cannot be written.
    """
    conditions = [condition for condition in case.runs if condition != "adaptive-asymmetric"][:4]
    figure, axes = subplots(
        1, len(conditions), figsize=(SHEET_WIDE_IN, 2.9), sharex=True, sharey=True, squeeze=False
    )
    for ax, condition in zip(axes[0], conditions, strict=True):
        run = case.runs[condition]
        part = _reversal(run.log)
        t = run.log["t_s"][part] - run.log["t_s"][part][0]
        for values, label, colour, style in (
            (run.log["desired_theta_x_rad"], "wanted", "#1a9641", "--"),
            (run.reference_rad, "reference", "0.5", "-"),
            (
                shown_angles(run.log.rows)[:, 0],
                f"{servo_word(run.log)} (coloured)",
                COLOURS.get(condition, "black"),
                "-",
            ),
            (run.plate_rad, "plate", "black", "-"),
        ):
            ax.plot(t, np.degrees(values[part]), style, color=colour, label=label, lw=1.1)
        ax.set_title(condition, fontsize=9)
        ax.set_xlabel("t [s]")
    axes[0, 0].set_xticks([0.0, 0.5, 1.0])
    axes[0, 0].set_ylabel("angle at the servo [deg]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=9)
    return save(figure, out, "compare_crossing", "simulated")


def _reversal(log: Log, before_s: float = 0.3, after_s: float = 0.7) -> slice:
    """About the fastest fall of the wanted angle through zero in the last half."""
    wanted, t = log["desired_theta_x_rad"], log["t_s"]
    tick = float(np.median(np.diff(t)))
    smooth = np.convolve(wanted, np.ones(50) / 50, "same")
    half = len(smooth) // 2
    ends = np.flatnonzero((smooth[half:-1] > 0) & (smooth[half + 1 :] <= 0)) + half
    room = [k for k in ends if before_s / tick < k < len(t) - after_s / tick]
    at = min(room, key=lambda k: smooth[k + 25] - smooth[k - 25]) if room else half
    return slice(max(0, at - round(before_s / tick)), at + round(after_s / tick))


@our_style()
def convergence_figure(case: Case, out: Path) -> Path:
    """Draw the two break points of the backlash [deg] over time, estimated and true; returns the
    PNG file's path.

    The estimates are those of the adaptive inverses and of the observer of "with". OSError: `out`
    cannot be written.
    """
    figure, ax = subplots(figsize=(6.5, 3.0))
    for condition in ("adaptive", "adaptive-asymmetric"):
        if condition in case.runs:
            t, c = case.runs[condition].log["t_s"], np.degrees(case.runs[condition].believed_rad)
            ax.plot(t, c[:, 0], color=COLOURS[condition], lw=1, label=condition)
            ax.plot(t, c[:, 1], color=COLOURS[condition], lw=1)
    if "with" in case.runs:
        log = case.runs["with"].log
        half = np.degrees(log["estimated_joint_play_x_rad"]) / 2
        ax.plot(log["t_s"], half, color=COLOURS["with"], lw=1, label="with (observer)")
        ax.plot(log["t_s"], -half, color=COLOURS["with"], lw=1)
    for side in (1, -1):
        true = np.degrees(case.offset_rad + side * case.joint_rad / 2)
        ax.axhline(true, color="black", ls="--", lw=0.8)
    ax.set_xlabel("t [s]")
    ax.set_ylabel("break points [deg]")
    ax.legend(fontsize=9)
    return save(figure, out, "compare_convergence", "simulated")
