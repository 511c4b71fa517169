"""Where do printed edges lie in the image, and which motion of the plate explains them? Compiled.

Corner finders place the corners of a black square too far inside (0.2 px at a lens blur of 0.5 px:
`cornerSubPix` follows the rounded tip). The sides have no such bias: a symmetric blur leaves the
middle of a straight edge where it was. So each side is cut by short profiles, and the pose
(6 numbers) is fitted to all of them by robust Gauss-Newton steps.
"""

import cv2
import numpy as np

from vision.compiled import kernel
from vision.view import View


@kernel
def _sample(image, u, v):  # pragma: no cover - compiled
    """Brightness (B + 2 G + R) / 4 at a sub-pixel place inside the image, bilinear."""
    j, i = int(u), int(v)
    a, b = u - j, v - i
    total = 0.0
    for di in range(2):
        for dj in range(2):
            w = (b if di else 1.0 - b) * (a if dj else 1.0 - a)
            p = image[i + di, j + dj]
            total += w * (0.25 * p[0] + 0.5 * p[1] + 0.25 * p[2])
    return total


@kernel
def _edge(profile, search, reach):  # pragma: no cover - compiled
    """Offset of a bright-to-dark edge from the profile's middle sample, and its contrast.

    The steepest fall within `search` samples is the edge; its place follows from the area under
    the profile between the levels `reach` samples to both sides (exact for any symmetric blur
    that ends before). Contrast 0: none.
    """
    middle = profile.size // 2
    best, at = 0.0, -1
    for i in range(middle - search, middle + search + 1):
        fall = profile[i - 1] - profile[i + 1]
        if fall > best:
            best, at = fall, i
    if at < 0:
        return 0.0, 0.0
    bright = 0.5 * (profile[at - reach] + profile[at - reach - 1])
    dark = 0.5 * (profile[at + reach] + profile[at + reach + 1])
    contrast = bright - dark
    if contrast <= 0.0 or best < 0.35 * contrast or best > 1.3 * contrast:
        return 0.0, 0.0
    area = 0.0
    for i in range(at - reach, at + reach + 1):
        area += (profile[i] - dark) / contrast
    return at - middle - reach - 0.5 + area, contrast


def cut_edges(
    image: np.ndarray,
    points: np.ndarray,
    along: np.ndarray,
    view: View,
    search: int,
    reach: int,
    ball: tuple[float, float, float],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cut each expected edge of the print by a profile across it, in `image` (h, w, 3) uint8.

    `points` (m, 2) [m] lie on the sides in the plate frame; `along` (m, 2), unit vectors, run
    clockwise along the side, so that the dark print lies to their right. The edge is searched
    within `search` px of the place that `view` expects; its levels are taken `reach` px to both
    sides of it. `ball` (u, v, radius) px hides what lies under it.

    Returns offsets (m,) px towards the inside, contrasts (m,) (0: not seen), and the Jacobian (m,
    6) of the offset by the pose's small rotation [rad] and translation [m] in camera axes.
    """
    camera, turn = view.camera, view.camera_from_plate[:3, :2]
    # About the plate's turned axes, the rotation vector 0 is the pose itself.
    places, by_all = cv2.projectPoints(
        points @ turn.T,
        np.zeros(3),
        view.camera_from_plate[:3, 3],
        camera.matrix,
        camera.distortion,
    )
    by_pose = np.asarray(by_all).reshape(-1, 2, 15)[:, :, :6]  # of (u, v)
    side = np.einsum("mij,mj->mi", by_pose[:, :, 3:], along @ turn.T)
    # Clockwise on the plate is clockwise on the image (v down): the inside lies to the right.
    inwards = side[:, ::-1] * (-1.0, 1.0) / np.hypot(*side.T)[:, None]
    places = np.asarray(places).reshape(-1, 2)
    offset, contrast = _cut(image, places, inwards, search, reach, np.array(ball, float))
    jacobian = np.einsum("mi,mij->mj", inwards, by_pose)
    return offset, contrast, np.where(contrast[:, None] > 0.0, jacobian, 0.0)


@kernel
def _cut(image, places, inwards, search, reach, ball):  # pragma: no cover - compiled
    """Offsets and contrasts of `cut_edges`, of profiles through `places` (m, 2) px along the unit
    vectors `inwards` (m, 2)."""
    m = places.shape[0]
    offset, contrast = np.zeros(m), np.zeros(m)
    half = search + reach + 1
    profile = np.empty(2 * half + 1)
    height, width = image.shape[0], image.shape[1]
    for i in range(m):
        u, v = places[i]
        if not (half + 1 < u < width - half - 2 and half + 1 < v < height - half - 2):
            continue
        if not inwards[i, 0] ** 2 + inwards[i, 1] ** 2 < 2.0:  # NaN: an edge without a length
            continue
        gap_u, gap_v = u - ball[0], v - ball[1]
        near = ball[2] + half
        if gap_u * gap_u + gap_v * gap_v < near * near:
            continue
        for s in range(2 * half + 1):
            far = s - half
            profile[s] = _sample(image, u + far * inwards[i, 0], v + far * inwards[i, 1])
        offset[i], contrast[i] = _edge(profile, search, reach)
    return offset, contrast


@kernel
def fit_motion(offset, contrast, jacobian, floor_px):  # pragma: no cover - compiled
    """Small motion (6,) of the plate that explains the offsets, by weighted least squares with
    Tukey's biweight.

    `offset` (m,) px, `contrast` (m,) (0: not seen) and `jacobian` (m, 6) of `cut_edges`; the
    residuals' scale is at least `floor_px`. Returns the motion (rotation [rad], translation [m],
    camera axes), weights (m,) (0: outlier), and J^T W J (6, 6). All weights are zero where fewer
    than 24 cuts were seen or kept.
    """
    m = offset.size
    weight = np.zeros(m)
    motion, normal = np.zeros(6), np.zeros((6, 6))
    seen = 0
    for i in range(m):
        if contrast[i] > 0.0:
            weight[i] = 1.0
            seen += 1
    if seen < 24:
        weight[:] = 0.0
        return motion, weight, normal
    residual = offset.copy()
    for step in range(5):
        if step > 0:
            residual = offset - jacobian @ motion
            scale = max(1.4826 * np.median(np.abs(residual[contrast > 0.0])), floor_px)
            for i in range(m):
                if contrast[i] > 0.0:
                    t = residual[i] / (4.685 * scale)
                    weight[i] = (1.0 - t * t) ** 2 if abs(t) < 1.0 else 0.0
        weighted = jacobian * weight.reshape(-1, 1)
        normal = jacobian.T @ weighted
        for c in range(6):
            normal[c, c] *= 1.0 + 1e-12
        if weight.sum() < 24.0:
            weight[:] = 0.0
            return motion, weight, normal
        motion = np.linalg.solve(normal, weighted.T @ offset)
    return motion, weight, normal
