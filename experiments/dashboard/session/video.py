"""Video of a run: frames by time for the replay, or rendered from the recording of a simulation."""

import threading
import time
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.dashboard.session.worker_process import ProgressSender
from vision.sources.encoded_image import MOST_PX

if TYPE_CHECKING:
    from experiments.gap.closed_loop_replay import TableMotion

# A run's video, and its format: left to guess it, the decoder takes a stranger's list of files, of
# pipes and of itself, for a video.
VIDEO, FORMAT = "video.mkv", "matroska"
NO_VIDEO_OF_BOTH = (
    "Two runs on one plate, red with compensation, blue without: there is no video of both. Show "
    "one run alone for its video."
)
STEP_S = 1 / 30  # between frames of a rendered video
TELL_EVERY = 5  # frames; chosen: a busy machine renders so many in a second
SEEK_AHEAD_S = 2.0  # further ahead it seeks, nearer it decodes frame by frame; chosen
WIDEST_PX = 480  # of a shown frame; chosen: a panel is narrower
DECODE_S = 0.02  # so long a call decodes: who draws the film draws the live tables, too
LONGEST_S = 3600.0  # of a rendered video; chosen: twice the longest run that was tried


class Video:
    """Frames of a video file by their time. Any thread may call: a lock lets one at a time use the
    decoder.

    OSError, `av.FFmpegError`: the file is not a video, or its frames are larger than MOST_PX.
    """

    def __init__(self, path: Path) -> None:
        import av

        self._lock = threading.Lock()
        self._file: Any = av.open(str(path), format=FORMAT)
        self._stream: Any = self._file.streams.video[0]
        if self._stream.width * self._stream.height > MOST_PX:
            raise OSError(f"{path}: frames of more than {MOST_PX} pixels")
        self._image: Any = None  # shown from _from_s until _to_s, when the next one is due
        self._frames: Any = iter(())
        self._next: Any = None
        self._from_s, self._to_s = 0.0, -inf
        self._asked_s, self._reached = 0.0, True  # by the last call, and whether that was found

    def at(self, t_s: float) -> np.ndarray | None:
        """The frame (h, w, 3) uint8 RGB at the time `t_s`, past the end the last one.

        Where the way there takes longer than DECODE_S it is one on the way, from which the next
        call goes on. None: the file is closed, or it is the frame that the last call returned.
        """
        from av.error import FFmpegError

        with self._lock:
            if self._file is None or self._from_s <= t_s < self._to_s:
                return None
            try:
                self._go_to(t_s)
            except FFmpegError:  # what comes behind it is not shown
                self._frames, self._to_s, self._reached = iter(()), inf, True
            image = self._image
            if image is None:
                return None
            width = min(WIDEST_PX, image.width)
            height = round(image.height * width / image.width)
            return image.to_ndarray(format="rgb24", width=width, height=height)

    def _go_to(self, t_s: float) -> None:
        """Decode up to the frame at `t_s`, for DECODE_S at most and one frame at least."""
        until_s = time.monotonic() + DECODE_S
        elsewhere = abs(t_s - self._asked_s) > SEEK_AHEAD_S  # than where it is on its way to
        far = t_s >= self._to_s + SEEK_AHEAD_S and (elsewhere or self._reached)
        self._asked_s, self._reached = t_s, False
        if t_s < self._from_s or far:
            self._file.seek(int(t_s / self._stream.time_base), stream=self._stream)
            self._frames = self._file.decode(self._stream)
            self._turn()
            self._to_s = min(self._to_s, t_s)  # a film may begin later
        while t_s >= self._to_s:
            self._turn()
            if time.monotonic() >= until_s:
                break
        self._reached = t_s < self._to_s

    def _turn(self) -> None:
        """Go on to the next frame, and decode the one behind it."""
        if self._next is not None:
            self._image, self._from_s = self._next, self._to_s
        self._next = next(self._frames, None)
        self._to_s = inf if self._next is None else float(self._next.time)

    def close(self) -> None:
        """Close the file; `at` returns None from now on."""
        with self._lock:
            if self._file is not None:
                self._file.close()
            self._file = None


def replay_run(folder: Path, beside: Path | None, name: str, progress: ProgressSender) -> Path:
    """Read a recorded run, then find or render its video; returns the video's path.

    name: what the run is called on the page; beside: the same run with the other controller, shown
    on the same plate; then there is no video; progress: shown the `RunFilm` as soon as it is read.
    OSError, ValueError: a run cannot be read, or it was measured and nobody filmed it;
    `av.FFmpegError`: its video is none.
    """
    from experiments.dashboard.session.playback import run_film
    from experiments.gap.closed_loop_replay import table_motion
    from experiments.records.recording import read_run

    run = read_run(folder)
    progress.show(run_film(name, run, read_run(beside) if beside else None))
    if beside:
        raise ValueError(NO_VIDEO_OF_BOTH)
    video = folder / VIDEO
    if video.is_file():
        Video(video).close()  # what is wrong with it is found out here, not where the pages wait
        return video
    return render_video(video, run.meta, table_motion(run.log), progress)


def render_video(
    video: Path, meta: dict[str, Any], motion: "TableMotion", progress: ProgressSender
) -> Path:
    """Render into the file `video` what the virtual camera saw of a simulated run; returns that
    path.

    meta: the run's run.json; motion: its poses. ValueError: the run was measured, or lasts longer
    than LONGEST_S by its times.
    """
    from experiments.dashboard.session.virtual_camera import VirtualCameraRenderer
    from experiments.track.film import Film
    from rig.rigfile import from_dict

    if meta.get("source") != "simulated":
        raise ValueError("there is no video of this run: no camera's pictures were kept")
    if motion.end_s > LONGEST_S:
        raise ValueError(
            f"by its times the run lasts {motion.end_s:.3g} s: no video is rendered of more than "
            f"{LONGEST_S:g} s; did the clock jump?"
        )
    renderer = VirtualCameraRenderer(from_dict(meta["rig"]))
    unfinished = video.with_name(f"part-{video.name}")
    unfinished.unlink(missing_ok=True)  # in a stranger's folder a link that leads to any file
    times = np.arange(0.0, motion.end_s, STEP_S)
    with Film(unfinished, renderer.size, quick=True) as film:  # somebody waits for it
        for i, t_s in enumerate(times):
            if i % TELL_EVERY == 0:
                progress("rendering the video", i, len(times))
            theta_rad, ball_m, _ = motion.at(float(t_s))
            image, _ = renderer.look(theta_rad, ball_m, float(t_s))
            film.add(image, float(t_s))
    return unfinished.rename(video)
