"""From a frame to "the ball was at (x, y) m at time t, with this covariance"."""

from dataclasses import replace
from itertools import product

import cv2
import numpy as np

from vision.appearance import Appearance
from vision.frames import Frame, Observation, Track
from vision.markers import MarkerLayout, PoseFit, find_pose, track_pose
from vision.tracker import Tracker
from vision.view import View

# Where the markers are not seen, the encoders' word is taken: play hides about this much tilt.
_HINT_STD_RAD, _HINT_STD_M = np.radians(0.3), 0.0003
_HINT_COV = np.diag([_HINT_STD_RAD**2] * 3 + [_HINT_STD_M**2] * 3)
_EDGE_FLOOR_PX = 0.03  # shading and the cast shadow move an outline by about this, unseen by sigma
_OVERHANG_M = 0.004  # a ball whose centre is further outside the plate's edge is falling
_MAX_TILT = 0.105  # sine of 6 degrees, beyond the servo's stops
_RETRY_FRAMES = 30  # a search of the whole image costs several frames' time


class BallCamera:
    """Sees one ball on one plate, frame by frame.

    `view` is the calibrated camera with the plate level, `layout` its markers, `radius_m` the
    ball's radius. With `plate_side_m`, a ball whose centre lies off the plate is not believed.
    `pose` is the last frame's fit to the markers (`pose.accepted` tells whether it held).
    """

    def __init__(
        self,
        view: View,
        layout: MarkerLayout,
        tracker: Tracker,
        radius_m: float,
        *,
        plate_side_m: float | None = None,
    ) -> None:
        self._level, self._layout, self._tracker, self._radius_m = view, layout, tracker, radius_m
        self._reach_m = np.inf if plate_side_m is None else plate_side_m / 2 + _OVERHANG_M
        self._last = view
        self._misses = 0
        self.pose = PoseFit(view, float("nan"), 0)

    @classmethod
    def over_plate(
        cls,
        view: View,
        layout: MarkerLayout,
        radius_m: float,
        plate_side_m: float,
        *,
        appearance: Appearance | None = None,
    ) -> "BallCamera":
        """A ball camera whose tracker knows from the geometry where and how large the ball is."""
        tracker = Tracker(
            appearance=appearance,
            radius_px=radius_range(view, radius_m, plate_side_m),
            mask=ball_mask(view, radius_m, plate_side_m),
        )
        return cls(view, layout, tracker, radius_m, plate_side_m=plate_side_m)

    def step(
        self, frame: Frame, rotation_hint: np.ndarray
    ) -> tuple[Observation | None, Track, View]:
        """Observe one frame; `rotation_hint` (3, 3) is world_from_plate as the encoders tell it.

        The observation is None unless the tracker measured the ball in this very frame. The view
        is the plate as seen, or as hinted where the markers were not (its `pose_cov` says so).
        """
        track = self._tracker.step(frame)
        view = self._see_plate(frame, track, rotation_hint)
        return self._observe(frame, track, view), track, view

    @property
    def drift_m(self) -> float:
        """How far the plate's centre has moved sideways in the camera since the calibration.

        The plate turns about its centre, so more than a millimetre or two means that camera or
        table was knocked. NaN while the markers are not seen.
        """
        if not self.pose.accepted:
            return float("nan")
        moved = self.pose.view.camera_from_plate[:2, 3] - self._level.camera_from_plate[:2, 3]
        return float(np.hypot(moved[0], moved[1]))

    def _see_plate(self, frame: Frame, track: Track, rotation_hint: np.ndarray) -> View:
        ball = None
        if track.state in ("track", "coast"):
            ball = (track.u_px, track.v_px, track.radius_px + 1.0 + 2.0 * track.sigma_px)
        hinted = self._level.tilted(rotation_hint)
        self.pose = track_pose(frame.image, self._layout, hinted, ball=ball)
        if not self.pose.accepted:
            self.pose = track_pose(frame.image, self._layout, self._last, ball=ball)
        if not self.pose.accepted:
            self._misses += 1
            if self._misses % _RETRY_FRAMES == 3:
                found = find_pose(frame.image, self._layout, self._level.camera)
                self.pose = found or self.pose
        if not self.pose.accepted:
            return replace(hinted, pose_cov=_HINT_COV)
        self._misses, self._last = 0, self.pose.view
        return self.pose.view

    def _observe(self, frame: Frame, track: Track, view: View) -> Observation | None:
        if track.state != "track":
            return None
        sigma_px = float(np.hypot(track.sigma_px, _EDGE_FLOOR_PX))
        try:
            xy, cov = view.ball_from_silhouette((track.u_px, track.v_px), self._radius_m, sigma_px)
        except ValueError:  # the ray misses the plate: not our ball
            return None
        if np.abs(xy).max() > self._reach_m:
            return None
        where = float(xy[0]), float(xy[1])
        return Observation(where, (float(cov[0, 0]), float(cov[0, 1]), float(cov[1, 1])), frame.t_s)


def _extremes(view: View, plate_side_m: float):
    """The plate's corners (the ball's centre above them) at every extreme tilt: (view, xy)."""
    far = plate_side_m / 2 + _OVERHANG_M
    for s_x, s_y in product((-_MAX_TILT, 0.0, _MAX_TILT), repeat=2):
        turn, _ = cv2.Rodrigues(np.array([-s_y, s_x, 0.0]))
        tilted = view.tilted(np.asarray(turn))
        for x, y in product((-far, far), repeat=2):
            yield tilted, (x, y)


def radius_range(view: View, radius_m: float, plate_side_m: float) -> tuple[float, float]:
    """Smallest and largest mean radius in px of the ball's outline, with 10 % to spare."""
    radii = [v.silhouette_from_ball(xy, radius_m)[2] for v, xy in _extremes(view, plate_side_m)]
    return 0.9 * min(radii), 1.1 * max(radii)


def ball_mask(view: View, radius_m: float, plate_side_m: float) -> np.ndarray:
    """(h, w) uint8: 255 where any part of a ball on the plate, at any tilt, can be seen."""
    outlines = [v.outline_from_ball(xy, radius_m) for v, xy in _extremes(view, plate_side_m)]
    hull = cv2.convexHull(np.concatenate(outlines).astype(np.float32))
    mask = np.zeros((view.camera.height_px, view.camera.width_px), np.uint8)
    corners = np.rint(np.asarray(hull).reshape(-1, 2)).astype(np.int32)
    cv2.fillConvexPoly(mask, corners, (255,))
    return cv2.dilate(mask, np.ones((5, 5), np.uint8))
