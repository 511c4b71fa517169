"""Films of worlds that share no code with `vision`: is any ball found, and found again?

    uv run python -m tests.benchmarks.vision.strangers --seeds 0 20 [--world third] [--quick]

Each seed draws a film (tests/support/other_world or third_world; the third needs OpenGL without a
screen, Mesa's EGL, and its seeds go round its kinds, which have totals of their own). A frame
counts where the whole ball shows (95 % of its disc): right within half a radius (at least 3 px),
wrong beyond that, lost without a measured place; where nothing of the ball shows (under 5 %) any
place counts as wrong. Locks are the times from where the ball comes into view (again) to the first
right place.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from tests.support.other_world.scene import strange_film
from tests.support.strange_film import StrangeFilm
from vision.detection.appearance import Appearance
from vision.frames import Track
from vision.tracking.tracker import Tracker
from vision.tracking.whole_film import WholeFilm

Follow = Callable[[StrangeFilm, Appearance | None], list[Track]]


@dataclass
class Outcome:
    """Frames by outcome, and the times [s] that each lock took (infinite: never)."""

    right: int = 0
    wrong: int = 0
    lost: int = 0
    absent: int = 0
    locks_s: list[float] = field(default_factory=list)
    cpu_s: float = 0.0
    frames: int = 0

    def __add__(self, other: Outcome) -> Outcome:
        return Outcome(
            *(getattr(self, k) + getattr(other, k) for k in ("right", "wrong", "lost", "absent")),
            self.locks_s + other.locks_s,
            self.cpu_s + other.cpu_s,
            self.frames + other.frames,
        )

    def row(self, name: str) -> str:
        shown = max(self.right + self.wrong + self.lost, 1)
        locks = np.array(self.locks_s or [np.nan])
        return (
            f"| {name} | {100 * self.right / shown:.1f} | {self.wrong} | {self.absent} | "
            f"{100 * self.lost / shown:.1f} | {100 * float(np.mean(locks <= 0.5)):.0f} % of "
            f"{len(self.locks_s)} | {float(np.median(locks)):.2f} | "
            f"{1e3 * self.cpu_s / max(self.frames, 1):.1f} |"
        )


def live(film: StrangeFilm, appearance: Appearance | None) -> list[Track]:
    tracker = Tracker(appearance=appearance)
    return [tracker.step(frame) for frame in film.frames]


def whole(film: StrangeFilm, appearance: Appearance | None) -> list[Track]:
    found = WholeFilm(lambda: film.frames, appearance=appearance)
    return [found.step(frame) for frame in film.frames]


def third_film(seed: int, *, quick: bool) -> StrangeFilm:
    """A film of the third world, whose renderer is loaded where it is asked for alone."""
    from tests.support.third_world import film

    return film.third_film(seed, quick=quick)


WORLDS = {"second": strange_film, "third": third_film}
METHODS: dict[str, Follow] = {"file": whole, "live": live}


def judge(film: StrangeFilm, tracks: list[Track], cpu_s: float) -> Outcome:
    """Hold the tracks of a film against its truth."""
    out = Outcome(cpu_s=cpu_s, frames=len(tracks))
    since, locked = None, True
    for frame, truth, shown, track in zip(film.frames, film.truth, film.shown, tracks, strict=True):
        given = track.state == "track"
        off = float(np.hypot(track.u_px - truth[0], track.v_px - truth[1])) if given else np.inf
        if shown < 0.05:
            out.absent += given
            if since is not None and not locked:
                out.locks_s.append(np.inf)
            since, locked = None, True
        elif shown > 0.95:
            if since is None:
                since, locked = frame.t_s, False
            ok = off < max(3.0, 0.5 * truth[2])
            out.right += ok
            out.wrong += given and not ok
            out.lost += not given
            if ok and not locked:
                out.locks_s.append(frame.t_s - since)
                locked = True
    if not locked:
        out.locks_s.append(np.inf)
    return out


def begun(film: StrangeFilm, seconds: float | None) -> StrangeFilm:
    """The first seconds of a film, or all of it."""
    n = sum(seconds is None or frame.t_s <= seconds for frame in film.frames)
    return replace(film, frames=film.frames[:n], truth=film.truth[:n], shown=film.shown[:n])


def run(film: StrangeFilm, method: str, colour: str | None) -> Outcome:
    appearance = Appearance.of_colour(colour) if colour else None
    start = time.process_time()
    tracks = METHODS[method](film, appearance)
    return judge(film, tracks, time.process_time() - start)


HEAD = (
    "film",
    "right %",
    "wrong thing",
    "of no ball",
    "lost %",
    "locked in 0.5 s",
    "median lock [s]",
    "CPU ms a frame",
)


def main() -> None:
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--seeds", type=int, nargs=2, default=(0, 20), metavar=("FROM", "TO"))
    options.add_argument("--world", choices=tuple(WORLDS), default="second")
    options.add_argument("--quick", action="store_true", help="small films")
    options.add_argument("--seconds", type=float, help="of each film, from its beginning")
    options.add_argument("--colour", help="name that is told of every ball, right or wrong")
    options.add_argument("--method", action="append", choices=tuple(METHODS), default=[])
    chosen = options.parse_args()
    cv2.setNumThreads(1)
    print("| " + " | ".join(HEAD) + " |\n" + "|---" * len(HEAD) + "|")
    methods = chosen.method or list(METHODS)
    totals: dict[tuple[str, str], Outcome] = {}
    for seed in range(*chosen.seeds):
        film = begun(WORLDS[chosen.world](seed, quick=chosen.quick), chosen.seconds)
        for method in methods:
            outcome = run(film, method, chosen.colour)
            for group in {film.kind, ""}:
                totals[group, method] = totals.get((group, method), Outcome()) + outcome
            print(outcome.row(f"{seed} {method}: {film.words}"), flush=True)
    for (group, method), total in sorted(totals.items(), key=lambda pair: pair[0][0] == ""):
        print(total.row(f"{group or 'all'}, {method}"))


if __name__ == "__main__":
    main()
