"""The picture of how late a ball answers the commands of servos that nobody measures."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calibration.motion.rolling import Rolling
from calibration.records import PositionServoRecord
from experiments.calibrate.pictures import save
from experiments.picture_files import our_style, subplots
from rig.log import COMMANDS, Log

SHOWN_S = 12.0  # of the middle of a run: its beginning is often a hand's; chosen
# Over so long the acceleration is that of a parabola through the ball's places, and the command is
# averaged; chosen: the camera's noise leaves some percent of what a ball does.
SMOOTH_S, STEP_S, LEAST = 0.4, 0.04, 8
LEGEND_SHARE = 0.25  # of what the curves take: room above them


def acceleration(run: Rolling, at_s: np.ndarray) -> np.ndarray:
    """The ball's acceleration (n,) [m/s2] about the times at_s (n,), NaN where it was seen less
    than LEAST times in SMOOTH_S."""
    found = np.full(len(at_s), np.nan)
    for i, t_s in enumerate(at_s):
        near = np.abs(run.seen_s - t_s) <= SMOOTH_S / 2
        if near.sum() >= LEAST:
            found[i] = 2.0 * np.polyfit(run.seen_s[near] - t_s, run.x_m[near], 2)[0]
    return found


def averaged(log: Log, axis: int, at_s: np.ndarray) -> np.ndarray:
    """The command (n,) [rad] over SMOOTH_S about the times at_s (n,), weighted as a parabola's
    curvature weighs what pulls a ball: most in the middle."""
    t_s, told = log["t_s"], log[COMMANDS[axis]]
    about = np.linspace(-0.5, 0.5, 21)
    weights = (0.25 - about**2) ** 2
    held = np.clip(np.searchsorted(t_s, at_s[:, None] + SMOOTH_S * about, "right") - 1, 0, None)
    return told[held] @ (weights / weights.sum())


@our_style()
def answer_figure(
    log: Log,
    runs: Sequence[Rolling],
    record: PositionServoRecord,
    path: Path,
    source: str,
) -> Path:
    """Draw the ball's acceleration [m/s2] over the command [degrees] as it was told and as late as
    was found, about the middle of a log; runs: one for each axis.

    source: "simulated" or "measured". Returns `path`, a PNG file. OSError: it cannot be written.
    """
    figure, rows = subplots(2, 1, figsize=(8, 5.6), sharex=True)
    middle_s = float(np.median(runs[0].seen_s))
    at_s = np.arange(-SHOWN_S / 2, SHOWN_S / 2, STEP_S) + middle_s
    for axes, run, found in zip(rows, runs, (record.x, record.y), strict=True):
        name, late = "xy"[run.axis], found.together_s
        if late is None:
            continue
        pulled = acceleration(run, at_s)
        told, delayed = (averaged(log, run.axis, at_s - by_s) for by_s in (0.0, late.value))
        axes.plot(at_s, pulled, ".", ms=3, color="#1f4fd8", label="ball's acceleration")
        low, high = axes.get_ylim()
        axes.set(ylabel=f"ball {name} [m/s2]", ylim=(low, high + LEGEND_SHARE * (high - low)))
        right = axes.twinx()
        right.plot(at_s, np.degrees(told), lw=0.8, color="0.6", label="command as told")
        words = f"command, {1e3 * late.value:.0f} ms later"
        right.plot(at_s, np.degrees(delayed), "--", lw=1.1, color="#d62728", label=words)
        right.set_ylabel("command [degrees]")
        right.grid(False)
        seen = np.isfinite(pulled)
        gain, level = np.polyfit(delayed[seen], pulled[seen], 1) if seen.sum() > 2 else (0.0, 0.0)
        if gain > 0:  # both axes then show one thing
            right.set_ylim(*(np.degrees((end - level) / gain) for end in axes.get_ylim()))
        axes.set_title(
            f"{name}: lag and dead time together {1e3 * late.value:.0f} ms "
            f"(95 %: {1e3 * late.low:.0f} to {1e3 * late.high:.0f})",
            fontsize=10,
        )
        (dots, dots_said), (lines, lines_said) = (
            one.get_legend_handles_labels() for one in (axes, right)
        )
        handles, labels = dots + lines, dots_said + lines_said
        right.legend(handles, labels, loc="upper right", fontsize=9, ncols=3)
    rows[1].set_xlabel("time [s]")
    return save(figure, path, source)
