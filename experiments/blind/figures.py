"""Figures of the blind trials: the confusion matrix and the power curves."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.picture_files import write_figure

VERDICTS = ("several", "undecided", "unknown-effect", "nothing-missing", "failed")
COLOURS = {"steps": "tab:blue", "battery": "tab:orange"}


def confusion_figure(table: Mapping[str, Mapping[str, int]], path: Path) -> Path:
    """Draw the confusion matrix of `score_summary.confusion`: a row per hidden effect.

    Columns are answers; cells hold counts, their shade is the share of the row. Returns `path`.
    OSError: it cannot be written. ValueError: no such image format.
    """
    from matplotlib.figure import Figure

    hidden = list(table)
    stated = {name for row in table.values() for name in row}
    names = [*hidden, *sorted(stated - set(hidden) - set(VERDICTS))]
    columns = [*names, *(v for v in VERDICTS if v in stated)]
    counts = np.array([[table[h].get(c, 0) for c in columns] for h in hidden], float)
    counts = counts.reshape(len(hidden), len(columns))
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    figure = Figure((3 + 0.36 * len(columns), 2.6 + 0.3 * len(hidden)), layout="constrained")
    axes = figure.subplots()
    axes.imshow(shares, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for i, j in np.argwhere(counts > 0):
        dark = shares[i, j] > 0.5
        wrong = columns[j] != hidden[i]
        colour = "white" if dark else "firebrick" if wrong else "black"
        axes.text(j, i, f"{counts[i, j]:.0f}", ha="center", va="center", color=colour, fontsize=9)
    axes.set_xticks(range(len(columns)), [c.replace("_", " ") for c in columns], rotation=90)
    axes.set_yticks(range(len(hidden)), [h.replace("_", " ") for h in hidden])
    axes.axvline(len(names) - 0.5, color="grey", linewidth=0.8)
    axes.set_xlabel("answered")
    axes.set_ylabel("hidden")
    axes.set_title(f"One hidden effect, {int(counts.sum())} trials")
    return write_figure(figure, path, dpi=130)


def power_figure(cells: Sequence[Mapping[str, Any]], path: Path) -> Path:
    """Draw the power curves (`score_summary.power`), one panel per effect; return `path`.

    Over the amplitude, in multiples of the smallest that counts: the share detected (line, with 95
    % intervals as bars), the share rightly named (dots) and the share wrongly named (red crosses).
    Left of the dashed line at 1.5 only a wrong name counts against the method. OSError: `path`
    cannot be written. ValueError: no such image format.
    """
    from matplotlib.figure import Figure

    effects = list(dict.fromkeys(cell["effect"] for cell in cells))
    wide = min(5, max(len(effects), 1))
    high = max(1, -(-len(effects) // wide))
    figure = Figure((2.6 * wide, 2.0 * high + 0.6), layout="constrained")
    grid = np.atleast_1d(np.asarray(figure.subplots(high, wide, sharex=True, sharey=True))).ravel()
    for axes, effect in zip(grid, effects, strict=False):
        for protocol in dict.fromkeys(c["protocol"] for c in cells if c["effect"] == effect):
            own = [c for c in cells if (c["effect"], c["protocol"]) == (effect, protocol)]
            _curve(axes, sorted(own, key=lambda c: c["from"]), protocol)
        axes.axvline(1.5, color="grey", linestyle="--", linewidth=0.8)
        axes.set_title(effect.replace("_", " "), fontsize=9)
        axes.set(xscale="log", ylim=(-0.05, 1.05), xlim=(0.13, 7.0))
        axes.set_xticks([0.2, 0.5, 1, 2, 5], ["0.2", "0.5", "1", "2", "5"])
        axes.minorticks_off()
    for axes in grid[len(effects) :]:
        axes.set_visible(False)
    handles = {
        h.get_label(): h for axes in grid for h in axes.get_lines() if h.get_label()[0] != "_"
    }
    figure.legend(handles.values(), handles.keys(), loc="outside upper center", ncols=4, fontsize=9)
    figure.supxlabel("amplitude over the smallest that counts", fontsize=9)
    figure.supylabel("share of trials", fontsize=9)
    return write_figure(figure, path, dpi=130)


def _curve(axes: Any, cells: Sequence[Mapping[str, Any]], protocol: str) -> None:
    """One protocol's shares in one panel."""
    aside = 1.06 if protocol == "battery" else 1.0  # so that two bars do not hide each other
    x = aside * np.array([np.sqrt(c["from"] * c["to"]) for c in cells])
    seen = [c["detected"] for c in cells]
    value = np.array([s["value"] for s in seen])
    ends = np.array([[s["value"] - s["low"], s["high"] - s["value"]] for s in seen]).T
    colour = COLOURS.get(protocol, "tab:green")
    axes.errorbar(x, value, np.maximum(ends, 0), color=colour, linewidth=1.2, elinewidth=0.6)
    axes.plot([], [], color=colour, label=f"detected, {protocol}")
    right = [c["right"]["value"] for c in cells]
    axes.plot(x, right, "o", color=colour, markersize=3, label=f"right name, {protocol}")
    wrong = [c["wrong name"]["value"] for c in cells]
    some = np.array(wrong) > 0
    axes.plot(
        x[some], np.array(wrong)[some], "x", color="firebrick", markersize=4, label="wrong name"
    )
