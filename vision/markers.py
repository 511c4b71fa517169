"""Markers on the plate: where they are, how to find them, and the plate's pose from them."""

from dataclasses import dataclass

import cv2
import numpy as np


@dataclass(frozen=True, eq=False)
class MarkerLayout:
    """Printed ArUco markers: `ids` (n,), `corners_m` (n, 4, 2) in the plate frame.

    Corners in ArUco's order: top left, top right, bottom right, bottom left of the printed marker.
    `dictionary` is the name of an OpenCV dictionary, for example "DICT_4X4_50".
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
        if not hasattr(cv2.aruco, self.dictionary):
            raise ValueError(f"marker layout: OpenCV has no dictionary {self.dictionary!r}")
        object.__setattr__(self, "ids", ids)
        object.__setattr__(self, "corners_m", corners)


def default_layout(plate_side_m: float, marker_side_m: float = 0.024) -> MarkerLayout:
    """Eight markers, 5 mm inside the plate's edge: four in the corners, four mid-edge.

    The ball spends its time in the middle, which stays free; it hides at most two of them.
    """
    far = plate_side_m / 2 - 0.005 - marker_side_m / 2
    if far < 1.5 * marker_side_m:
        raise ValueError(f"a plate of {plate_side_m} m has no room for {marker_side_m} m markers")
    places = [(-1, 1), (0, 1), (1, 1), (-1, 0), (1, 0), (-1, -1), (0, -1), (1, -1)]
    square = 0.5 * marker_side_m * np.array([(-1, 1), (1, 1), (1, -1), (-1, -1)])
    centres = far * np.array(places, float)
    return MarkerLayout(np.arange(len(places)), centres[:, None] + square)
