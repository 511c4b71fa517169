"""The plate's tilt as its markers show it, picture by picture: what homing believes."""

import numpy as np

from vision.frames import Frame, Observation, Track
from vision.plate.markers import MarkerLayout, find_pose, track_pose
from vision.view import View

LOOK_AFRESH = 5  # pictures without markers, and the whole picture is searched for them again


class MarkerTilt:
    """Measures the plate's tilt by its markers, in the place of a ball camera (`eye.see`).

    level: calibrated view of the level plate; layout: of the markers on the plate.
    """

    def __init__(self, level: View, layout: MarkerLayout) -> None:
        self._level, self._layout, self._last, self._misses = level, layout, level, 0

    def step(
        self, frame: Frame, rotation_hint: np.ndarray
    ) -> tuple[Observation | None, Track, View]:
        """Return (observation, track, view); the observation's xy_m holds (sin phi_x, sin phi_y).

        None, and a lost track, where too few markers are seen. rotation_hint is not used.
        """
        fit = track_pose(frame.image, self._layout, self._last)
        if not fit.accepted and self._misses % LOOK_AFRESH == 0:
            fit = find_pose(frame.image, self._layout, self._level.camera) or fit
        if not fit.accepted:
            self._misses += 1
            return None, Track("lost"), self._last
        self._misses, self._last = 0, fit.view
        seen = Observation(sines(fit.view, self._level), (0.0, 0.0, 0.0), frame.t_s)
        return seen, Track("track"), fit.view


def sines(view: View, level: View) -> tuple[float, float]:
    """(sin phi_x, sin phi_y) [1]: how far the +x and +y sides lie below those of the level plate.

    They are the third row of world_from_plate, negated; view: of the frame, level: of the level
    plate.
    """
    turn = level.camera_from_plate[:3, :3].T @ view.camera_from_plate[:3, :3]
    return float(-turn[2, 0]), float(-turn[2, 1])
