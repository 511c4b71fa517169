"""What a camera's process lets others look at: a small picture now and then, if somebody asks.

Shared memory, one writer, one reader. While nobody looks it costs the camera's process one glance
at a number a frame.
"""

import time

import numpy as np

from rig.shared_memory import SharedArray
from vision.frames import Observation, Track

SMALL = (320, 240)
EVERY_S = 0.1
PICTURE = np.dtype(
    [
        ("number", np.int64),
        ("asked_s", np.float64),
        ("state", "S8"),
        ("track", np.float64, (4,)),
        ("seen", np.float64, (6,)),
        ("image", np.uint8, (*SMALL[::-1], 3)),
    ]
)
ASKED_FOR_S = 2.0  # whoever looks asks again and again; who has gone does not


class Preview:
    """Shared small picture of what a camera sees; pickled to spawned processes by its name.

    `show` in the process that sees, `look` in the one that displays.
    """

    def __init__(self) -> None:
        self._shared = SharedArray((1,), PICTURE)
        self._shown_s, self._taken = 0.0, 0

    @property
    def _one(self) -> np.ndarray:
        return self._shared.array[0]

    def show(self, image: np.ndarray, track: Track, seen: Observation | None) -> None:
        """Keep a frame (h, w[, 3]) uint8 BGR and what was made of it, where somebody has asked
        for it.
        """
        if len(self._shared.array) == 0:
            return
        now_s = time.monotonic()
        if now_s - self._shown_s < EVERY_S or now_s - self._one["asked_s"] > ASKED_FOR_S:
            return
        import cv2

        from vision.overlay import draw_track

        self._shown_s = now_s
        colour = image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
        drawn = cv2.resize(draw_track(colour, track, ()), SMALL, interpolation=cv2.INTER_AREA)
        self._one["image"] = drawn[:, :, ::-1]
        self._one["state"] = track.state.encode()
        self._one["track"] = track.u_px, track.v_px, track.sigma_px, track.radius_px
        nothing = (np.nan,) * 6
        self._one["seen"] = (*seen.xy_m, *seen.cov_m2, seen.exposed_s) if seen else nothing
        self._one["number"] += 1  # last: the reader looks at this first

    def look(self) -> tuple[np.ndarray, Track, Observation | None] | None:
        """Ask for pictures; return the one that came since the last call, else None.

        It is (image, track, observation): RGB uint8 (240, 320, 3), the tracker's state and where
        the ball was seen, None where it was not.
        """
        if len(self._shared.array) == 0:
            return None
        self._one["asked_s"] = time.monotonic()
        number = int(self._one["number"])
        if number == self._taken:
            return None
        self._taken = number
        one = self._one
        track = Track(bytes(one["state"]).decode(), *(float(v) for v in one["track"]))
        x, y, xx, xy, yy, at_s = (float(v) for v in one["seen"])
        seen = Observation((x, y), (xx, xy, yy), at_s) if np.isfinite(x) else None
        return one["image"].copy(), track, seen

    def close(self) -> None:
        """Let go of the shared memory; the process that made it frees it."""
        self._shared.close()
