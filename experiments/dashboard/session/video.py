"""Video of a run: frames by time for the replay, or rendered from the recording of a simulation."""

import threading
from pathlib import Path
from typing import Any

import numpy as np

from experiments.dashboard.session.worker_process import ProgressSender

VIDEO = "video.mkv"
STEP_S = 1 / 30  # between frames of a rendered video
SEEK_AHEAD_S = 2.0  # further ahead it seeks, nearer it decodes frame by frame; chosen
WIDEST_PX = 480  # of a shown frame; chosen: a panel is narrower


class Video:
    """Frames by time. Any thread may call: a lock lets one at a time use the decoder.

    OSError, `av.FFmpegError`: the file is not a video.
    """

    def __init__(self, path: Path) -> None:
        import av

        self._lock = threading.Lock()
        self._file: Any = av.open(str(path))
        self._stream: Any = self._file.streams.video[0]
        self._frames, self._image = self._file.decode(self._stream), None
        self._from_s, self._to_s = 0.0, 0.0  # how long the present image is shown

    def at(self, t_s: float) -> np.ndarray | None:
        """The frame (h, w, 3) RGB at a time [s], past the end the last one.

        None: closed, or the same frame as in the last call.
        """
        with self._lock:
            if self._file is None or self._from_s <= t_s < self._to_s:
                return None
            if not self._from_s <= t_s < self._to_s + SEEK_AHEAD_S:  # further ahead or back: jump
                self._file.seek(int(t_s / self._stream.time_base), stream=self._stream)
                self._frames = self._file.decode(self._stream)
            for frame in self._frames:
                self._from_s, self._to_s = float(frame.time), float(frame.time) + STEP_S
                self._image = frame
                if t_s < self._to_s:
                    break
            else:
                self._to_s = float("inf")
            image = self._image
            if image is None:
                return None
            width = min(WIDEST_PX, image.width)
            height = round(image.height * width / image.width)
            return image.to_ndarray(format="rgb24", width=width, height=height)

    def close(self) -> None:
        """Close the file; `at` returns None from now on."""
        with self._lock:
            if self._file is not None:
                self._file.close()
            self._file = None


def render_video(folder: Path, progress: ProgressSender) -> Path:
    """Render what the virtual camera saw of the measured poses of a simulated run; the file's path.

    ValueError: the run was measured, or has no rows.
    """
    from experiments.dashboard.session.virtual_camera import VirtualCameraRenderer
    from experiments.gap.closed_loop_replay import table_motion
    from experiments.records.recording import read_run
    from experiments.track.film import Film
    from rig.rigfile import from_dict

    run = read_run(folder)
    if run.meta.get("source") != "simulated":
        raise ValueError("nobody filmed this run: there is no video of it")
    motion, renderer = table_motion(run.log), VirtualCameraRenderer(from_dict(run.meta["rig"]))
    unfinished = folder / f"part-{VIDEO}"
    times = np.arange(0.0, motion.end_s, STEP_S)
    with Film(unfinished, renderer.size) as film:
        for i, t_s in enumerate(times):
            if i % 30 == 0:
                progress("rendering the video", i, len(times))
            theta_rad, ball_m, _ = motion.at(float(t_s))
            image, _ = renderer.look(theta_rad, ball_m, float(t_s))
            film.add(image, float(t_s))
    return unfinished.rename(folder / VIDEO)
