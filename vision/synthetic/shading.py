"""How bright is each pixel of a rendered frame? Compiled loops of the synthetic camera.

`rays` (h, w, 2) are the pixels' ideal normalised coordinates, so a distorting lens costs nothing.
"""

from math import erf, sqrt

import numpy as np

from vision.compiled import kernel


@kernel
def texel_maps(rays, texel_from_ray, map_x, map_y):  # pragma: no cover - compiled
    """Write the texture coordinates [texels] of a region's pixels into `map_x`, `map_y` (h, w)
    float32, for `cv2.remap`.

    `rays` (h, w, 2): normalised coordinates; `texel_from_ray` (3, 3): the plane's homography.
    """
    h = texel_from_ray.astype(np.float32)
    for i in range(map_x.shape[0]):
        for j in range(map_x.shape[1]):
            x, y = rays[i, j, 0], rays[i, j, 1]
            w = np.float32(1.0) / (h[2, 0] * x + h[2, 1] * y + h[2, 2])
            map_x[i, j] = (h[0, 0] * x + h[0, 1] * y + h[0, 2]) * w
            map_y[i, j] = (h[1, 0] * x + h[1, 1] * y + h[1, 2]) * w


@kernel
def lay_over(image, layer, gain):  # pragma: no cover - compiled
    """Lay the premultiplied BGRA `layer` (h, w, 4), times `gain`, over a region of `image` (h, w,
    3), both uint8, in place."""
    scale = np.int32(round(gain * 65536.0))
    for i in range(image.shape[0]):
        for j in range(image.shape[1]):
            clear = 255 - np.int32(layer[i, j, 3])
            if clear == 0:  # most of the plate: nothing shines through
                for c in range(3):
                    value = (np.int32(layer[i, j, c]) * scale + 32768) >> 16
                    image[i, j, c] = np.uint8(min(value, 255))
                continue
            for c in range(3):
                under = (np.int32(image[i, j, c]) * clear * 257 + 32768) >> 16
                value = under + ((np.int32(layer[i, j, c]) * scale + 32768) >> 16)
                image[i, j, c] = np.uint8(min(value, 255))


@kernel
def expose_sensor(clean, noise, brightness):  # pragma: no cover - compiled
    """Sensor values (n,) uint8: `clean` (n,) uint8 times `brightness` plus `noise` (n,) int16 in
    1/64 grey level, rounded and clipped."""
    out = np.empty(clean.size, np.uint8)
    scale = np.int32(round(brightness * 64.0))
    for i in range(clean.size):
        value = (np.int32(clean[i]) * scale + np.int32(noise[i]) + 32) >> 6
        out[i] = np.uint8(min(max(value, 0), 255))
    return out


@kernel
def _light_left(px, py, pz, light, radius, strength):  # pragma: no cover - compiled
    """Share of the light that reaches the plate at (px, py, pz) from the ball's centre.

    The ball hides 1 / (1 + (s/r)^2)^1.5 of an even sky at distance s from its foot, and the lamp
    inside its own soft-edged shadow.
    """
    away2 = px * px + py * py + pz * pz
    q = away2 / (radius * radius)  # 1 + (s/r)^2 on the plate
    if q >= 7.0:
        return 1.0
    far = min((7.0 - q) / 4.0, 1.0)  # to nothing before the patch ends
    sky = 1.0 - far / (q * sqrt(q))
    along = px * light[0] + py * light[1] + pz * light[2]
    away = sqrt(max(away2 - along * along, 0.0))
    edge = min(max((1.25 * radius - away) / (0.5 * radius), 0.0), 1.0) if along < 0.0 else 0.0
    lamp = 1.0 - edge * edge * (3.0 - 2.0 * edge)
    return 1.0 - strength * (1.0 - 0.5 * sky - 0.5 * lamp)


@kernel
def cast_shadow(
    image, rays, cover, normal, centre, radius, light, strength
):  # pragma: no cover - compiled
    """Darken a region (h, w, 3) of the plate under a ball at `centre` (3,) [m, camera frame], in
    place.

    `rays` (h, w, 2): normalised coordinates; `cover` (h, w) uint8: the plate's alpha; what is not
    plate lies far below and stays. `normal` (3,): of the plate; `radius` [m]; `light` (3,): towards
    the lamp; both vectors in the camera frame; `strength` (0..1): share of the light that is taken.
    """
    n0, n1, n2 = normal[0], normal[1], normal[2]
    depth = n0 * centre[0] + n1 * centre[1] + n2 * centre[2] - radius
    for i in range(image.shape[0]):
        for j in range(image.shape[1]):
            if cover[i, j] == 0:
                continue
            x, y = rays[i, j, 0], rays[i, j, 1]
            z = depth / (n0 * x + n1 * y + n2)
            left = _light_left(
                x * z - centre[0], y * z - centre[1], z - centre[2], light, radius, strength
            )
            left = 1.0 - (1.0 - left) * (cover[i, j] / 255.0)
            for c in range(3):
                image[i, j, c] = np.uint8(image[i, j, c] * left + 0.5)


@kernel
def _lit(x, y, gap, along, centre, radius, light, half):  # pragma: no cover - compiled
    """Diffuse light and highlight where the ray (x, y, 1) meets the sphere."""
    reach = along - sqrt(gap)
    norm = 1.0 / sqrt(x * x + y * y + 1.0)
    nx = (x * norm * reach - centre[0]) / radius
    ny = (y * norm * reach - centre[1]) / radius
    nz = (norm * reach - centre[2]) / radius
    facing = nx * light[0] + ny * light[1] + nz * light[2]
    gloss = max(nx * half[0] + ny * half[1] + nz * half[2], 0.0)
    gloss *= gloss
    gloss *= gloss
    gloss *= gloss
    gloss *= gloss
    gloss *= gloss  # to the 32nd
    return 0.46 + 0.54 * max(facing, 0.0) + 0.08 * min(facing, 0.0), gloss * gloss


@kernel
def paint_ball(
    image, rays, centres, radius, px_per_m, soft_px, bgr, light, half
):  # pragma: no cover - compiled
    """Paint a ball over a region (h, w, 3), averaged over its places `centres` (k, 3) [m, camera
    frame], in place.

    A pixel's ray (`rays` (h, w, 2)) passes the centre at distance p; the outline is where p =
    `radius` [m], and the edge falls off there as the integral of a Gaussian of `soft_px`.
    `px_per_m`: scale at the ball; `bgr`: colour; `light` and `half` (3,): directions of the lamp
    and of the highlight in the camera frame.
    """
    k = centres.shape[0]
    reach = 3.2 * soft_px
    for i in range(image.shape[0]):
        for j in range(image.shape[1]):
            x, y = float(rays[i, j, 0]), float(rays[i, j, 1])
            norm = 1.0 / sqrt(x * x + y * y + 1.0)
            total, blue, green, red = 0.0, 0.0, 0.0, 0.0
            for m in range(k):
                c0, c1, c2 = centres[m, 0], centres[m, 1], centres[m, 2]
                # p by the cross product: no cancellation
                a0, a1, a2 = y * c2 - c1, c0 - x * c2, x * c1 - y * c0
                p2 = (a0 * a0 + a1 * a1 + a2 * a2) * norm * norm
                inside = (radius - sqrt(p2)) * px_per_m
                if inside <= -reach:
                    continue
                share = 1.0
                if inside < reach:
                    share = 0.5 + 0.5 * erf(inside / (soft_px * 1.4142135623730951))
                along = (x * c0 + y * c1 + c2) * norm
                gap = max(radius * radius - p2, 0.0)
                shade, gloss = _lit(x, y, gap, along, centres[m], radius, light, half)
                total += share
                blue += share * min(bgr[0] * shade + 190.0 * gloss, 255.0)
                green += share * min(bgr[1] * shade + 190.0 * gloss, 255.0)
                red += share * min(bgr[2] * shade + 190.0 * gloss, 255.0)
            if total > 0.0:
                clear = 1.0 - total / k
                image[i, j, 0] = np.uint8(image[i, j, 0] * clear + blue / k + 0.5)
                image[i, j, 1] = np.uint8(image[i, j, 1] * clear + green / k + 0.5)
                image[i, j, 2] = np.uint8(image[i, j, 2] * clear + red / k + 0.5)
