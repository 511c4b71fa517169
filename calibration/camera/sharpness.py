"""How blurred a picture of a chessboard is: the width of its edges in px."""

import cv2
import numpy as np

_REACH_PX, _STEP_PX = 4.0, 0.5
_OFFSETS = np.arange(-_REACH_PX, _REACH_PX + _STEP_PX / 2, _STEP_PX)
_MIN_EDGES = 6


def edge_blur_px(grey: np.ndarray, places: np.ndarray, pixels: np.ndarray) -> float:
    """Standard deviation [px] of the blur of the edges between neighbouring chessboard corners.

    `grey` (h, w) uint8; `places` (n, 2) integers: column and row of each corner on the board;
    `pixels` (n, 2): where it is seen. The result is the larger median of the board's two
    directions, so that shake in one of them shows. An edge blurred by s has a steepest slope of
    contrast/(sqrt(2 pi) s). NaN: fewer than 6 clear edges in both directions.
    """
    at = {(int(c), int(r)): i for i, (c, r) in enumerate(places)}
    worst = np.nan
    for step in ((1, 0), (0, 1)):
        pairs = [(i, at.get((c + step[0], r + step[1]))) for (c, r), i in at.items()]
        ends = np.array([(i, j) for i, j in pairs if j is not None], int).reshape(-1, 2)
        if len(ends) < _MIN_EDGES:
            continue
        widths = _widths(grey, pixels[ends[:, 0]], pixels[ends[:, 1]])
        if widths.size >= _MIN_EDGES:
            worst = np.fmax(worst, np.median(widths))
    return float(worst)


def _widths(grey: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Blur of each edge from `start` to `end` (n, 2) px, looked at in its middle (m,)."""
    along = end - start
    length = np.linalg.norm(along, axis=1)
    usable = length > 2.5 * _REACH_PX  # else the profile meets the next edge
    start, along, length = start[usable], along[usable], length[usable]
    if not len(start):
        return np.zeros(0)
    across = np.column_stack((-along[:, 1], along[:, 0])) / length[:, None]
    profiles = []
    for share in (0.44, 0.5, 0.56):
        points = (start + share * along)[:, None] + _OFFSETS[:, None] * across[:, None]
        u, v = points[..., 0].astype(np.float32), points[..., 1].astype(np.float32)
        profiles.append(cv2.remap(grey, u, v, cv2.INTER_LINEAR).astype(float))
    profile = np.mean(profiles, axis=0)
    contrast = profile.max(axis=1) - profile.min(axis=1)
    slope = np.abs(np.diff(profile, axis=1)).max(axis=1) / _STEP_PX
    clear = contrast > 40
    return contrast[clear] / (np.sqrt(2 * np.pi) * slope[clear])


def picture_blur_px(grey: np.ndarray) -> float:
    """Standard deviation [px] of the blur of the steepest edges in any picture (h, w) uint8 with
    black and white in it; no corners are needed.

    Used are the steepest thousandth of the pixels along u and along v, with a contrast over 60; the
    result is the larger median of the two directions. NaN: too little contrast.
    """
    image = grey.astype(np.float32)
    worst = np.nan
    for kernel in (np.ones((1, 17), np.uint8), np.ones((17, 1), np.uint8)):
        along = kernel.shape[0] == 1
        slope = np.abs(cv2.Sobel(image, cv2.CV_32F, int(along), int(not along), ksize=1)) / 2
        few = max(slope.size // 1000, 50)
        steep = slope >= np.partition(slope.ravel(), -few)[-few]
        contrast = cv2.dilate(image, kernel) - cv2.erode(image, kernel)
        clear = steep & (contrast > 60)
        if clear.sum() >= 20:
            width = np.median(contrast[clear] / (np.sqrt(2 * np.pi) * slope[clear]))
            worst = np.fmax(worst, width)
    return float(worst)
