"""Where is the plate in the image? Its markers, how they are found, and the pose from them."""

from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import cv2
import numpy as np

from vision.plate.edges import cut_edges, fit_motion
from vision.view import Camera, View

_CUTS = 8  # profiles across each side of a marker
_FINE = 2  # px searched for an edge on each side of where it is expected, once nearly there
_FLOOR_PX = 0.02  # printed edges are assumed to be no straighter than this
_RMS_LIMIT_PX = 0.2  # of the residuals, above which a fit is refused
_STILL_PX = 0.3  # a fit whose last step moves an edge by more than this has not converged
_TILT_LIMIT_RAD = np.radians(0.2)


def dictionary_of(name: str) -> cv2.aruco.Dictionary:
    """OpenCV's dictionary of markers of this name, for example "DICT_4X4_50". `ValueError`: it has
    none."""
    number = getattr(cv2.aruco, name, None) if name.startswith("DICT_") else None
    if number is None:
        raise ValueError(f"OpenCV has no marker dictionary {name!r}")
    return cv2.aruco.getPredefinedDictionary(number)


@dataclass(frozen=True, eq=False)
class MarkerLayout:
    """Printed ArUco markers: `ids` (n,), `corners_m` (n, 4, 2) in the plate frame [m].

    Corners in ArUco's order: top left, top right, bottom right, bottom left of the printed marker.
    `dictionary`: name of an OpenCV dictionary, for example "DICT_4X4_50".

    `ValueError`: shapes that do not match, ids that repeat or an unknown dictionary.
    """

    ids: np.ndarray
    corners_m: np.ndarray
    dictionary: str = "DICT_4X4_50"

    def __post_init__(self) -> None:
        ids = np.asarray(self.ids, int).reshape(-1)
        corners = np.asarray(self.corners_m, float)
        if corners.shape != (len(ids), 4, 2) or len(set(ids.tolist())) != len(ids):
            raise ValueError(
                f"marker layout: {len(ids)} ids need corners of shape ({len(ids)}, 4, 2) and must "
                f"differ; got shape {corners.shape}"
            )
        dictionary_of(self.dictionary)
        object.__setattr__(self, "ids", ids)
        object.__setattr__(self, "corners_m", corners)

    @cached_property
    def module_m(self) -> float:
        """Side [m] of one printed square of the smallest marker."""
        sides = np.linalg.norm(np.roll(self.corners_m, -1, axis=1) - self.corners_m, axis=2)
        book = dictionary_of(self.dictionary)
        return float(sides.min()) / (book.markerSize + 2)

    @cached_property
    def edge_points(self) -> tuple[np.ndarray, np.ndarray]:
        """Points (4 n k, 2) [m] on the markers' sides, k on each, and unit directions (4 n k, 2),
        clockwise along the sides."""
        start = self.corners_m[:, :, None]  # (n, 4, 1, 2)
        side = np.roll(self.corners_m, -1, axis=1)[:, :, None] - start
        share = np.linspace(0.14, 0.86, _CUTS)[:, None]  # away from the rounded corners
        points = (start + share * side).reshape(-1, 2)
        along = np.broadcast_to(side / np.linalg.norm(side, axis=3, keepdims=True), start.shape)
        return points, np.repeat(along.reshape(-1, 2), _CUTS, axis=0)


def default_layout(plate_side_m: float, marker_side_m: float = 0.024) -> MarkerLayout:
    """Eight markers, 5 mm inside the plate's edge: four in the corners, four mid-edge. The middle
    stays free for the ball, which hides at most two of them.

    `ValueError`: the plate is too small for them.
    """
    far = plate_side_m / 2 - 0.005 - marker_side_m / 2
    if not 0 < 1.5 * marker_side_m <= far:
        raise ValueError(f"a plate of {plate_side_m} m has no room for {marker_side_m} m markers")
    places = [(-1, 1), (0, 1), (1, 1), (-1, 0), (1, 0), (-1, -1), (0, -1), (1, -1)]
    square = 0.5 * marker_side_m * np.array([(-1, 1), (1, 1), (1, -1), (-1, -1)])
    centres = far * np.array(places, float)
    return MarkerLayout(np.arange(len(places)), centres[:, None] + square)


class PoseFit(NamedTuple):
    """The plate's pose in one image, with the residuals' rms [px] (NaN: nothing was seen) and the
    number of markers' corners that fit.

    `n_corners` 0: the fit was refused, and `view` is the guess unchanged.
    """

    view: View
    rms_px: float
    n_corners: int

    @property
    def accepted(self) -> bool:
        """Whether `view` is a measured pose."""
        return self.n_corners > 0


class FoundMarkers(NamedTuple):
    """Markers found in a whole image: `ids` (k,), `corners_px` (k, 4, 2), corners in the order of
    `MarkerLayout`."""

    ids: np.ndarray
    corners_px: np.ndarray


def detect(image: np.ndarray, layout: MarkerLayout) -> FoundMarkers:
    """The layout's markers anywhere in an image (h, w[, 3]) uint8; an id that is seen twice is left
    out, because one of the two is a reflection or a second plate. Takes 2 to 20 ms."""
    corners, ids, _ = _detector(layout.dictionary).detectMarkers(image)
    if ids is None or len(corners) == 0:
        return FoundMarkers(np.zeros(0, int), np.zeros((0, 4, 2)))
    found = np.asarray(ids).reshape(-1).astype(int)
    corners_px = np.asarray(corners, float).reshape(-1, 4, 2)
    # An id seen twice is a reflection or a second plate: neither can be trusted.
    once = [np.sum(found == i) == 1 and i in layout.ids for i in found]
    return FoundMarkers(found[once], corners_px[once])


def find_pose(image: np.ndarray, layout: MarkerLayout, camera: Camera) -> PoseFit | None:
    """The plate's pose from one image (h, w, 3) uint8 without a guess; None where under three
    markers are seen or no fit is accepted.

    A plane seen from afar has two poses that look alike (IPPE: Collins and Bartoli, Int. J. Comput.
    Vis. 109, 2014); both are refined by `track_pose`, and the one with the smaller residual is
    returned.
    """
    found = detect(image, layout)
    if len(found.ids) < 3:
        return None
    rows = [int(np.flatnonzero(layout.ids == i)[0]) for i in found.ids]
    flat = layout.corners_m[rows].reshape(-1, 2)
    points = np.column_stack((flat, np.zeros(len(flat))))
    rays = camera.ray_from_pixel(found.corners_px.reshape(-1, 2))
    count, turns, shifts, _ = cv2.solvePnPGeneric(
        points, rays, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
    )
    fits = []
    for k in range(int(count)):
        pose = np.eye(4)
        pose[:3, :3] = np.asarray(cv2.Rodrigues(np.asarray(turns[k]))[0])
        pose[:3, 3] = np.asarray(shifts[k]).reshape(3)
        fits.append(track_pose(image, layout, View(camera, pose)))
    good = [fit for fit in fits if fit.accepted]
    return min(good, key=lambda fit: fit.rms_px) if good else None


def track_pose(
    image: np.ndarray,
    layout: MarkerLayout,
    view_guess: View,
    *,
    ball: tuple[float, float, float] | None = None,
) -> PoseFit:
    """The plate's pose near `view_guess`, which must put the markers within about 0.8 of a printed
    square; robust Gauss-Newton steps on the printed edges (`edges`).

    `image` (h, w, 3) uint8; `ball` (u, v, radius) px is what hides the plate, if known; whatever
    else hides an edge is left out as an outlier. The view's `pose_cov` holds the fit's covariance.

    The fit is refused (`n_corners` 0, view = guess) when under a third of all edges, two thirds of
    those seen or a quarter of the corners fit (a shift by one printed square lets some sides fit),
    when they leave a tilt uncertain by more than 0.2 degrees, when the fit does not come to rest,
    or when the rms exceeds 0.2 px.
    """
    view, moved_px = view_guess, np.inf
    for coarse in (True, False, False, False):
        cut = _cut(image, layout, view, ball, coarse=coarse)
        motion, weight, normal = fit_motion(*cut, _FLOOR_PX)
        if not weight.any():
            return PoseFit(view_guess, float("nan"), 0)
        view = View(view.camera, _moved(view.camera_from_plate, motion))
        moved_px = float(np.abs(cut[2] @ motion).max())
        if not coarse and moved_px < _STILL_PX:
            break
    offset, contrast, jacobian = cut
    kept = weight > 0
    left = (offset - jacobian @ motion)[kept]
    rms = float(np.sqrt(np.mean(left * left)))
    cov = _covariance(offset - jacobian @ motion, weight, jacobian, np.linalg.inv(normal), rms)
    tilt_std = float(np.sqrt(np.linalg.eigvalsh(cov[:3, :3])[-1]))
    corners = _corners_seen(kept)
    few = 3 * kept.sum() < max(len(kept), 2 * (contrast > 0).sum()) or corners < len(layout.ids)
    if few or moved_px > _STILL_PX or rms > _RMS_LIMIT_PX or tilt_std > _TILT_LIMIT_RAD:
        return PoseFit(view_guess, rms, 0)
    return PoseFit(View(view.camera, view.camera_from_plate, cov), rms, corners)


def _covariance(left, weight, jacobian, inverse, rms: float) -> np.ndarray:
    """Of the pose (6, 6); a side that was printed or seen askew errs in all of its cuts alike.

    White errors of the rms, times what the sums over whole sides J'Wr say beyond them.
    """
    white = max(rms, _FLOOR_PX) ** 2
    sums = (jacobian * (weight * left)[:, None]).reshape(-1, _CUTS, 6).sum(axis=1)
    sides = max(int(np.any(sums != 0, axis=1).sum()), 7)
    together = np.einsum("si,ij,sj->", sums, inverse, sums) / (6 * white) * sides / (sides - 6)
    return white * max(1.0, float(together)) * inverse


def edge_offsets(image: np.ndarray, layout: MarkerLayout, view: View) -> np.ndarray:
    """Distances (n, 4, 8) [px] by which the print's edges lie inside those that `view` expects, in
    an image (h, w, 3) uint8: marker, side, cut.

    Eight cuts a side, from its first corner to the next; NaN where no edge was seen.
    """
    offset, contrast, _ = _cut(image, layout, view, None, coarse=True)
    return np.where(contrast > 0, offset, np.nan).reshape(-1, 4, _CUTS)


def residual_edges(
    image: np.ndarray, layout: MarkerLayout, view: View
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """How the print's edges lie off a pose that was fitted to them, in an image (h, w, 3) uint8.

    Returns, of each cut, how far it lies off [px] and its weight in the fit, 0 for an outlier
    (m,); its Jacobian (m, 6) by the pose, ordered as `View.pose_cov`; its row in the image (m,).
    """
    cut = _cut(image, layout, view, None, coarse=False)
    _, weight, _ = fit_motion(*cut, _FLOOR_PX)
    points, _ = layout.edge_points
    rows = view.pixel_from_plate(np.column_stack((points, np.zeros(len(points)))))[:, 1]
    return cut[0], weight, cut[2], rows


def _cut(image, layout: MarkerLayout, view: View, ball, *, coarse: bool):
    points, along = layout.edge_points
    hidden = ball if ball is not None else (-1e6, -1e6, 0.0)
    # The levels beside an edge are read inside its own module of the print.
    module_px = layout.module_m * view.camera.pinhole[0] / max(view.camera_from_plate[2, 3], 1e-3)
    reach = 3 if module_px > 4.8 else 2
    # One module further lies the next edge, of the other sign; two further the next like this.
    search = int(np.clip(0.85 * module_px, 3, 12)) if coarse else _FINE
    return cut_edges(image, points, along, view, search, reach, hidden)


def _moved(pose: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """The pose after a small rotation vector and translation along the camera's axes."""
    new = pose.copy()
    new[:3, :3] = np.asarray(cv2.Rodrigues(motion[:3])[0]) @ pose[:3, :3]
    new[:3, 3] += motion[3:]
    return new


def _corners_seen(kept: np.ndarray) -> int:
    """Corners between two sides that both were seen (at least half of their cuts)."""
    sides = kept.reshape(-1, 4, _CUTS).mean(axis=2) >= 0.5  # (n, 4): side i ends in corner i + 1
    return int(np.sum(sides & np.roll(sides, 1, axis=1)))


@cache
def _detector(dictionary: str) -> cv2.aruco.ArucoDetector:
    book = dictionary_of(dictionary)
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    return cv2.aruco.ArucoDetector(book, parameters)
