"""A run's video: read by time for the replay; rendered from the recording where nobody filmed."""

import threading
from pathlib import Path
from typing import Any

import numpy as np

from experiments.dashboard.desk import Tell

VIDEO = "video.mkv"
STEP_S = 1 / 30
WIDEST_PX = 480


class Video:
    """Frames by time. Threads may ask and close at any time: FFmpeg allows one at a time."""

    def __init__(self, path: Path) -> None:
        import av

        self._lock = threading.Lock()
        self._file: Any = av.open(str(path))
        self._stream: Any = self._file.streams.video[0]
        self._frames, self._image = self._file.decode(self._stream), None
        self._from_s, self._to_s = 0.0, 0.0  # how long the present image is shown

    def at(self, t_s: float) -> np.ndarray | None:
        """The image (h, w, 3) RGB at a time: its last one past the end; None once it is closed or
        where the same image is shown as before."""
        with self._lock:
            if self._file is None or self._from_s <= t_s < self._to_s:
                return None
            if not self._from_s <= t_s < self._to_s + 2.0:  # further ahead or back: jump
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
        with self._lock:
            if self._file is not None:
                self._file.close()
            self._file = None


def render_video(folder: Path, tell: Tell) -> Path:
    """The video of a simulated run: what the virtual camera saw of the measured poses."""
    from experiments.dashboard.sides import motion_of
    from experiments.dashboard.virtual_eye import Looker
    from experiments.film import Film
    from experiments.recording import read_run
    from rig.rigfile import from_dict

    run = read_run(folder)
    if run.meta.get("source") != "simulated":
        raise ValueError("nobody filmed this run: there is no video of it")
    motion, looker = motion_of(run.log), Looker(from_dict(run.meta["rig"]))
    part = folder / f"part-{VIDEO}"
    times = np.arange(0.0, motion.end_s, STEP_S)
    with Film(part, looker.size) as film:
        for i, t_s in enumerate(times):
            if i % 30 == 0:
                tell("rendering the video", i, len(times))
            theta, ball, _ = motion.at(float(t_s))
            there = (float(ball[0]), float(ball[1])) if np.isfinite(ball).all() else None
            image, _ = looker.look((float(theta[0]), float(theta[1])), there, float(t_s))
            film.add(image, float(t_s))
    return part.rename(folder / VIDEO)
