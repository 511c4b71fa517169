"""Where is the ball on the plate, in metres, with which covariance? One call per frame.

`BallCamera` joins the tracker (pixels), the plate's markers (pose) and the geometry of a sphere
over a plane (`view.View.ball_from_silhouette`).
"""

from dataclasses import replace
from itertools import product

import cv2
import numpy as np

from vision.detection.appearance import Appearance
from vision.frames import Frame, Observation, Track
from vision.plate.markers import MarkerLayout, PoseFit, find_pose, track_pose
from vision.tracking.tracker import Tracker
from vision.tracking.whole_film import WholeFilm
from vision.view import View

# Where no markers are seen, the encoders give the tilt: backlash hides about this much of it.
_HINT_STD_RAD, _HINT_STD_M = np.radians(0.3), 0.0003
_HINT_COV = np.diag([_HINT_STD_RAD**2] * 3 + [_HINT_STD_M**2] * 3)
_EDGE_FLOOR_PX = 0.03  # shading and cast shadow move an outline by about this; sigma_px lacks it
_OVERHANG_M = 0.004  # a ball whose centre is further outside the plate's edge is falling
_RETRY_FRAMES = 30  # a search of the whole image costs several frames' time


class BallCamera:
    """Measures one ball on one plate, frame by frame.

    `view` is the calibrated camera with the plate level, `layout` the plate's markers, `radius_m`
    the ball's radius. With `plate_side_m`, a ball whose centre lies more than 4 mm off the plate is
    not reported. `late_s`: how long after its light a frame is stamped [s]. `pose` is the last
    frame's fit to the markers (`pose.accepted`: whether it held).
    """

    def __init__(
        self,
        view: View,
        layout: MarkerLayout,
        tracker: Tracker | WholeFilm,
        radius_m: float,
        *,
        plate_side_m: float | None = None,
        late_s: float = 0.0,
    ) -> None:
        self._level, self._layout, self._tracker, self._radius_m = view, layout, tracker, radius_m
        self._late_s = late_s
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
        max_tilt_rad: float,
        *,
        appearance: Appearance | None = None,
        late_s: float = 0.0,
    ) -> "BallCamera":
        """A ball camera whose tracker searches only where, and for sizes that, the geometry allows.

        `view`, `layout`, `radius_m`, `plate_side_m`, `late_s`: as of the class; `max_tilt_rad`: the
        plate's largest tilt about either axis; `appearance`: as of `Tracker`.

        `ValueError`: the plate does not lie in front of the camera.
        """
        tracker = Tracker(
            appearance=appearance,
            radius_px=radius_range(view, radius_m, plate_side_m, max_tilt_rad),
            mask=ball_mask(view, radius_m, plate_side_m, max_tilt_rad),
        )
        return cls(view, layout, tracker, radius_m, plate_side_m=plate_side_m, late_s=late_s)

    def step(
        self, frame: Frame, rotation_hint: np.ndarray
    ) -> tuple[Observation | None, Track, View]:
        """Process one frame; frames come in order of time.

        `rotation_hint` (3, 3): world_from_plate from the encoders. Returns the observation (None
        unless the tracker measured the ball in this very frame), the track in pixels, and the view
        with the plate's pose: from the markers, or from the hint with a larger `pose_cov` where the
        markers were not seen.
        """
        track = self._tracker.step(frame)
        view = self._see_plate(frame, track, rotation_hint)
        return self._observe(frame, track, view), track, view

    @property
    def drift_m(self) -> float:
        """Sideways distance [m] of the plate's centre from where the calibration saw it; NaN while
        the markers are not seen.

        The plate turns about its centre, so more than 1 to 2 mm means that camera or table was
        moved.
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
                pose = find_pose(frame.image, self._layout, self._level.camera)
                self.pose = pose or self.pose
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
        spread = float(cov[0, 0]), float(cov[0, 1]), float(cov[1, 1])
        exposed_s = frame.t_s - self._late_s + view.camera.row_s(track.v_px)
        return Observation(where, spread, exposed_s)


def _extremes(view: View, plate_side_m: float, max_tilt_rad: float):
    """(view, xy): the ball's centre over the plate's corners, at every combination of tilts."""
    far = plate_side_m / 2 + _OVERHANG_M
    for tilt_x, tilt_y in product((-max_tilt_rad, 0.0, max_tilt_rad), repeat=2):
        turn, _ = cv2.Rodrigues(np.array([-tilt_y, tilt_x, 0.0]))
        tilted = view.tilted(np.asarray(turn))
        for x, y in product((-far, far), repeat=2):
            yield tilted, (x, y)


def radius_range(
    view: View, radius_m: float, plate_side_m: float, max_tilt_rad: float
) -> tuple[float, float]:
    """Smallest and largest mean radius [px] of the ball's outline anywhere on the plate at any tilt
    up to `max_tilt_rad` about either axis, widened by 10 %.

    `ValueError`: the plate does not lie in front of the camera.
    """
    places = _extremes(view, plate_side_m, max_tilt_rad)
    radii = [tilted.silhouette_from_ball(xy, radius_m)[2] for tilted, xy in places]
    return 0.9 * min(radii), 1.1 * max(radii)


def ball_mask(view: View, radius_m: float, plate_side_m: float, max_tilt_rad: float) -> np.ndarray:
    """Mask (h, w) uint8: 255 where any part of a ball on the plate, at any tilt up to
    `max_tilt_rad` about either axis, can be seen; else 0."""
    places = _extremes(view, plate_side_m, max_tilt_rad)
    outlines = [tilted.outline_from_ball(xy, radius_m) for tilted, xy in places]
    hull = cv2.convexHull(np.concatenate(outlines).astype(np.float32))
    mask = np.zeros((view.camera.height_px, view.camera.width_px), np.uint8)
    corners = np.rint(np.asarray(hull).reshape(-1, 2)).astype(np.int32)
    cv2.fillConvexPoly(mask, corners, (255,))
    return cv2.dilate(mask, np.ones((5, 5), np.uint8))
