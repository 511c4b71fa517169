"""Where do printed edges lie in the image, and which motion of the plate explains them? Compiled.

Corner finders place the corners of a black square too far inside (0.2 px at a lens blur of 0.5 px:
`cornerSubPix` follows the rounded tip). The sides have no such bias: a symmetric blur leaves the
middle of a straight edge where it was. So each side is cut by short profiles, and the pose
(6 numbers) is fitted to all of them by robust Gauss-Newton steps.
"""

from math import sqrt

import numpy as np

from vision.compiled import kernel
from vision.lens import distort, distort_jacobian

_distort, _distort_jacobian = kernel(distort), kernel(distort_jacobian)


@kernel
def _project(px, py, pose, pinhole, k):  # pragma: no cover - compiled
    """Pixel (u, v) of plate point (px, py, 0), and d(u, v)/d(camera point) (2, 3), and R X."""
    ax = pose[0, 0] * px + pose[0, 1] * py
    ay = pose[1, 0] * px + pose[1, 1] * py
    az = pose[2, 0] * px + pose[2, 1] * py
    z = az + pose[2, 3]
    x, y = (ax + pose[0, 3]) / z, (ay + pose[1, 3]) / z
    fx, fy, cx, cy = pinhole
    seen_x, seen_y = _distort(x, y, k)
    u, v = fx * seen_x + cx, fy * seen_y + cy
    xx, xy, yy = _distort_jacobian(x, y, k)
    by_u = (fx * xx / z, fx * xy / z, -fx * (xx * x + xy * y) / z)
    by_v = (fy * xy / z, fy * yy / z, -fy * (xy * x + yy * y) / z)
    return u, v, by_u, by_v, (ax, ay, az)


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


@kernel
def _by_motion(nu, nv, by_u, by_v, arm, row):  # pragma: no cover - compiled
    """Write the derivative (6,) of a point's place along (nu, nv) by rotation and translation."""
    g0 = nu * by_u[0] + nv * by_v[0]
    g1 = nu * by_u[1] + nv * by_v[1]
    g2 = nu * by_u[2] + nv * by_v[2]
    row[0] = arm[1] * g2 - arm[2] * g1
    row[1] = arm[2] * g0 - arm[0] * g2
    row[2] = arm[0] * g1 - arm[1] * g0
    row[3], row[4], row[5] = g0, g1, g2


@kernel
def cut_edges(
    image, points, along, pose, pinhole, lens, search, reach, ball
):  # pragma: no cover - compiled
    """Cut each expected edge of the print by a profile across it, in `image` (h, w, 3) uint8.

    `points` (m, 2) [m] lie on the sides in the plate frame; `along` (m, 2), unit vectors, run
    clockwise along the side, so that the dark print lies to their right. `pose` (4, 4):
    camera_from_plate; `pinhole`: (fx, fy, cx, cy); `lens`: (k1, k2, p1, p2, k3). The edge is
    searched within `search` px of its expected place; its levels are taken `reach` px to both sides
    of it. `ball` (u, v, radius) px hides what lies under it.

    Returns offsets (m,) px towards the inside, contrasts (m,) (0: not seen), and the Jacobian (m,
    6) of the offset by the pose's small rotation [rad] and translation [m] in camera axes.
    """
    m = points.shape[0]
    offset, contrast, jacobian = np.zeros(m), np.zeros(m), np.zeros((m, 6))
    half = search + reach + 1
    profile = np.empty(2 * half + 1)
    height, width = image.shape[0], image.shape[1]
    for i in range(m):
        u, v, by_u, by_v, arm = _project(points[i, 0], points[i, 1], pose, pinhole, lens)
        du, dv = 0.0, 0.0
        for c in range(3):
            turned = pose[c, 0] * along[i, 0] + pose[c, 1] * along[i, 1]
            du += by_u[c] * turned
            dv += by_v[c] * turned
        length = sqrt(du * du + dv * dv)
        # Clockwise on the plate is clockwise on the image (v down): the inside lies to the right.
        nu, nv = -dv / length, du / length
        if not (half + 1 < u < width - half - 2 and half + 1 < v < height - half - 2):
            continue
        gap_u, gap_v = u - ball[0], v - ball[1]
        near = ball[2] + half
        if gap_u * gap_u + gap_v * gap_v < near * near:
            continue
        for s in range(2 * half + 1):
            profile[s] = _sample(image, u + (s - half) * nu, v + (s - half) * nv)
        offset[i], contrast[i] = _edge(profile, search, reach)
        _by_motion(nu, nv, by_u, by_v, arm, jacobian[i])
    return offset, contrast, jacobian


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
