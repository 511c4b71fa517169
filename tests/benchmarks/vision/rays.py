"""Compiled kernels of the benchmark's ray tracer: a sphere, and the light it takes off the plate.

Camera frame: x right, y down, z away from the camera; the plate is the plane z = centre z + radius.
"""

from math import sqrt

import numpy as np
from numba import njit

FINE = 576  # samples of an edge pixel, on a lattice of irrational strides in u, v and time


@njit(cache=True)
def _light_left(x, y, centre, radius, light, lamps):  # pragma: no cover - compiled
    """Light on the plate at (x, y) beside the ball, as a share of what falls on it without."""
    dx, dy = x - centre[0], y - centre[1]
    q = 1.0 + (dx * dx + dy * dy) / (radius * radius)
    sky = 1.0 - 1.0 / (q * sqrt(q))  # form factor of a sphere that lies on a plane
    along = dx * light[0] + dy * light[1] + radius * light[2]
    miss = sqrt(max(dx * dx + dy * dy + radius * radius - along * along, 0.0))
    soft = 0.12 * radius + 0.06 * abs(along)
    t = min(max((miss - radius + soft) / (2.0 * soft), 0.0), 1.0) if along < 0.0 else 1.0
    lamp = t * t * (3.0 - 2.0 * t)
    direct = lamps[1] * -light[2]
    return (lamps[0] * sky + direct * lamp) / (lamps[0] + direct)


@njit(cache=True)
def light_plate(
    image, centre, move, radius, light, lamps, focal, middle, side
):  # pragma: no cover - compiled
    """Darken the plate (side in m) of an image (h, w, 3) float32 under the ball, in place."""
    z = centre[2] + radius
    steps = 1 + int(2000.0 * sqrt(move[0] ** 2 + move[1] ** 2))
    for i in range(image.shape[0]):
        y = (i - middle[1]) * z / focal
        if abs(y) > 0.5 * side or abs(y - centre[1]) > 8.0 * radius:
            continue
        for j in range(image.shape[1]):
            x = (j - middle[0]) * z / focal
            if abs(x) > 0.5 * side or abs(x - centre[0]) > 8.0 * radius:
                continue
            left = 0.0
            for k in range(steps):
                at = centre + ((k + 0.5) / steps - 0.5) * move
                left += _light_left(x, y, at, radius, light, lamps) / steps
            for c in range(3):
                image[i, j, c] *= left


@njit(cache=True)
def _mirrored(dx, dy, dz, hit_z, x, y, plate, c):  # pragma: no cover - compiled
    """What a polished ball shows in the direction d from (x, y, hit_z): plate, room or lamp."""
    if dz > 1e-6:  # down to the plate
        t = hit_z / dz
        away = sqrt((t * dx) ** 2 + (t * dy) ** 2)
        on = abs(x + t * dx) < 0.1375 and abs(y + t * dy) < 0.1375
        if on:
            return 0.75 * plate[c] * (1.0 - 0.5 / (1.0 + 900.0 * away * away))
        return 60.0 + 8.0 * c
    lamp = max(-0.4 * dx - 0.3 * dy - 0.87 * dz, 0.0) ** 200
    return 55.0 + 35.0 * dx + 25.0 * dy * dy + 8.0 * c + 230.0 * lamp


@njit(cache=True)
def _seen(px, py, at, radius, light, lamps, ball, plate, steel, out):  # pragma: no cover - compiled
    """Colour of the sphere along the ray (px, py, 1), added to `out` (3,); False: it misses."""
    dd = px * px + py * py + 1.0
    dc = px * at[0] + py * at[1] + at[2]
    gap = dc * dc - dd * (at[0] ** 2 + at[1] ** 2 + at[2] ** 2 - radius * radius)
    if gap < 0.0:
        return False
    t = (dc - sqrt(gap)) / dd
    nx, ny, nz = (px * t - at[0]) / radius, (py * t - at[1]) / radius, (t - at[2]) / radius
    norm = 1.0 / sqrt(dd)
    facing = (px * nx + py * ny + nz) * norm
    rx, ry, rz = px * norm - 2 * facing * nx, py * norm - 2 * facing * ny, norm - 2 * facing * nz
    if steel:
        for c in range(3):
            height = at[2] + radius - t
            out[c] += min(_mirrored(rx, ry, rz, height, px * t, py * t, plate, c), 255.0)
        return True
    sky = 0.5 - 0.5 * nz
    lamp = max(nx * light[0] + ny * light[1] + nz * light[2], 0.0)
    shine = max(rx * light[0] + ry * light[1] + rz * light[2], 0.0) ** 24 * lamps[2]
    for c in range(3):
        around = sky + 0.6 * (1.0 - sky) * plate[c] / 255.0
        value = ball[c] * (lamps[0] * around + lamps[1] * lamp) + 200.0 * shine
        out[c] += min(value, 255.0)
    return True


@njit(cache=True)
def trace_ball(
    image, path, reach, centre, move, radius, light, lamps, focal, middle, ball, plate, steel
):  # pragma: no cover - compiled
    """Lay the ball over an image (h, w, 3) float32, in place.

    `path` (4,) px is where its centre goes during the exposure, `reach` its radius in px; `move`
    (3,) m the same in space. The samples' lattice covers space and time evenly together, and
    edges along the rows and columns as well as slanted ones.
    """
    length = sqrt((path[2] - path[0]) ** 2 + (path[3] - path[1]) ** 2)
    i0, i1 = int(min(path[1], path[3]) - reach) - 3, int(max(path[1], path[3]) + reach) + 4
    j0, j1 = int(min(path[0], path[2]) - reach) - 3, int(max(path[0], path[2]) + reach) + 4
    at, out = np.empty(3), np.empty(3)
    for i in range(max(i0, 0), min(i1, image.shape[0])):
        for j in range(max(j0, 0), min(j1, image.shape[1])):
            mu, mv = 0.5 * (path[0] + path[2]), 0.5 * (path[1] + path[3])
            far = sqrt((j - mu) ** 2 + (i - mv) ** 2)
            count = FINE if far > reach - 1.2 - 0.5 * length else 26
            out[:] = 0.0
            hits = 0
            for k in range(count):
                # Each sample has its opposite: their middle is the pixel's and the instant's.
                side, m = 1.0 - 2.0 * (k % 2), k // 2 + 1
                when = side * ((m * 0.5497004779) % 1.0 - 0.5)
                for c in range(3):
                    at[c] = centre[c] + when * move[c]
                x = (j + side * ((m * 0.8191725134) % 1.0 - 0.5) - middle[0]) / focal
                y = (i + side * ((m * 0.6710436067) % 1.0 - 0.5) - middle[1]) / focal
                if _seen(x, y, at, radius, light, lamps, ball, plate, steel, out):
                    hits += 1
            clear = 1.0 - hits / count
            for c in range(3):
                image[i, j, c] = clear * image[i, j, c] + out[c] / count
