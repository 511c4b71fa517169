"""A polished ball, which MuJoCo cannot draw: the room and the plate mirrored in a sphere."""

from __future__ import annotations

import numpy as np


def reflected(
    image: np.ndarray,
    eye,
    centre: np.ndarray,
    radius_m: float,
    room: np.ndarray,
    plate_rgb: np.ndarray,
) -> None:
    """Paint the mirror image into an image (h, w, 3) float32 RGB, in place.

    `room` (n, n) is the noise of a ceiling, with two bright windows and a dark camera added;
    what looks down sees the plate, darker where the ball's foot shades it.
    """
    h, w = image.shape[:2]
    u, v = eye.project(centre[None])[0]
    reach = 2.0 + 1.3 * eye.focal_px * radius_m / float(np.linalg.norm(centre - eye.place))
    x0, x1 = max(0, int(u - reach)), min(w, int(u + reach) + 2)
    y0, y1 = max(0, int(v - reach)), min(h, int(v + reach) + 2)
    if x0 >= x1 or y0 >= y1:
        return
    paint = np.zeros((y1 - y0, x1 - x0, 3))
    cover = np.zeros((y1 - y0, x1 - x0, 1))
    for dx in (-0.33, 0.0, 0.33):
        for dy in (-0.33, 0.0, 0.33):
            x = np.arange(x0, x1)[None] + dx - 0.5 * (w - 1)
            y = np.arange(y0, y1)[:, None] + dy - 0.5 * (h - 1)
            colour, hit = _mirror(eye, x, y, centre, radius_m, room, plate_rgb)
            paint += colour * hit[..., None] / 9.0
            cover += hit[..., None] / 9.0
    patch = image[y0:y1, x0:x1]
    patch[:] = patch * (1.0 - cover) + paint


def _mirror(eye, x, y, centre, radius_m, room, plate_rgb):
    """Colours (h, w, 3) along the rays through (x, y) px from the middle, and whether they hit."""
    rays = x[..., None] * eye.axes[0] + y[..., None] * eye.axes[1] + eye.focal_px * eye.axes[2]
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    to = centre - eye.place
    along = rays @ to
    gap = along**2 - to @ to + radius_m**2
    hit = gap > 0.0
    at = rays * (along - np.sqrt(np.maximum(gap, 0.0)))[..., None] - to
    normal = at / radius_m
    out = rays - 2.0 * np.sum(rays * normal, -1, keepdims=True) * normal
    up = out[..., 2]
    n = room.shape[0]
    i = np.clip(((out[..., 0] + 1) * 0.5 * n).astype(int), 0, n - 1)
    j = np.clip(((out[..., 1] + 1) * 0.5 * n).astype(int), 0, n - 1)
    light = 90.0 + 30.0 * room[i, j]
    windows = (np.abs(out[..., 0] - 0.35) < 0.16) & (np.abs(out[..., 1]) < 0.3)
    lamp = (out[..., 0] + 0.5) ** 2 + (out[..., 1] - 0.3) ** 2 < 0.02
    light = np.where(windows | lamp, 245.0, light)
    light = np.where(np.sum(out * rays, -1) < -0.985, 25.0, light)  # the camera itself
    sky = light[..., None] * np.array((0.98, 1.0, 1.02))
    shade = np.clip(1.15 + 0.9 * up, 0.25, 1.0)[..., None]
    ground = plate_rgb * shade
    return np.where((up > 0.0)[..., None], sky, 0.85 * ground), hit
