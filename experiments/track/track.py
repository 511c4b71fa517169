"""Track the ball in a video: `track.csv`, a film with overlay, a contact sheet, a summary.

A file is looked at as a whole first (`vision.tracking.whole_film`); a live stream is followed as it
comes.
"""

from __future__ import annotations

import csv
import math
from collections import Counter, deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from experiments.picture_files import write_image
from experiments.records.run_folder import refuse_input, write_results
from rig.files import freed, naming, put_aside

if TYPE_CHECKING:
    import numpy as np

    from rig.foreign_trial import Tells
    from vision.detection.appearance import Appearance
    from vision.frames import Frame, Track
    from vision.sources.sources import Source
    from vision.tracking.tracker import Tracker
    from vision.tracking.whole_film import WholeFilm
    from vision.view import View

PIXEL_COLUMNS = ("frame", "t_s", "state", "u_px", "v_px", "sigma_px")
METRIC_COLUMNS = ("x_m", "y_m", "cov_xx_m2", "cov_xy_m2", "cov_yy_m2")
SHEET, RESULTS = "contact_sheet.png", "results.json"
TRACK = "track.csv"
MADE = (TRACK, "overlay.mp4", SHEET, RESULTS)
EARLIER = "earlier-"  # before the names of files that a later film may replace
SHEET_IMAGES, SHEET_COLUMNS, SHEET_WIDTH_PX = 48, 6, 320
TRAIL = 40

Progress = Callable[[int, int | None], None]


class Calibration(Protocol):
    """The part of a calibration bundle that is used here (`calibration.bundle.Bundle`)."""

    ball_radius_m: float

    @property
    def view(self) -> Any:  # a View, also where it is computed once and kept
        """Calibrated view (`vision.view.View`) of the level plate."""
        ...

    @property
    def layout(self) -> Any:  # the plate's markers
        """Layout of the plate's markers (`vision.plate.markers.MarkerLayout`)."""
        ...

    def check_size(self, width_px: int, height_px: int) -> None:
        """Raise ValueError where frames of `width_px` x `height_px` are not of the size of the
        calibration's.
        """
        ...


def track_video(
    address: str | Path | int,
    out_dir: str | Path,
    *,
    calibration: Calibration | None = None,
    ball_colour: str | None = None,
    ball_at: tuple[float, ...] | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Follow the ball through `address` (file, folder, stream) and write the results to `out_dir`.

    calibration: without it positions are in pixels alone; ball_colour: a name or "#rrggbb", which
    counts in favour of things of that colour; ball_at: (u, v) or (u, v, radius) px in the first
    frame. Told nothing, the ball is the round thing that travels or, at rest, stands out.
    progress(done, total): called with frames of the file, total None for a stream; with 0 before
    the first is looked at. Returns the content of results.json. OSError, ValueError: the address
    has no frames, the colour is unknown, or the frames have another size than the calibration's,
    or `out_dir` would take a file of the address's place.
    """
    from experiments.own_camera import with_camera
    from vision.detection.appearance import Appearance

    _clear(Path(out_dir), address)
    appearance = Appearance.of_colour(ball_colour) if ball_colour else None
    how = ball_colour, appearance, ball_at

    def work(tells: Tells) -> dict[str, Any]:
        return _tracked(address, Path(out_dir), calibration, how, tells)

    summary = with_camera(address, work, heard=lambda told: progress(*told) if progress else None)
    for name in MADE:
        (Path(out_dir) / f"{EARLIER}{name}").unlink(missing_ok=True)
    return summary


def _tracked(
    address: str | Path | int,
    out: Path,
    calibration: Calibration | None,
    how: tuple[str | None, Appearance | None, tuple[float, ...] | None],
    tells: Tells,
) -> dict[str, Any]:
    """`track_video` once the folder is clear; how: the ball's colour as asked for, its appearance
    and place."""
    from experiments.own_camera import opened

    ball_colour, appearance, ball_at = how
    radius = _radius_bounds(calibration)
    with opened(address, tells) as source:
        if calibration is not None:
            calibration.check_size(*source.size)
        if ball_at is not None:
            _check_place(ball_at, source.size)
        tracker = _tracker(address, source.live, appearance, radius, ball_at)
        out.mkdir(parents=True, exist_ok=True)
        _make_room(out)
        tells.say((0, source.frames_total))
        states, times, troubles = _follow(source, tracker, calibration, out, tells)
        metric = calibration is not None
        summary = _summary(source, tracker, states, times, ball_colour, metric=metric)
        summary["notes"] += troubles
        summary["files"] = [name for name in MADE if name == RESULTS or (out / name).is_file()]
    write_results(out, summary)
    return summary


def _clear(out: Path, address: str | Path | int) -> None:
    """Take links and pipes away that lie where files are made. ValueError: one is the recording,
    or would lie among its pictures.
    """
    from vision.sources.sources import recorded

    place = recorded(str(address))
    # Pictures are read from the folder itself: in a folder beside them nothing of theirs lies.
    is_read = place and (place.is_file() or place.resolve() == out.resolve())
    for name in MADE:
        refuse_input("--out", out / name, [place] if place and is_read else [])
        freed(out / name)


def _make_room(out: Path) -> None:
    """Keep what lies where files are made: earlier results, until these are whole, too, in case
    they never are, and files of somebody else's for good.
    """
    made = [out / name for name in MADE if (out / name).is_file()]
    ours, whole = _is_ours(out / TRACK), out / RESULTS in made
    for path in made:
        if ours and whole:  # else they are those of a film that was left
            path.replace(out / f"{EARLIER}{path.name}")
        elif not ours and path.name != RESULTS:  # which `write_results` looks at
            put_aside(path)


def _is_ours(path: Path) -> bool:
    """Is that a table of this program's?"""
    try:
        with path.open("rb") as file:
            return file.readline(200).startswith(",".join(PIXEL_COLUMNS).encode())
    except FileNotFoundError:
        return False


def place_of(text: str) -> tuple[float, ...]:
    """(u, v) or (u, v, radius) px of "U,V" or "U,V,RADIUS". ValueError: anything else."""
    try:
        place = tuple(float(x) for x in text.split(","))
    except ValueError:
        place = ()
    if len(place) not in (2, 3) or not all(math.isfinite(x) for x in place):
        raise ValueError(f"--ball-at {text}: give U,V or U,V,RADIUS in px, for example 320,240,16")
    return place


def _check_place(ball_at: tuple[float, ...], size: tuple[int, int]) -> None:
    """Raise ValueError where no ball can be at `ball_at` in frames of `size` (w, h) px."""
    u, v, *radius = ball_at
    if not (0 <= u < size[0] and 0 <= v < size[1]) or (radius and not radius[0] > 0):
        raise ValueError(
            f"ball at {', '.join(f'{x:g}' for x in ball_at)}: give u, v inside the image of "
            f"{size[0]} x {size[1]} px and, if at all, a radius above 0 px"
        )


def _tracker(
    address: str | Path | int,
    live: bool,
    appearance: Appearance | None,
    radius_px: tuple[float, float] | None,
    ball_at: tuple[float, ...] | None,
) -> Tracker | WholeFilm:
    """What follows the ball: a tracker where the source is live, else the whole film's."""
    from vision.sources.sources import open_source
    from vision.tracking.tracker import Tracker
    from vision.tracking.whole_film import WholeFilm

    if live:
        return Tracker(appearance=appearance, radius_px=radius_px, ball_at=ball_at)

    def frames() -> Iterator[Frame]:
        with open_source(address) as again:
            yield from again

    return WholeFilm(frames, appearance=appearance, radius_px=radius_px, ball_at=ball_at)


def _radius_bounds(calibration: Calibration | None) -> tuple[float, float] | None:
    """Radius in px that the geometry allows: at the plate's centre, with slack for its corners."""
    if calibration is None:
        return None
    radius = calibration.view.silhouette_from_ball((0.0, 0.0), calibration.ball_radius_m)[2]
    return 0.7 * float(radius), 1.4 * float(radius)


def _follow(
    source: Source,
    tracker: Tracker | WholeFilm,
    calibration: Calibration | None,
    out: Path,
    tells: Tells,
) -> tuple[Counter[str], list[float], list[str]]:
    """Track every frame into `track.csv`, `overlay.mp4` and `contact_sheet.png`.

    The table of positions is what counts: where the disk is too small for the film, the film goes.
    """
    import cv2
    import numpy as np

    from experiments.track.film import Overlay
    from experiments.track.live_frames import frames_of
    from vision.ball_camera import BallCamera
    from vision.overlay import draw_track

    states: Counter[str] = Counter()
    times: list[float] = []
    trail: deque[tuple[float, float]] = deque(maxlen=TRAIL)
    sheet = ContactSheet(str(source.address))
    troubles: list[str] = []
    camera = None
    if calibration is not None:  # the plate's pose is seen in every frame, not taken as level
        camera = BallCamera(
            calibration.view, calibration.layout, tracker, calibration.ball_radius_m
        )
    with (
        naming(out / TRACK),
        (out / TRACK).open("w", newline="", encoding="utf-8") as file,
        Overlay(out / "overlay.mp4", source.size) as film,
    ):
        rows = csv.writer(file)
        rows.writerow(PIXEL_COLUMNS + METRIC_COLUMNS)
        for frame in frames_of(source, troubles):
            if camera is None:
                track, view = tracker.step(frame), None
            else:
                _, track, view = camera.step(frame, np.eye(3))
            states[track.state] += 1
            times.append(frame.t_s)
            trail.append((track.u_px, track.v_px))
            rows.writerow(_row(frame, track, view, calibration))
            file.flush()
            drawn = draw_track(frame.image, track, trail, note=f"{frame.index} {frame.t_s:.3f} s")
            if drawn.shape[1::-1] != source.size:  # a film and a sheet have one size
                drawn = np.asarray(cv2.resize(drawn, source.size, interpolation=cv2.INTER_AREA))
            film.add(drawn, frame.t_s)
            sheet.add(drawn)
            tells.say((frame.index + 1, source.frames_total))
    if film.trouble:
        troubles.append(film.trouble)
    return states, times, [*troubles, *_written(sheet, out / SHEET)]


def _written(sheet: ContactSheet, path: Path) -> list[str]:
    """Write the contact sheet; what is said where it cannot be, and no older one stays."""
    try:
        sheet.write(path)
    except OSError as error:
        path.unlink(missing_ok=True)
        return [f"no contact sheet: {error.strerror or error}"]
    return []


def _row(
    frame: Frame, track: Track, view: View | None, calibration: Calibration | None
) -> list[object]:
    """One row of `track.csv`; cells that are not known are blank."""
    row: list[object] = [frame.index, f"{frame.t_s:.6f}", track.state]
    if not math.isfinite(track.u_px):
        return row + [""] * (len(PIXEL_COLUMNS) - 3 + len(METRIC_COLUMNS))
    row += [f"{track.u_px:.4f}", f"{track.v_px:.4f}", f"{track.sigma_px:.4f}"]
    metric: list[object] = [""] * len(METRIC_COLUMNS)
    if view is not None and calibration is not None:
        try:
            xy, cov = view.ball_from_silhouette(
                (track.u_px, track.v_px), calibration.ball_radius_m, track.sigma_px
            )
        except ValueError:  # a prediction beyond the plate's horizon has no place on the plate
            return row + metric
        metric = [f"{x:.7f}" for x in xy]
        metric += [f"{c:.4e}" for c in (cov[0, 0], cov[0, 1], cov[1, 1])]
    return row + metric


def _summary(
    source: Source,
    tracker: Tracker | WholeFilm,
    states: Counter[str],
    times: list[float],
    ball_colour: str | None,
    *,
    metric: bool,
) -> dict[str, Any]:
    appearance = tracker.appearance
    notes: list[str] = []
    if source.missing:
        notes.append(
            f"{source.missing} of {source.frames_total} frames could not be decoded: "
            "the file is truncated"
        )
    if not states["track"]:
        notes.append(
            "no ball was found: nothing round travels in these frames or stands out; "
            "say where it is in the first one (--ball-at U,V)"
        )
    elif not tracker.proven:
        notes.append("what was tracked last never moved: it may be another round thing")
    if not metric:
        notes.append("pixels only: x_m and y_m are blank without --calibration")
    if source.duplicates:
        notes.append(f"{source.duplicates} frames repeat the one before them and were skipped")
    return {
        "address": str(source.address),
        "size_px": list(source.size),
        "frames": sum(states.values()),
        "duplicates": source.duplicates,
        "dropped": source.dropped,
        "missing": source.missing,
        "states": {name: states[name] for name in ("search", "track", "coast", "lost")},
        "start_s": times[0] if times else None,
        "end_s": times[-1] if times else None,
        "ball": {
            "asked_colour": ball_colour,
            "bgr": None
            if appearance is None
            else [round(float(c), 1) for c in appearance.ball_bgr],
            "radius_px": _finite(tracker.radius_px),
        },
        "notes": notes,
    }


def _finite(x: float) -> float | None:
    return round(x, 2) if math.isfinite(x) else None


class ContactSheet:
    """Thumbnails spread evenly over the film at an address, whose length need not be known
    beforehand.
    """

    def __init__(self, address: str) -> None:
        self._address = address
        self._images: list[np.ndarray] = []
        self._every, self._seen = 1, 0

    def add(self, image: np.ndarray) -> None:
        """Offer the next image (h, w, 3) uint8.

        Every n-th is kept; when too many are kept, every other one is dropped and n is doubled.
        """
        import cv2

        if self._seen % self._every == 0:
            height = round(image.shape[0] * SHEET_WIDTH_PX / image.shape[1])
            size = (SHEET_WIDTH_PX, max(1, height))
            self._images.append(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
            if len(self._images) > 2 * SHEET_IMAGES:
                self._images, self._every = self._images[::2], 2 * self._every
        self._seen += 1

    def write(self, path: Path) -> None:
        """Write the sheet as PNG below its title and what the colours mean; nothing without images.
        OSError: it cannot be written.
        """
        import numpy as np

        from vision.overlay import contact_sheet, legend
        from vision.sources.addresses import without_password

        count = len(self._images)
        if count == 0:
            return
        keep = min(SHEET_IMAGES, count)
        chosen = [self._images[i * count // keep] for i in range(keep)]
        sheet = contact_sheet(chosen, min(SHEET_COLUMNS, keep))
        name = Path(without_password(self._address)).name
        named = f"{name}: {keep} of {self._seen} frames"
        write_image(np.vstack([legend(named, sheet.shape[1]), sheet]), path)
