"""Cast rays at a desk, a plate, a ball, a hand and a leaf; area sampled, in linear light."""

import math

import numpy as np
from numba import njit

DESK, PLATE, BALL, ARM, LEAF = 0, 1, 2, 3, 4
FINE = 4  # side of the grid of samples of a pixel that shows an edge


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


@njit(cache=True, fastmath=True)
def _marks(x, y, base, marks, out):
    """Write the colour of a plane at (x, y) and return its mark, 0 for none: `base` (3,) or the
    last mark (x, y, half, inner, kind, b, g, r) there; kind 0: a square, 1: a disc or, with
    `inner`, a ring."""
    out[0], out[1], out[2] = base[0], base[1], base[2]
    on = 0
    for m in range(marks.shape[0]):
        dx, dy = x - marks[m, 0], y - marks[m, 1]
        square = marks[m, 4] < 0.5
        far = max(abs(dx), abs(dy)) if square else math.sqrt(dx * dx + dy * dy)
        if marks[m, 3] <= far < marks[m, 2]:
            out[0], out[1], out[2] = marks[m, 5], marks[m, 6], marks[m, 7]
            on = m + 1
    return on


@njit(cache=True)
def _sphere(ox, oy, oz, dx, dy, dz, cx, cy, cz, r):
    """Distance along the ray to a sphere, or infinity."""
    x, y, z = ox - cx, oy - cy, oz - cz
    b = x * dx + y * dy + z * dz
    q = b * b - (x * x + y * y + z * z - r * r)
    if q < 0.0:
        return math.inf
    t = -b - math.sqrt(q)
    return t if t > 1e-6 else math.inf


@njit(cache=True)
def _capsule(ox, oy, oz, dx, dy, dz, arm):
    """Distance along the ray to a capsule (I. Quilez's intersector), or infinity."""
    bx, by, bz = arm[3] - arm[0], arm[4] - arm[1], arm[5] - arm[2]
    ax, ay, az = ox - arm[0], oy - arm[1], oz - arm[2]
    r = arm[6]
    bb, bd = bx * bx + by * by + bz * bz, bx * dx + by * dy + bz * dz
    ba, da = bx * ax + by * ay + bz * az, dx * ax + dy * ay + dz * az
    aa = ax * ax + ay * ay + az * az
    qa = bb - bd * bd
    qb = bb * da - ba * bd
    qc = bb * aa - ba * ba - r * r * bb
    h = qb * qb - qa * qc
    if h < 0.0 or qa < 1e-12:
        return math.inf
    t = (-qb - math.sqrt(h)) / qa
    y = ba + t * bd
    if 0.0 < y < bb:
        return t if t > 1e-6 else math.inf
    k = 0 if y <= 0.0 else 3
    return _sphere(ox, oy, oz, dx, dy, dz, arm[k], arm[k + 1], arm[k + 2], r)


@njit(cache=True)
def _on_ball(nx, ny, nz, dx, dy, dz, s, out):
    """Write the colour of the ball where its outward normal is n, seen along d.

    Its kinds: 0 plain, 1 striped, 2 one half of another colour, 3 polished: it shows the room
    above, dark and bright, and what lies about below.
    """
    top, ball, two, turn, kind, light = s[2], s[5], s[6], s[7], s[8], s[11]
    x = turn[0, 0] * nx + turn[0, 1] * ny + turn[0, 2] * nz
    z = turn[2, 0] * nx + turn[2, 1] * ny + turn[2, 2] * nz
    other = (kind == 1 and abs(z) < 0.3) or (kind == 2 and x > 0.0)
    for c in range(3):
        out[c] = two[c] if other else ball[c]
    if kind == 3:
        up = dz - 2.0 * (dx * nx + dy * ny + dz * nz) * nz
        room = 0.25 + 0.35 * _noise(nx * 3 + 5, ny * 3 + 5, 11)
        for c in range(3):
            out[c] = (room if up > 0.0 else 0.7 * top[c]) / (light[0] + light[1])


@njit(cache=True)
def _shaded(px, py, pz, what, s, ball_c, cx, cy, cz, arms):
    """Whether a thing stands between a place and the lamp."""
    lamp = s[10]
    lx, ly, lz = lamp[0], lamp[1], lamp[2]
    near = math.inf
    if ball_c[3] > 0.0 and what != BALL:
        near = _sphere(px, py, pz, lx, ly, lz, cx, cy, cz, ball_c[3])
    for m in range(arms.shape[0]):
        near = min(near, _capsule(px, py, pz, lx, ly, lz, arms[m]))
    return near < math.inf


@njit(cache=True)
def _trace(ox, oy, oz, dx, dy, dz, s, plate, ball_c, cx, cy, cz, arms, leaf, out):
    """Write the linear colour that a ray sees into `out`; what it hits, and on which mark.

    `s` holds the scene's numbers, see `cast`; the ball's centre is (cx, cy, cz).
    """
    best, what = math.inf, DESK
    if dz < -1e-9:
        best = (-0.12 - oz) / dz
    down = plate[2, 0] * dx + plate[2, 1] * dy + plate[2, 2] * dz
    ax = ay = 0.0
    if down < -1e-9:
        rx, ry, rz = plate[3, 0] - ox, plate[3, 1] - oy, plate[3, 2] - oz
        t = (plate[2, 0] * rx + plate[2, 1] * ry + plate[2, 2] * rz) / down
        hx, hy, hz = t * dx - rx, t * dy - ry, t * dz - rz
        ax = plate[0, 0] * hx + plate[0, 1] * hy + plate[0, 2] * hz
        ay = plate[1, 0] * hx + plate[1, 1] * hy + plate[1, 2] * hz
        if 0.0 < t < best and max(abs(ax), abs(ay)) < plate[4, 0]:
            best, what = t, PLATE
    r = ball_c[3]
    if r > 0.0:
        t = _sphere(ox, oy, oz, dx, dy, dz, cx, cy, cz, r)
        if t < best:
            best, what = t, BALL
    which = 0
    for m in range(arms.shape[0]):
        t = _capsule(ox, oy, oz, dx, dy, dz, arms[m])
        if t < best:
            best, what, which = t, ARM, m
    if leaf[3] > 0.0:
        t = (leaf[2] - oz) / dz
        x, y = ox + t * dx - leaf[0], oy + t * dy - leaf[1]
        a = math.atan2(y, x) + leaf[4]
        wide = leaf[3] * (0.62 + 0.3 * math.cos(2 * a) + 0.12 * math.cos(5 * a + 1.0))
        if 0.0 < t < best and x * x + y * y < wide * wide:
            best, what = t, LEAF
    px, py, pz = ox + best * dx, oy + best * dy, oz + best * dz
    lamp, light = s[10], s[11]
    nx, ny, nz = 0.0, 0.0, 1.0
    shine, shade, mark = 0.0, 1.0, 0
    if what == DESK:
        mark = _marks(px, py, s[0], s[1], out)
        shade = 0.7 + 0.6 * _noise(px * 60.0, py * 14.0, 7) * _noise(px * 9, py * 9, 3)
    elif what == PLATE:
        nx, ny, nz = plate[2, 0], plate[2, 1], plate[2, 2]
        mark = _marks(ax, ay, s[2], s[3], out)
        shade = 1.0 + s[4] * (_noise(ax * 300, ay * 90, 1) + _noise(ax * 40, ay * 40, 5) - 1.0)
    elif what == BALL:
        nx, ny, nz = (px - cx) / r, (py - cy) / r, (pz - cz) / r
        _on_ball(nx, ny, nz, dx, dy, dz, s, out)
        hx, hy, hz = lamp[0] - dx, lamp[1] - dy, lamp[2] - dz
        along = (nx * hx + ny * hy + nz * hz) / math.sqrt(hx * hx + hy * hy + hz * hz)
        shine = s[9] * max(0.0, along) ** 60
    elif what == ARM:
        arm = arms[which]
        bx, by, bz = arm[3] - arm[0], arm[4] - arm[1], arm[5] - arm[2]
        h = (px - arm[0]) * bx + (py - arm[1]) * by + (pz - arm[2]) * bz
        h = min(max(h / (bx * bx + by * by + bz * bz), 0.0), 1.0)
        nx, ny, nz = px - arm[0] - h * bx, py - arm[1] - h * by, pz - arm[2] - h * bz
        nx, ny, nz = nx / arm[6], ny / arm[6], nz / arm[6]
        out[0], out[1], out[2] = arm[7], arm[8], arm[9]
        shade = 0.85 + 0.3 * _noise(px * 150, py * 150, 2)
    else:
        out[0], out[1], out[2] = leaf[5], leaf[6], leaf[7]
    direct = max(0.0, nx * lamp[0] + ny * lamp[1] + nz * lamp[2])
    if direct > 0.0 and what != ARM and what != LEAF:
        x, y, z = px + 1e-5 * nx, py + 1e-5 * ny, pz + 1e-5 * nz
        if _shaded(x, y, z, what, s, ball_c, cx, cy, cz, arms):
            direct = 0.0
    if what == BALL and s[8] == 3:
        direct = 1.0
    for c in range(3):
        out[c] = out[c] * shade * (light[0] + light[1] * direct) + shine * light[1]
    return what + 8 * mark


@njit(cache=True)
def cast(size, camera, focal, s, plate, ball_c, sweep, arms, leaf):
    """Linear image (h, w, 3), 0..1 for white, and the count of the pixels that show the ball.

    `camera` (4, 3): rows right, down, forward, place [m]; `focal` px; `s`: desk (3,), its marks
    (n, 8), plate colour (3,), its marks, grain, ball colour (3,), its second (3,), the ball's
    turn (3, 3), its kind, gloss, direction of the lamp (3,), light (ambient, direct). `plate`
    (5, 3): axes x, y, z, centre, (half side, 0, 0); `ball_c` (4,): centre and radius, 0 for none;
    `sweep` (3,): the ball's path while exposed [m]; `arms` (n, 10): capsules a, b, radius, bgr;
    `leaf` (8,): place, size (0: none), angle, bgr. A pixel in which anything changes is the mean of
    FINE^2 rays, each at its own instant of the exposure.
    """
    w, h = size
    image = np.empty((h, w, 3))
    what = np.empty((h, w), np.int16)
    out, total = np.empty(3), np.empty(3)
    ox, oy, oz = camera[3, 0], camera[3, 1], camera[3, 2]
    bx, by, bz = ball_c[0], ball_c[1], ball_c[2]
    for i in range(h):
        for j in range(w):
            dx, dy, dz = _ray(camera, focal, j - 0.5 * (w - 1), i - 0.5 * (h - 1))
            what[i, j] = _trace(
                ox, oy, oz, dx, dy, dz, s, plate, ball_c, bx, by, bz, arms, leaf, out
            )
            for c in range(3):
                image[i, j, c] = out[c]
    u, v, core, reach = _swept(camera, focal, ball_c, sweep, w, h)
    shown, many = 0.0, FINE * FINE
    for i in range(h):
        for j in range(w):
            far = (i - v) ** 2 + (j - u) ** 2
            edge = core * core < far < reach * reach
            for k in range(9):
                ii, jj = min(max(i + k // 3 - 1, 0), h - 1), min(max(j + k % 3 - 1, 0), w - 1)
                edge |= what[ii, jj] != what[i, j]
            if not edge:
                shown += what[i, j] % 8 == BALL
                continue
            total[:] = 0.0
            for k in range(many):
                x = j - 0.5 * (w - 1) + (k % FINE + 0.5) / FINE - 0.5
                y = i - 0.5 * (h - 1) + (k // FINE + 0.5) / FINE - 0.5
                at = ((k * 7 + i * 3 + j * 11) % many + 0.5) / many - 0.5
                dx, dy, dz = _ray(camera, focal, x, y)
                cx, cy, cz = bx + at * sweep[0], by + at * sweep[1], bz + at * sweep[2]
                hit = _trace(ox, oy, oz, dx, dy, dz, s, plate, ball_c, cx, cy, cz, arms, leaf, out)
                shown += (hit % 8 == BALL) / many
                for c in range(3):
                    total[c] += out[c]
            for c in range(3):
                image[i, j, c] = total[c] / many
    return image, shown


@njit(cache=True)
def _ray(camera, focal, x, y):
    """Direction (unit) of the ray through (x, y) px from the image's centre."""
    dx = camera[2, 0] * focal + camera[0, 0] * x + camera[1, 0] * y
    dy = camera[2, 1] * focal + camera[0, 1] * x + camera[1, 1] * y
    dz = camera[2, 2] * focal + camera[0, 2] * x + camera[1, 2] * y
    n = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
    return dx * n, dy * n, dz * n


@njit(cache=True)
def _swept(camera, focal, ball_c, sweep, w, h):
    """(u, v, core, reach) px: between core and reach lies the ball's edge while exposed."""
    x, y, z = ball_c[0] - camera[3, 0], ball_c[1] - camera[3, 1], ball_c[2] - camera[3, 2]
    ahead = camera[2, 0] * x + camera[2, 1] * y + camera[2, 2] * z
    if ball_c[3] <= 0.0 or ahead <= 0.0:
        return -1e9, -1e9, 0.0, 0.0
    u = focal * (camera[0, 0] * x + camera[0, 1] * y + camera[0, 2] * z) / ahead + 0.5 * (w - 1)
    v = focal * (camera[1, 0] * x + camera[1, 1] * y + camera[1, 2] * z) / ahead + 0.5 * (h - 1)
    r = focal * ball_c[3] / ahead
    far = 0.5 * focal * math.sqrt(sweep[0] ** 2 + sweep[1] ** 2 + sweep[2] ** 2) / ahead
    return u, v, max(0.0, 0.9 * r - far - 2.0), 1.2 * r + far + 2.0


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
