"""Cast rays at a desk, a plate, a ball, a hand and a leaf; area sampled, in linear light."""

import math

import numpy as np
from numba import njit

DESK, PLATE, BALL, ARM, LEAF = 0, 1, 2, 3, 4
FINE = 5  # side of the grid of samples of a pixel that shows an edge


@njit(cache=True)
def _hash(i, j, seed):
    """A number in 0..1 of a lattice point."""
    n = (i * 374761393 + j * 668265263 + seed * 974634777) & 0xFFFFFFFF
    n = ((n ^ (n >> 13)) * 1274126177) & 0xFFFFFFFF
    return ((n ^ (n >> 16)) & 0xFFFF) / 65535.0


@njit(cache=True)
def _noise(x, y, seed):
    """Smooth value noise, 0..1."""
    i, j = math.floor(x), math.floor(y)
    fx, fy = x - i, y - j
    fx, fy = fx * fx * (3 - 2 * fx), fy * fy * (3 - 2 * fy)
    i, j = int(i), int(j)
    top = _hash(i, j, seed) * (1 - fx) + _hash(i + 1, j, seed) * fx
    low = _hash(i, j + 1, seed) * (1 - fx) + _hash(i + 1, j + 1, seed) * fx
    return top * (1 - fy) + low * fy


@njit(cache=True)
def _marks(x, y, base, marks, out):
    """Colour of a plane at (x, y): `base` or the last mark (x, y, half, inner, kind, b, g, r) there;
    kind 0 a square, 1 a disc or, with `inner`, a ring."""
    out[0], out[1], out[2] = base[0], base[1], base[2]
    for m in range(marks.shape[0]):
        dx, dy = x - marks[m, 0], y - marks[m, 1]
        if marks[m, 4] < 0.5:
            far = max(abs(dx), abs(dy))
        else:
            far = math.sqrt(dx * dx + dy * dy)
        if marks[m, 3] <= far < marks[m, 2]:
            out[0], out[1], out[2] = marks[m, 5], marks[m, 6], marks[m, 7]


@njit(cache=True)
def _sphere(o, d, c, r):
    """Distance along the ray to a sphere, or infinity."""
    x, y, z = o[0] - c[0], o[1] - c[1], o[2] - c[2]
    b = x * d[0] + y * d[1] + z * d[2]
    q = b * b - (x * x + y * y + z * z - r * r)
    if q < 0.0:
        return math.inf
    t = -b - math.sqrt(q)
    return t if t > 1e-6 else math.inf


@njit(cache=True)
def _capsule(o, d, a, b, r):
    """Distance along the ray to a capsule from a to b (I. Quilez's intersector), or infinity."""
    ba, oa = b - a, o - a
    baba, bard, baoa = np.dot(ba, ba), np.dot(ba, d), np.dot(ba, oa)
    rdoa, oaoa = np.dot(d, oa), np.dot(oa, oa)
    qa = baba - bard * bard
    qb = baba * rdoa - baoa * bard
    qc = baba * oaoa - baoa * baoa - r * r * baba
    h = qb * qb - qa * qc
    if h < 0.0 or qa < 1e-12:
        return math.inf
    t = (-qb - math.sqrt(h)) / qa
    y = baoa + t * bard
    if 0.0 < y < baba:
        return t if t > 1e-6 else math.inf
    return _sphere(o, d, a if y <= 0.0 else b, r)


@njit(cache=True)
def _ball_colour(n, turn, kind, one, two, out):
    """Colour of the ball where its outward normal is `n`; `turn` (3, 3) carries it into the ball.

    kind 0: plain; 1: striped; 2: one half of another colour.
    """
    x = turn[0, 0] * n[0] + turn[0, 1] * n[1] + turn[0, 2] * n[2]
    z = turn[2, 0] * n[0] + turn[2, 1] * n[1] + turn[2, 2] * n[2]
    other = (kind == 1 and abs(z) < 0.3) or (kind == 2 and x > 0.0)
    for c in range(3):
        out[c] = two[c] if other else one[c]


@njit(cache=True)
def _trace(o, d, s, plate, ball_c, arms, leaf, one, out):
    """What a ray hits, its linear colour in `out`. `s` holds the scene's numbers, see `cast`."""
    (desk, desk_marks, top, top_marks, grain, ball, two, turn, kind, gloss, lamp, light) = s
    best, what = math.inf, DESK
    if d[2] < -1e-9:
        best = (-0.12 - o[2]) / d[2]
    # The plate: rows of `plate` are its axes x, y, z and its centre.
    down = plate[2, 0] * d[0] + plate[2, 1] * d[1] + plate[2, 2] * d[2]
    px = py = 0.0
    if down < -1e-9:
        rel = plate[3] - o
        t = np.dot(plate[2], rel) / down
        hit = o + t * d - plate[3]
        px, py = np.dot(plate[0], hit), np.dot(plate[1], hit)
        if 0.0 < t < best and max(abs(px), abs(py)) < plate[4, 0]:
            best, what = t, PLATE
    r = ball_c[3]
    if r > 0.0:
        t = _sphere(o, d, ball_c[:3], r)
        if t < best:
            best, what = t, BALL
    which = -1
    for m in range(arms.shape[0]):
        t = _capsule(o, d, arms[m, 0:3], arms[m, 3:6], arms[m, 6])
        if t < best:
            best, what, which = t, ARM, m
    if leaf[3] > 0.0:
        t = (leaf[2] - o[2]) / d[2]
        x, y = o[0] + t * d[0] - leaf[0], o[1] + t * d[1] - leaf[1]
        a = math.atan2(y, x) + leaf[4]
        wide = leaf[3] * (0.62 + 0.3 * math.cos(2 * a) + 0.12 * math.cos(5 * a + 1.0))
        if 0.0 < t < best and x * x + y * y < wide * wide:
            best, what = t, LEAF
    p = o + best * d
    n = np.array((0.0, 0.0, 1.0))
    shine = 0.0
    if what == DESK:
        _marks(p[0], p[1], desk, desk_marks, out)
        shade = 0.7 + 0.6 * _noise(p[0] * 60.0, p[1] * 14.0, 7) * _noise(p[0] * 9, p[1] * 9, 3)
        out *= shade
    elif what == PLATE:
        n = plate[2].copy()
        _marks(px, py, top, top_marks, out)
        out *= 1.0 + grain * (_noise(px * 300, py * 90, 1) + _noise(px * 40, py * 40, 5) - 1.0)
    elif what == BALL:
        n = (p - ball_c[:3]) / r
        _ball_colour(n, turn, kind, ball, two, out)
        if kind == 3:  # polished: the room above, dark and bright, and what lies about below
            up = n[2] * 2 * (d[0] * n[0] + d[1] * n[1] + d[2] * n[2])
            z = d[2] - up
            _marks(9.0, 9.0, top, top_marks[:0], out)
            room = 0.25 + 0.35 * _noise(n[0] * 3 + 5, n[1] * 3 + 5, 11)
            out *= 0.7
            if z > 0.0:
                out[:] = room
        half = lamp - d
        half /= math.sqrt(np.dot(half, half))
        shine = gloss * max(0.0, np.dot(n, half)) ** 60
    elif what == ARM:
        a, b = arms[which, 0:3], arms[which, 3:6]
        ba = b - a
        h = min(max(np.dot(p - a, ba) / max(np.dot(ba, ba), 1e-12), 0.0), 1.0)
        n = (p - a - h * ba) / arms[which, 6]
        out[0], out[1], out[2] = arms[which, 7], arms[which, 8], arms[which, 9]
        out *= 0.85 + 0.3 * _noise(p[0] * 150, p[1] * 150, 2)
    else:
        out[0], out[1], out[2] = leaf[5], leaf[6], leaf[7]
    direct = max(0.0, np.dot(n, lamp))
    if direct > 0.0 and what != ARM and what != LEAF:
        start = p + 1e-5 * n
        if r > 0.0 and what != BALL and _sphere(start, lamp, ball_c[:3], r) < math.inf:
            direct = 0.0
        for m in range(arms.shape[0]):
            if _capsule(start, lamp, arms[m, 0:3], arms[m, 3:6], arms[m, 6]) < math.inf:
                direct = 0.0
    if what == BALL and kind == 3:
        direct, out[:] = 1.0, out / (light[0] + light[1])
    gain = light[0] + light[1] * direct
    out *= gain
    out += shine * light[1]
    return what


@njit(cache=True)
def cast(size, camera, focal, s, plate, ball_c, sweep, arms, leaf):
    """Linear image (h, w, 3), 0..1 for white, and the count of the pixels that show the ball.

    `camera` (4, 3): rows right, down, forward, place [m]; `focal` px; `s`: desk (3,), its marks
    (n, 8), plate colour (3,), its marks, grain, ball colour (3,), its second (3,), the ball's
    turn (3, 3), its kind, gloss, direction of the lamp (3,), light (ambient, direct). `plate`
    (5, 3): axes x, y, z, centre, (half side, 0, 0); `ball_c` (4,): centre and radius, 0 for none;
    `sweep` (3,): the ball's path while exposed [m]; `arms` (n, 10): capsules a, b, radius, bgr;
    `leaf` (8,): place, size (0: none), angle, bgr.
    """
    w, h = size
    image = np.empty((h, w, 3))
    what = np.empty((h, w), np.int8)
    out = np.empty(3)
    o = camera[3].copy()
    for i in range(h):
        for j in range(w):
            d = _ray(camera, focal, j - 0.5 * (w - 1), i - 0.5 * (h - 1))
            what[i, j] = _trace(o, d, s, plate, ball_c, arms, leaf, 1.0, out)
            image[i, j] = out
    u, v, reach = _swept(camera, focal, ball_c, sweep, w, h)
    shown = 0.0
    moved = ball_c.copy()
    for i in range(h):
        for j in range(w):
            near = (i - v) ** 2 + (j - u) ** 2 < reach * reach
            edge = near
            for k in range(9):
                ii, jj = min(max(i + k // 3 - 1, 0), h - 1), min(max(j + k % 3 - 1, 0), w - 1)
                edge |= what[ii, jj] != what[i, j]
            if not edge and what[i, j] != BALL:
                # Marks have edges too: neighbours that differ by more than grain.
                for k in range(4):
                    ii, jj = min(i + (k == 0), h - 1), min(j + (k == 1), w - 1)
                    edge |= abs(image[ii, jj, 1] - image[i, j, 1]) > 0.04
            if not edge:
                shown += what[i, j] == BALL
                continue
            total = np.zeros(3)
            for k in range(FINE * FINE):
                x = j - 0.5 * (w - 1) + (k % FINE + 0.5) / FINE - 0.5
                y = i - 0.5 * (h - 1) + (k // FINE + 0.5) / FINE - 0.5
                # Each sample at its own instant of the exposure, in an order that no line shares.
                share = ((k * 7 + i * 3 + j * 11) % (FINE * FINE) + 0.5) / (FINE * FINE) - 0.5
                for c in range(3):
                    moved[c] = ball_c[c] + share * sweep[c]
                d = _ray(camera, focal, x, y)
                hit = _trace(o, d, s, plate, moved, arms, leaf, 1.0, out)
                shown += (hit == BALL) / (FINE * FINE)
                total += out
            image[i, j] = total / (FINE * FINE)
    return image, shown


@njit(cache=True)
def _ray(camera, focal, x, y):
    d = camera[2] * focal + camera[0] * x + camera[1] * y
    return d / math.sqrt(np.dot(d, d))


@njit(cache=True)
def _swept(camera, focal, ball_c, sweep, w, h):
    """(u, v, reach) px about the ball within which its edge can lie while exposed."""
    rel = ball_c[:3] - camera[3]
    z = np.dot(camera[2], rel)
    if ball_c[3] <= 0.0 or z <= 0.0:
        return -1e9, -1e9, 0.0
    u = focal * np.dot(camera[0], rel) / z + 0.5 * (w - 1)
    v = focal * np.dot(camera[1], rel) / z + 0.5 * (h - 1)
    far = math.sqrt(np.dot(sweep, sweep))
    return u, v, 1.2 * focal * (ball_c[3] + 0.5 * far) / z + 2.0


def silhouette(camera, focal, size, centre, radius):
    """(u, v, mean radius) px of a sphere's outline: m = (X, Y) Z / (Z^2 - r^2) and the ellipse's
    mean half axis."""
    X, Y, Z = (float(camera[k] @ (np.asarray(centre) - camera[3])) for k in range(3))
    k = Z * Z - radius * radius
    u = focal * X * Z / k + 0.5 * (size[0] - 1)
    v = focal * Y * Z / k + 0.5 * (size[1] - 1)
    minor = focal * radius / math.sqrt(k)
    major = minor * math.sqrt(1.0 + (X * X + Y * Y) / k)
    return u, v, 0.5 * (minor + major)
