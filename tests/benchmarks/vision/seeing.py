"""Ours and others on one table: `python tests/benchmarks/vision/seeing.py --out DIR` (5 minutes).

A ball rolls over ray-traced scenes with exact truth; every method sees the same images, one
thread, CPU time per call. Errors are px per axis, over the calls that gave the ball; "wrong" are
positions more than 5 px off. All scenes at 640x480, two of them at 1280x720 too. `--size WxH` (all
scenes at that size alone), `--frames N` a scene, `--seed N`, `--only NAME`, `--ours`, `--out DIR`
(histogram of the error over the sub-pixel phase, the table as CSV, and the contact sheet of the
hard cases with their own table).
"""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from tests.benchmarks.vision.cases import report
from tests.benchmarks.vision.peers import PEERS
from tests.benchmarks.vision.scenes import STANDARD, Look, Shot, Studio, rolling
from vision.detection.appearance import Appearance
from vision.frames import Frame
from vision.tracking.candidates import find_discs
from vision.tracking.tracker import Tracker

WRONG_PX = 5.0
PHASES = 10
FRAMES, CASE_FRAMES = 36, 20
LARGE = ("clean", "shaded")  # scenes that are repeated at 1280x720
WARM = 12  # calls before the clock counts: compilation, caches, the first lock

Method = Callable[[Shot, int], tuple[float, float, float] | None]


@dataclass(eq=False)
class Score:
    """Errors (n, 2) px against the truth, claimed sigmas (n,), sub-pixel phases (n, 2), CPU ms."""

    name: str
    errors: list[tuple[float, float]] = field(default_factory=list)
    sigmas: list[float] = field(default_factory=list)
    phases: list[tuple[float, float]] = field(default_factory=list)
    spent_ms: list[float] = field(default_factory=list)
    missed: int = 0
    wrong: int = 0

    def add(self, shot: Shot, got: tuple[float, float, float] | None, ms: float) -> None:
        self.spent_ms.append(ms)
        if got is None:
            self.missed += 1
            return
        du, dv = got[0] - shot.u_px, got[1] - shot.v_px
        if np.hypot(du, dv) > WRONG_PX:
            self.wrong += 1
            return
        self.errors.append((du, dv))
        self.sigmas.append(got[2])
        self.phases.append((shot.u_px % 1.0, shot.v_px % 1.0))

    def row(self, scene: str, bound: float) -> list[str]:
        """Cells of the table."""
        n = max(len(self.spent_ms), 1)
        rest = [f"{100 * self.missed / n:.1f}", f"{100 * self.wrong / n:.1f}"]
        ms = f"{np.median(self.spent_ms[WARM:]):.3f}" if len(self.spent_ms) > WARM else "-"
        if not self.errors:
            return [scene, str(n), self.name, "-", "-", "-", "-", *rest, ms]
        e = np.array(self.errors)
        rmse = float(np.sqrt(np.mean(e**2)))
        bias = "{:+.4f}, {:+.4f}".format(*e.mean(0))
        sigma = np.array(self.sigmas)
        honest = "-"
        if np.isfinite(sigma).all():
            honest = f"{np.sqrt(np.mean((e / sigma[:, None]) ** 2)):.2f}"
        return [
            scene,
            str(n),
            self.name,
            f"{rmse:.4f}",
            f"{rmse / bound:.1f}",
            bias,
            honest,
            *rest,
            ms,
        ]


def tracking(colour: str | None) -> Method:
    """The tracker stepping over the sequence, told a colour or nothing."""
    tracker = Tracker(appearance=Appearance.of_colour(colour) if colour else None)

    def step(shot: Shot, index: int) -> tuple[float, float, float] | None:
        track = tracker.step(Frame(shot.image, shot.t_s, index))
        return (track.u_px, track.v_px, track.sigma_px) if track.state == "track" else None

    return step


def finding(first: Shot, mask: np.ndarray) -> Method:
    """The ball anywhere on the plate in one image, by the looks learned in the first."""
    appearance = Appearance.learn(first.image, first.u_px, first.v_px, first.radius_px)
    bounds = (0.8 * first.radius_px, 1.25 * first.radius_px)

    def find(shot: Shot, _index: int) -> tuple[float, float, float] | None:
        found = find_discs(shot.image, appearance, bounds, mask, None)
        if not found:
            return None
        best = max(found, key=lambda d: d.inliers - d.residual_px / d.radius_px)
        return best.u_px, best.v_px, best.sigma_px

    return find


def peer(function, mask: np.ndarray | None = None, beside: int = 0) -> Method:
    """A peer on the whole image, or with all that is beside the plate painted `beside`."""

    def call(shot: Shot, _index: int) -> tuple[float, float, float] | None:
        image = shot.image
        if mask is not None:
            image = image.copy()
            image[mask == 0] = beside
        got = function(image, shot.radius_px)
        return None if got is None else (*got, float("nan"))

    return call


def judged(
    look: Look, size: tuple[int, int], frames: int, seed: int, *, peers: bool
) -> list[Score]:
    """Every method on one scene."""
    studio = Studio(look, size, seed)
    places, speeds, times = rolling(look.speed_m_s, frames)
    first = studio.shot(places[0], speeds[0])
    methods: dict[str, Method] = {
        "ours, tracking": tracking("orange"),
        "ours, tracking, no colour given": tracking(None),
        "ours, finding on the plate": finding(first, studio.plate_mask),
    }
    if peers:
        methods |= {name: peer(function) for name, function in PEERS.items()}
        named = "HSV, contour moments"
        methods[f"{named}, on the plate"] = peer(PEERS[named], studio.plate_mask)
        if "trackpy" in PEERS:  # it looks for what is bright in the inverted image
            methods["trackpy, on the plate"] = peer(PEERS["trackpy"], studio.plate_mask, 255)
    shots = [studio.shot(places[k], speeds[k], times[k]) for k in range(frames)]
    # A method after the other, as they would run: each finds its own code and tables in the caches.
    return [_run(Score(name), method, shots) for name, method in methods.items()]


def _run(score: Score, method: Method, shots: list[Shot]) -> Score:
    for k, shot in enumerate(shots):
        cv2.sumElems(shot.image)  # a frame has just been written when a tracker gets it
        start = time.process_time_ns()
        got = method(shot, k)
        score.add(shot, got, 1e-6 * (time.process_time_ns() - start))
    return score


def phase_bias(score: Score) -> np.ndarray:
    """Mean error (2, PHASES) px per axis and sub-pixel phase, NaN where no sample."""
    e, phase = np.array(score.errors), np.array(score.phases)
    out = np.full((2, PHASES), np.nan)
    for axis in range(2):
        bins = np.minimum((phase[:, axis] * PHASES).astype(int), PHASES - 1)
        for b in range(PHASES):
            if (bins == b).any():
                out[axis, b] = e[bins == b, axis].mean()
    return out


def memory_pass_ms(size: tuple[int, int]) -> float:
    """CPU ms of reading a frame once (its sum)."""
    image = np.zeros((size[1], size[0], 3), np.uint8)
    spent = []
    for _ in range(200):
        start = time.process_time_ns()
        cv2.sumElems(image)
        spent.append(1e-6 * (time.process_time_ns() - start))
    return float(np.median(spent))


def histogram(scores: dict[str, Score], path: Path) -> None:
    """Bias over the sub-pixel phase and the errors' histogram, a row a scene."""
    from matplotlib.figure import Figure

    sheet = Figure(figsize=(10, 2.2 * len(scores)), layout="constrained")
    axes = sheet.subplots(len(scores), 2, squeeze=False)
    for (name, score), (left, right) in zip(scores.items(), axes, strict=True):
        bias = phase_bias(score)
        x = (np.arange(PHASES) + 0.5) / PHASES
        for axis in range(2):
            left.bar(x + 0.02 * (2 * axis - 1), bias[axis], 0.04, label="uv"[axis])
            right.hist(np.array(score.errors)[:, axis], 15, histtype="step", label="uv"[axis])
        left.axhline(0.01, ls=":", c="grey")
        left.axhline(-0.01, ls=":", c="grey")
        left.set(title=name, xlabel="sub-pixel phase [px]", ylabel="mean error [px]")
        right.set(title=f"{len(score.errors)} frames", xlabel="error [px]", ylabel="frames")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    sheet.legend(handles, labels, loc="outside upper right", ncols=2)
    sheet.suptitle("ours, tracking: dotted, the goal of 0.01 px over the sub-pixel phase", x=0.4)
    sheet.savefig(path, dpi=90)


HEAD = ["scene", "n", "method", "RMSE px", "/ bound", "bias u, v px", "normalised error"]
HEAD += ["missed %", "wrong %", "CPU ms"]


def compared(
    appearance: list[Look], size: tuple[int, int], frames: int, seed: int, *, peers: bool
) -> tuple[list[list[str]], dict[str, Score]]:
    """Print the table's rows of these scenes; they, and the tracker's score on each, are given."""
    rows, tracked = [], {}
    for look in appearance:
        name = f"{look.name}, {size[1]} rows"
        bound = Studio(look, size).bound_px()
        scores = judged(look, size, frames, seed, peers=peers)
        tracked[name] = scores[0]
        table = [s.row(name, bound) for s in scores]
        table.append([name, "-", "Cramer-Rao bound", f"{bound:.4f}", "1.0", *["-"] * 5])
        rows += table
        for row in table:
            print("| " + " | ".join(row) + " |", flush=True)
    memory = ["-", "200", f"one memory pass, {size[0]}x{size[1]}", *["-"] * 6]
    print("| " + " | ".join([*memory, f"{memory_pass_ms(size):.3f}"]) + " |")
    return rows, tracked


def main() -> None:
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--size", help="WxH")
    options.add_argument("--frames", type=int, default=FRAMES)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--only", default="", help="scenes whose name holds this")
    options.add_argument("--ours", action="store_true", help="leave the others out")
    options.add_argument("--out", type=Path, help="a folder for the pictures and the CSV")
    chosen = options.parse_args()
    cv2.setNumThreads(1)
    appearance = [look for look in STANDARD if chosen.only in look.name]
    plan = [((640, 480), appearance), ((1280, 720), [k for k in appearance if k.name in LARGE])]
    if chosen.size:
        w, h = (int(x) for x in chosen.size.split("x"))
        plan = [((w, h), appearance)]
    print(f"seed {chosen.seed}; n: calls of each method on the same images\n")
    print("| " + " | ".join(HEAD) + " |\n" + "|---" * len(HEAD) + "|")
    rows, tracked = [HEAD], {}
    for size, scenes in plan:
        more, scores = compared(scenes, size, chosen.frames, chosen.seed, peers=not chosen.ours)
        rows, tracked = rows + more, tracked | scores
    if "trackpy" not in PEERS:
        print("\ntrackpy is not installed here: skipped")
    print("\nlargest |mean error| in any tenth of the sub-pixel phase, tracking [px]:")
    for name, score in tracked.items():
        if score.errors:
            print(f"  {name}: {np.nanmax(np.abs(phase_bias(score))):.4f}")
    if chosen.out:
        chosen.out.mkdir(parents=True, exist_ok=True)
        histogram({k: s for k, s in tracked.items() if s.errors}, chosen.out / "phase.png")
        with (chosen.out / "vision.csv").open("w", newline="") as file:
            csv.writer(file).writerows(rows)
        print("\nhard cases:\n")
        report(frames=CASE_FRAMES, out=chosen.out)


if __name__ == "__main__":
    main()
