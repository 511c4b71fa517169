"""Figures of a comparison: map, intervals, a telling case, one crossing, what was learnt."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from experiments.compare_case import Case
from experiments.compare_statistics import HARMS, HELPS
from experiments.figures import ball_cm, plt, save
from rig.log import Log

COLOURS = {"without": "#1f4fd8", "with": "#d62728", "adaptive": "#9467bd", "neural": "#2ca02c",
           "hybrid": "#ff7f0e", "disturbance": "#8c564b", "smooth": "#17becf",
           "adaptive-asymmetric": "#e377c2", "sham": "0.6", "misplaced": "0.4"}  # fmt: skip


def _arms(results: Mapping) -> list[str]:
    return [a for a, found in results["cells"][0]["arms"].items() if "against_without" in found]


def map_figure(results: Mapping, out: Path) -> Path:
    """Arms x cells: gain over no cure, its sign sure or not."""
    arms, cells = _arms(results), results["cells"]
    gain = np.array([[c["arms"][a]["against_without"]["effect"] for a in arms] for c in cells])
    figure, ax = plt.subplots(figsize=(2.6 + 0.95 * len(arms), 1.4 + 0.24 * len(cells)))
    image = ax.imshow(gain, cmap="RdYlGn", vmin=-1.0, vmax=1.0, aspect="auto")
    for i, cell in enumerate(cells):
        for j, arm in enumerate(arms):
            verdict = cell["arms"][arm]["against_without"]["verdict"]
            sure = verdict in (HELPS, HARMS)
            text = f"{gain[i, j]:+.2f}" if np.isfinite(gain[i, j]) else "lost"
            weight, colour = ("bold", "black") if sure else ("normal", "0.45")
            ax.text(j, i, text, ha="center", va="center", fontsize=7, weight=weight, color=colour)
    ax.set_xticks(range(len(arms)), arms, rotation=30, ha="left")
    ax.xaxis.tick_top()
    ax.set_yticks(range(len(cells)), [c["key"] for c in cells], fontsize=7)
    ax.grid(False)
    figure.colorbar(image, label="gain over no cure [cm RMS]", shrink=0.5)
    return save(figure, out, "compare_map", "simulated")


def effect_figure(results: Mapping, out: Path) -> Path:
    """Gains with 95 % intervals, a panel a cell of the first friction, held at the centre."""
    first = next(iter(results["grid"]["frictions"]))
    cells = [c for c in results["cells"] if c["friction"] == first and not c["fault"]]
    cells = [c for c in cells if c["protocol"] == cells[0]["protocol"]]
    arms = _arms(results)
    columns = min(4, len(cells))
    lines = -(-len(cells) // columns)
    figure, axes = plt.subplots(lines, columns, figsize=(3.1 * columns, 0.8 + 2.3 * lines),
                                sharex=True, sharey=True, squeeze=False)  # fmt: skip
    for ax in axes.flat[len(cells) :]:
        ax.set_visible(False)
    for ax, cell in zip(axes.flat, cells, strict=False):
        for j, arm in enumerate(arms):
            t = cell["arms"][arm]["against_without"]
            colour = COLOURS.get(arm, "black")
            if np.isfinite(t["effect"]):
                ax.plot([t["low"], t["high"]], [j, j], color=colour, lw=2)
                ax.plot(t["effect"], j, "o", color=colour, ms=4)
        relevant = cell["arms"][arms[0]]["against_without"]["relevant"]
        ax.axvspan(-relevant, relevant, color="0.85", zorder=0)
        ax.set_title(cell["play"], fontsize=9)
        ax.set_yticks(range(len(arms)), arms)
    axes[0, 0].invert_yaxis()
    figure.supxlabel("gain over no cure [cm RMS], right: the arm helps", fontsize=9)
    return save(figure, out, "compare_effects", "simulated")


def _seconds(log: Log) -> np.ndarray:
    return log["t_s"]


def case_figure(case: Case, out: Path) -> Path:
    """Ball and servo over time, a row an arm, axis x."""
    figure, axes = plt.subplots(len(case.runs), 2, figsize=(9, 1.6 * len(case.runs)), sharex=True,
                                sharey="col", squeeze=False)  # fmt: skip
    for (arm, run), (left, right) in zip(case.runs.items(), axes, strict=True):
        t, xy = ball_cm(run.log)
        colour = COLOURS.get(arm, "black")
        left.plot(t, xy[:, 0], color=colour, lw=0.9)
        left.set_ylabel(f"{arm}\nball x [cm]", fontsize=8)
        right.plot(_seconds(run.log), np.degrees(run.log["theta_x_rad"]), color=colour, lw=0.7)
        right.set_ylabel("servo [deg]", fontsize=8)
    for ax in axes[-1]:
        ax.set_xlabel("t [s]")
    return save(figure, out, "compare_case", "simulated")


def crossing_figure(case: Case, out: Path) -> Path:
    """One reversal of each arm: what was wanted, the reference, the servo, the plate."""
    arms = [arm for arm in case.runs if arm != "adaptive-asymmetric"][:4]
    figure, axes = plt.subplots(1, len(arms), figsize=(2.9 * len(arms), 2.9), sharey=True,
                                squeeze=False)  # fmt: skip
    for ax, arm in zip(axes[0], arms, strict=True):
        run = case.runs[arm]
        part = _reversal(run.log)
        t = run.log["t_s"][part] - run.log["t_s"][part][0]
        for values, label, colour, style in (
            (run.log["desired_theta_x_rad"], "wanted", "#1a9641", "--"),
            (run.reference_rad, "reference", "0.5", "-"),
            (run.log["theta_x_rad"], "servo", COLOURS.get(arm, "black"), "-"),
            (run.plate_rad, "plate", "black", "-"),
        ):
            ax.plot(t, np.degrees(values[part]), style, color=colour, label=label, lw=1.1)
        ax.set_title(arm, fontsize=9)
        ax.set_xlabel("t [s]")
    axes[0, 0].set_ylabel("angle at the servo [deg]")
    axes[0, 0].legend(fontsize=7)
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


def convergence_figure(case: Case, out: Path) -> Path:
    """What the adaptive inverses and the observer of the arm "with" believe, over time."""
    figure, ax = plt.subplots(figsize=(6.5, 3.0))
    for arm in ("adaptive", "adaptive-asymmetric"):
        if arm in case.runs:
            t, c = case.runs[arm].log["t_s"], np.degrees(case.runs[arm].believed_rad)
            ax.plot(t, c[:, 0], color=COLOURS[arm], lw=1, label=arm)
            ax.plot(t, c[:, 1], color=COLOURS[arm], lw=1)
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
    ax.legend(fontsize=7)
    return save(figure, out, "compare_convergence", "simulated")
