"""Hard cases, each with its figure: `uv run python tests/benchmarks/vision/cases.py` (3 minutes).

Every case is a script of ray-traced frames with exact truth, followed by a tracker that is told
nothing (or the ball's colour, where the case says so). "found" counts the frames from the first
lock on in which the ball can be seen and was tracked; "wrong" those in which a position passed as
good ("track") though the ball was hidden, or more than 3 px off. Beside it: how many of these were
also more than four of the sigmas they claimed off.
`--only NAME`, `--frames N`, `--out DIR` (contact sheet `cases.jpg`).
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from tests.benchmarks.vision.scenes import Shot
from tests.benchmarks.vision.scripts import Script, cases
from vision.detection.appearance import Appearance
from vision.frames import Frame, Track
from vision.overlay import contact_sheet, draw_track
from vision.tracking.tracker import Tracker

WRONG_PX, WRONG_SIGMAS = 3.0, 4.0
CELL = (220, 130)  # px of a picture in the contact sheet


@dataclass(eq=False)
class Figure:
    """What came of one case; `pictures` are of two ordinary frames and of its worst."""

    name: str
    found: int = 0
    shown: int = 0
    wrong: int = 0
    unwarned: int = 0  # of the wrong ones: by more than the claimed sigma allows
    coasted: int = 0
    frames: int = 0
    first: int = -1
    errors: list[float] = field(default_factory=list)
    scores: list[float] = field(default_factory=list)
    pictures: list[np.ndarray] = field(default_factory=list)

    def row(self) -> str:
        share = f"{100 * self.found / self.shown:.1f}" if self.shown else "-"
        rmse = f"{np.sqrt(np.mean(np.square(self.errors)) / 2):.3f}" if self.errors else "-"
        score = f"{np.sqrt(np.mean(np.square(self.scores)) / 2):.2f}" if self.errors else "-"
        first = str(self.first) if self.first >= 0 else "never"
        coast = f"{100 * self.coasted / self.shown:.1f}" if self.shown else "-"
        wrong = f"{self.wrong} ({self.unwarned}) of {self.frames}"
        return f"| {self.name} | {first} | {share} | {coast} | {wrong} | {rmse} | {score} |"


def followed(name: str, script: Script) -> Figure:
    """A tracker's figure on a script."""
    appearance = Appearance.of_colour("orange") if name.endswith("colour named") else None
    tracker, figure = Tracker(appearance=appearance), Figure(name)
    errors, kept = [], []
    for k, (shot, clear) in enumerate(script):
        track = tracker.step(Frame(shot.image, shot.t_s, k))
        errors.append(_judge(figure, track, shot, clear, k))
        kept.append(_thumbnail(shot, track, name))
    figure.pictures = [kept[len(kept) // 3], kept[-1], kept[int(np.argmax(errors))]]
    return figure


def _judge(figure: Figure, track: Track, shot: Shot, clear: bool | None, k: int) -> float:
    """Count one frame; the error in px where a position passed as good, else 0."""
    figure.frames += 1
    tracked = track.state == "track"
    if tracked and figure.first < 0:
        figure.first = k
    if figure.first >= 0 and clear:
        figure.shown += 1
        figure.found += tracked
        figure.coasted += track.state == "coast"
    if not tracked:
        return 0.0
    error = float(np.hypot(track.u_px - shot.u_px, track.v_px - shot.v_px))
    if error > WRONG_PX or clear is False:
        figure.wrong += 1
        figure.unwarned += error > WRONG_SIGMAS * track.sigma_px
        return max(error, 1e3)
    figure.errors.append(error)
    figure.scores.append(error / track.sigma_px)
    return error


def _thumbnail(shot: Shot, track: Track, name: str) -> np.ndarray:
    """The ball's surroundings at full scale with what was made of them, and the error in words."""
    image = draw_track(shot.image, track, [])
    w, h = CELL
    u = int(np.clip(shot.u_px - w / 2, 0, image.shape[1] - w))
    v = int(np.clip(shot.v_px - h / 2, 22, image.shape[0] - h))
    cell = np.vstack((image[v : v + h, u : u + w], np.zeros((34, w, 3), np.uint8)))
    error = np.hypot(track.u_px - shot.u_px, track.v_px - shot.v_px)
    said = f"{track.state}, off {error:.2f} +- {track.sigma_px:.2f} px"
    for row, text in enumerate((name, said if np.isfinite(error) else track.state)):
        at, font = (4, h + 13 + 16 * row), cv2.FONT_HERSHEY_SIMPLEX
        cv2.putText(cell, text, at, font, 0.38, (255, 255, 255), 1, cv2.LINE_AA)
    return cell


def _store(pictures: list[np.ndarray], path: Path) -> None:
    """The contact sheet, at the quality that keeps it below 300 kB."""
    sheet = contact_sheet(pictures, 9)
    for quality in range(80, 20, -5):
        cv2.imwrite(str(path), sheet, [cv2.IMWRITE_JPEG_QUALITY, quality])
        if path.stat().st_size < 300_000:
            return


def report(only: str = "", frames: int = 60, out: Path | None = None) -> None:
    """Print the figures of the cases whose name holds `only`; the contact sheet goes into `out`."""
    head = "case", "first lock, frame", "found %", "coast %", "wrong (> 4 sigma)", "RMSE px"
    print("| " + " | ".join(head) + " | normalised error |\n" + "|---" * 7 + "|")
    pictures, wrong, unwarned, seen = [], 0, 0, 0
    for name, script in cases().items():
        if only in name:
            figure = followed(name, script(frames))
            print(figure.row(), flush=True)
            pictures += figure.pictures
            wrong, seen = wrong + figure.wrong, seen + figure.frames
            unwarned += figure.unwarned
    print(f"\nwrong positions passed as good: {wrong} of {seen} frames, {unwarned} without warning")
    if out and pictures:
        out.mkdir(parents=True, exist_ok=True)
        _store(pictures, out / "cases.jpg")


def main() -> None:
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--only", default="", help="cases whose name holds this")
    options.add_argument("--frames", type=int, default=60)
    options.add_argument("--out", type=Path, help="a folder for the contact sheet")
    chosen = options.parse_args()
    cv2.setNumThreads(1)
    report(chosen.only, chosen.frames, chosen.out)


if __name__ == "__main__":
    main()
