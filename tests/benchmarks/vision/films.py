"""Real films with labels made by eye, followed by this tracker and by its usual rivals.

    uv run python tests/benchmarks/vision/films.py FOLDER [--out DIR] [--only NAME]

Every `NAME.labels.csv` in FOLDER or below (rows `frame, u, v`, blank where no ball is visible, a
fourth column where it is partly hidden) is judged with the film `NAME.*` beside it. A frame counts
as right within half a radius (at least 6 px) of its label, as wrong beyond that or where there is
no ball, as lost where no position was measured. Partly hidden frames count only as wrong ones.

Rows: `file` as `rig track` reads a film, `live` the tracker alone, frame by frame; nothing is told
to either. HSV moments are told the ball's colour and HoughCircles its radius, both at the labels.
CSRT needs opencv-contrib; where this OpenCV lacks it, its rows say so. The radius is that of the
strongest circle about the labels. Contact sheets go into DIR.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from vision.frames import Frame
from vision.sources.sources import open_source
from vision.tracking.tracker import Tracker
from vision.tracking.whole_film import WholeFilm

CELL = (320, 240)
PICTURES = 8  # of a film in the contact sheet
COLOURS = {"label": (255, 255, 255), "file": (60, 220, 60), "live": (255, 160, 0)}
COLOURS |= {"HSV moments": (0, 200, 255), "HoughCircles": (255, 0, 255), "CSRT": (60, 60, 255)}
LINE = cv2.LINE_AA

Place = tuple[float, float] | None
Label = tuple[Place, bool]  # where the ball is (None: not to be seen), whether wholly
Locate = Callable[[np.ndarray], Place]


@dataclass(frozen=True)
class Case:
    """A film and its labels, `labels[frame]`; `radius_px` of the ball about them."""

    name: str
    film: Path
    labels: dict[int, Label]
    radius_px: float

    @property
    def tolerance_px(self) -> float:
        return max(6.0, 0.5 * self.radius_px)

    @property
    def shown(self) -> list[int]:
        """Frames in which the whole ball is visible."""
        return [k for k, (place, whole) in self.labels.items() if place and whole]


@dataclass
class Score:
    """A method's places by frame, its CPU time per frame [s] and the frames' times [s]."""

    places: dict[int, Place]
    cpu_s: float
    times: dict[int, float]


def read_labels(path: Path) -> dict[int, Label]:
    """`labels[frame]` of a file of labels; lines that begin with no number are passed over."""
    labels: dict[int, Label] = {}
    with path.open(newline="", encoding="utf-8") as file:
        for row in csv.reader(file):
            if row and row[0].strip().isdigit():
                cells = [c.strip() for c in row] + ["", "", ""]
                place = (float(cells[1]), float(cells[2])) if cells[1] else None
                labels[int(cells[0])] = (place, not cells[3])
    return labels


def films_in(folder: Path) -> Iterator[tuple[str, Path, dict[int, Label]]]:
    """(name, film, labels) of every labelled film in a folder or below."""
    for path in sorted(folder.rglob("*.labels.csv")):
        name = path.name.removesuffix(".labels.csv")
        films = [f for f in sorted(path.parent.glob(f"{name}.*")) if f != path]
        if films:
            yield name, films[0], read_labels(path)


def radius_at(image: np.ndarray, place: tuple[float, float]) -> float:
    """Radius [px] of the strongest circle about a place: the largest mean outward gradient."""
    grey = cv2.GaussianBlur(image, (0, 0), 1.5).astype(np.float32)
    radii = np.geomspace(4.0, 0.4 * min(image.shape[:2]), 60)
    turn = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
    best = []
    for r in radii:
        sides = []
        for side in (0.92 * r - 1.0, 1.08 * r + 1.0):
            x = (place[0] + side * np.cos(turn)).astype(np.float32)[None]
            y = (place[1] + side * np.sin(turn)).astype(np.float32)[None]
            sides.append(cv2.remap(grey, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
        best.append(float(np.linalg.norm((sides[0] - sides[1]).mean((0, 1)))))
    return float(radii[int(np.argmax(best))])


def load(name: str, film: Path, labels: dict[int, Label]) -> Case:
    """The case with its radius: the median over the frames that show the whole ball."""
    radii = []
    with open_source(film) as source:
        for frame in source:
            place, whole = labels.get(frame.index, (None, False))
            if place and whole:
                radii.append(radius_at(frame.image, place))
    return Case(name, film, labels, float(np.median(radii)) if radii else 12.0)


def ours_live(case: Case) -> Score:
    """The tracker alone, frame by frame."""
    tracker = Tracker()

    def locate(frame: Frame) -> Place:
        track = tracker.step(frame)
        return (track.u_px, track.v_px) if track.state == "track" else None

    return _run(case, locate)


def ours_file(case: Case) -> Score:
    """As `rig track` follows a file; its CPU time includes decoding."""
    start = time.process_time()
    times: dict[int, float] = {}

    def frames() -> Iterator[Frame]:
        with open_source(case.film) as source:
            for frame in source:
                times[frame.index] = frame.t_s
                yield frame

    tracks = WholeFilm(frames).tracks
    cpu_s = (time.process_time() - start) / max(len(tracks), 1)
    places = {k: (t.u_px, t.v_px) if t.state == "track" else None for k, t in tracks.items()}
    return Score(places, cpu_s, times)


def _run(case: Case, locate: Callable[[Frame], Place]) -> Score:
    places: dict[int, Place] = {}
    times: dict[int, float] = {}
    spent = 0.0
    with open_source(case.film) as source:
        for frame in source:
            start = time.process_time()
            places[frame.index] = locate(frame)
            spent += time.process_time() - start
            times[frame.index] = frame.t_s
    return Score(places, spent / max(len(places), 1), times)


def hsv_moments(case: Case) -> Score:
    """The largest patch of the colour that the ball has at its first label, and its centroid."""
    low, high = np.zeros(3), np.zeros(3)
    with open_source(case.film) as source:
        for frame in source:
            if frame.index == case.shown[0]:
                (u, v), r = case.labels[frame.index][0] or (0, 0), 0.6 * case.radius_px
                disc = np.zeros(frame.image.shape[:2], np.uint8)
                cv2.circle(disc, (round(u), round(v)), max(1, round(r)), 255, -1)
                hsv = cv2.cvtColor(frame.image, cv2.COLOR_BGR2HSV)[disc > 0]
                slack = np.array((8.0, 40.0, 40.0))
                low, high = np.percentile(hsv, 5, 0) - slack, np.percentile(hsv, 95, 0) + slack

    def locate(frame: Frame) -> Place:
        mask = cv2.inRange(cv2.cvtColor(frame.image, cv2.COLOR_BGR2HSV), low, high)
        contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        m = cv2.moments(max(contours, key=cv2.contourArea)) if contours else {"m00": 0.0}
        return (m["m10"] / m["m00"], m["m01"] / m["m00"]) if m["m00"] > 20 else None

    return _run(case, locate)


def hough(case: Case) -> Score:
    """The best of `cv2.HoughCircles` within 20 % of the ball's radius."""
    r = case.radius_px

    def locate(frame: Frame) -> Place:
        grey = cv2.medianBlur(cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY), 5)
        size = {"minRadius": round(0.8 * r), "maxRadius": round(1.2 * r) + 1}
        found = cv2.HoughCircles(
            grey, cv2.HOUGH_GRADIENT, 1.0, minDist=2 * r, param1=100, param2=20, **size
        )
        if found is None:
            return None
        u, v = np.asarray(found).reshape(-1, np.asarray(found).shape[-1])[0, :2]
        return float(u), float(v)

    return _run(case, locate)


def csrt(case: Case) -> Score | None:
    """CSRT from the box of the first label; None where this OpenCV lacks it."""
    make = getattr(cv2, "TrackerCSRT_create", None)
    if make is None:
        return None
    tracker, first, r = make(), case.shown[0], case.radius_px

    def locate(frame: Frame) -> Place:
        if frame.index < first:
            return None
        if frame.index == first:
            u, v = case.labels[first][0] or (0.0, 0.0)
            tracker.init(frame.image, tuple(round(x) for x in (u - r, v - r, 2 * r, 2 * r)))
            return u, v
        ok, (x, y, w, h) = tracker.update(frame.image)
        return (x + w / 2, y + h / 2) if ok else None

    return _run(case, locate)


METHODS = {"file": ours_file, "live": ours_live, "CSRT": csrt}
METHODS |= {"HSV moments": hsv_moments, "HoughCircles": hough}


@dataclass
class Count:
    """Labelled frames by outcome; `lock_s`: from the first label to the first right place there."""

    right: int = 0
    wrong: int = 0
    lost: int = 0
    seen: int = 0
    lock_s: float = float("nan")


def judge(case: Case, score: Score) -> Count:
    """Hold a method's places against the labels; a repeat has the place of the frame before."""
    count, kept = Count(), np.array(sorted(score.places))
    first = next((score.times.get(k, 0.0) for k in case.shown), 0.0)
    if not len(kept):
        return count
    for k, (label, whole) in sorted(case.labels.items()):
        at = int(kept[max(0, int(np.searchsorted(kept, k, "right")) - 1)])
        got = score.places[at]
        count.seen += bool(label and whole)
        if got is None:
            count.lost += bool(label and whole)
        elif label is None or np.hypot(got[0] - label[0], got[1] - label[1]) > case.tolerance_px:
            count.wrong += 1
        elif whole:
            count.right += 1
    given = [k for k in kept if score.places[int(k)] is not None and score.times[int(k)] >= first]
    count.lock_s = score.times[int(given[0])] - first if given else float("inf")
    return count


def row(film: str, method: str, count: Count, cpu_s: float) -> str:
    return (
        f"| {film} | {method} | {count.right} of {count.seen} | {count.wrong} | {count.lost} "
        f"| {count.lock_s:.2f} | {1e3 * cpu_s:.1f} |"
    )


def sheet(case: Case, scores: dict[str, Score]) -> np.ndarray:
    """A row of pictures with every method's place, under a title, (h, w, 3) uint8."""
    chosen = sorted(case.labels)
    chosen = [chosen[i] for i in np.linspace(0, len(chosen) - 1, PICTURES).astype(int)]
    cells: dict[int, np.ndarray] = {}
    with open_source(case.film) as source:
        for frame in source:
            for k in (k for k in chosen if k not in cells and frame.index >= k):
                cells[k] = _cell(case, scores, frame.image, k, frame.index)
    strip = np.hstack([cells.get(k, np.zeros((*CELL[::-1], 3), np.uint8)) for k in chosen])
    title = np.full((30, strip.shape[1], 3), 24, np.uint8)
    words = f"{case.name}: {len(case.shown)} labels, radius {case.radius_px:.0f} px"
    cv2.putText(title, words, (8, 21), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (255, 255, 255), 1, LINE)
    x = 720
    for name in ("label", *scores):
        cv2.circle(title, (x, 15), 6, COLOURS[name], 2, LINE)
        cv2.putText(
            title, name, (x + 14, 21), cv2.FONT_HERSHEY_SIMPLEX, 0.55, COLOURS[name], 1, LINE
        )
        x += 60 + 11 * len(name)
    return np.vstack((title, strip))


def _cell(case: Case, scores: dict[str, Score], image: np.ndarray, k: int, at: int) -> np.ndarray:
    scale = np.array((CELL[0] / image.shape[1], CELL[1] / image.shape[0]))
    cell = cv2.resize(image, CELL, interpolation=cv2.INTER_AREA)
    places = {"label": case.labels[k][0]} | {n: s.places.get(at) for n, s in scores.items()}
    for i, (name, place) in enumerate(places.items()):
        if place is not None:
            u, v = (round(float(x)) for x in scale * place)
            r = max(3, round(case.radius_px * float(scale.mean()))) + 3 * i
            cv2.circle(cell, (u, v), r, COLOURS[name], 1 + (name == "file"), LINE)
    cv2.putText(cell, f"frame {k}", (6, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 0), 3, LINE)
    cv2.putText(
        cell, f"frame {k}", (6, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (255, 255, 255), 1, LINE
    )
    return cell


def report(folder: Path, out: Path | None, only: str, methods: list[str]) -> None:
    """Print the table of all films and its sum, and write a contact sheet for each film."""
    print(
        "| film | method | right | wrong | lost | lock [s] | CPU ms a frame |\n" + "|---" * 7 + "|"
    )
    totals: dict[str, list[tuple[Count, float]]] = {}
    for name, film, labels in films_in(folder):
        if only not in name:
            continue
        case = load(name, film, labels)
        scores: dict[str, Score] = {}
        for method in methods:
            score = METHODS[method](case)
            if score is None:
                print(f"| {name} | {method} | not in this OpenCV ({cv2.__version__}) | | | | |")
                continue
            scores[method] = score
            count = judge(case, score)
            totals.setdefault(method, []).append((count, score.cpu_s))
            print(row(name, method, count, score.cpu_s), flush=True)
        if out:
            out.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(out / f"{name}.jpg"), sheet(case, scores))
    for method, counts in totals.items():
        total = Count(
            *(sum(getattr(c, k) for c, _ in counts) for k in ("right", "wrong", "lost", "seen"))
        )
        total.lock_s = float(np.median([c.lock_s for c, _ in counts]))
        print(row("all (median lock)", method, total, float(np.mean([s for _, s in counts]))))


def main() -> None:
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("folder", type=Path)
    options.add_argument("--out", type=Path, help="a folder for the contact sheets")
    options.add_argument("--only", default="", help="films whose name holds this")
    options.add_argument("--method", action="append", choices=tuple(METHODS), default=[])
    chosen = options.parse_args()
    cv2.setNumThreads(1)
    report(chosen.folder, chosen.out, chosen.only, chosen.method or list(METHODS))


if __name__ == "__main__":
    main()
