"""Scenes with exact truth for judging detectors: a supersampled ray tracer of its own.

It shares no code with `vision`: rays of every edge pixel are tested against the sphere 576 times
(each at its own instant of the exposure), so edges are right to 0.0005 px whatever the shading. A
camera looks straight down from 0.75 m, 1.5 px/mm at 480 rows. The truth is the centre of the
silhouette's ellipse at mid exposure, m = (X, Y) Z / (Z^2 - r^2) in normalised coordinates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import cv2
import numpy as np

from tests.benchmarks.vision.rays import light_plate, trace_ball

Colour = tuple[float, float, float]  # BGR, 0..255
HEIGHT_M, FOCAL_PER_ROW = 0.75, 1125.0 / 480.0
PLATE_M = 0.275
BALLS: dict[str, Colour] = {
    "orange": (30.0, 112.0, 236.0),
    "green": (52.0, 150.0, 40.0),
    "white": (236.0, 240.0, 240.0),
    "black": (24.0, 22.0, 22.0),
    "steel": (150.0, 150.0, 150.0),
}
PLATES: dict[str, Colour] = {
    "pale": (206.0, 213.0, 216.0),
    "dark": (52.0, 48.0, 46.0),
    "transparent": (93.0, 112.0, 133.0),
    "textured": (110.0, 150.0, 185.0),
}


@dataclass(frozen=True)
class Look:
    """What there is to see and with which camera; `light` points to the lamp (z up).

    `ambient` + `diffuse` light, `gloss` of the ball's highlight, `noise_dn` of every pixel and
    channel, `blur_px` of the lens, `jpeg` quality or None, `things` of the ball's colour beside the
    plate, `shadow` whether the ball takes light off the plate, `grain` the plate's texture (share
    of its brightness), `glare` of a window on the plate, `gain` (3,) of the sensor's channels.
    """

    name: str
    ball: str = "orange"
    plate: str = "pale"
    radius_m: float = 0.020
    light: tuple[float, float, float] = (0.0, 0.0, 1.0)
    ambient: float = 0.6
    diffuse: float = 0.4
    gloss: float = 0.0
    shadow: bool = True
    grain: float = 0.012
    noise_dn: float = 2.0
    blur_px: float = 0.6
    jpeg: int | None = None
    speed_m_s: float = 0.2
    exposure_s: float = 0.0005
    things: bool = False
    glare: bool = False
    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)


SIDE = (-0.75, 0.35, 0.55)
CLEAN = Look("clean", shadow=False, grain=0.0)  # as over a luminous plate
SHADED = Look("shaded", light=SIDE, ambient=0.35, diffuse=0.65, gloss=0.5)
STANDARD = (
    CLEAN,
    Look("lamp above"),  # the ball hides most of its own shadow, and all but its rim's edge
    SHADED,
    replace(SHADED, name="MJPG q85", jpeg=85),
    replace(SHADED, name="motion", speed_m_s=0.5, exposure_s=0.008),
    replace(SHADED, name="glare", light=(-0.5, 0.3, 0.8), gloss=1.5, things=True, glare=True),
    replace(SHADED, name="low light", gain=(0.16, 0.16, 0.16), noise_dn=3.5),
)


@dataclass(frozen=True, eq=False)
class Shot:
    """One image (h, w, 3) uint8 with its truth: centre and radius of the silhouette, px."""

    image: np.ndarray
    u_px: float
    v_px: float
    radius_px: float
    t_s: float


@dataclass(eq=False)
class Studio:
    """Takes pictures of a look; `rng` draws the textures and the noise."""

    look: Look
    size: tuple[int, int] = (640, 480)
    seed: int = 1
    rng: np.random.Generator = field(init=False)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)

    @property
    def focal_px(self) -> float:
        return FOCAL_PER_ROW * self.size[1]

    @property
    def scale(self) -> float:
        """Pixels per metre on the plate."""
        return self.focal_px / HEIGHT_M

    @cached_property
    def background(self) -> np.ndarray:
        """(h, w, 3) float32 of desk, plate and things, without the ball."""
        image = _desk(self.size, self.rng)
        _lay_plate(image, self.look, self.scale, self.rng)
        if self.look.glare:
            _window(image, self.scale)
        if self.look.things:
            _things(image, BALLS[self.look.ball], self.scale)
        return image

    @cached_property
    def _bank(self) -> np.ndarray:
        count = 3 * self.size[0] * self.size[1]
        return self.rng.standard_normal(2 * count, dtype=np.float32)

    def silhouette(self, xy_m: tuple[float, float], radius_m: float = 0.0):
        """(u, v, radius) px of a ball on the plate at (x, y), y up in the image."""
        r = radius_m or self.look.radius_m
        z = HEIGHT_M - r
        k = self.focal_px / (z * z - r * r)
        u = k * z * xy_m[0] + 0.5 * (self.size[0] - 1)
        v = -k * z * xy_m[1] + 0.5 * (self.size[1] - 1)
        far = math.hypot(xy_m[0], xy_m[1], z)
        major = k * r * math.sqrt(far * far - r * r)
        minor = self.focal_px * r / math.sqrt(z * z - r * r)
        return u, v, math.sqrt(major * minor)

    def lit(self, xy_m, velocity_m_s=(0.0, 0.0), ball: str = "", ground=None) -> np.ndarray:
        """(h, w, 3) float32 without noise: a ball at (x, y) m on `ground` (default background)."""
        look = self.look
        image = (self.background if ground is None else ground).copy()
        u, v, r = self.silhouette(xy_m)
        du, dv = (self.scale * look.exposure_s * s for s in (velocity_m_s[0], -velocity_m_s[1]))
        path = np.array([u - du / 2, v - dv / 2, u + du / 2, v + dv / 2])
        light = np.array([look.light[0], -look.light[1], -look.light[2]])
        light /= np.linalg.norm(light)
        move = look.exposure_s * np.array([velocity_m_s[0], -velocity_m_s[1], 0.0])
        centre = np.array([xy_m[0], -xy_m[1], HEIGHT_M - look.radius_m])
        middle = np.array([0.5 * (self.size[0] - 1), 0.5 * (self.size[1] - 1)])
        lamps = np.array([look.ambient, look.diffuse, look.gloss])
        args = (centre, move, look.radius_m, light, lamps, self.focal_px, middle)
        if look.shadow:
            light_plate(image, *args, PLATE_M)
        name = ball or look.ball
        colour = np.array(BALLS[name]), np.array(PLATES[look.plate])
        trace_ball(image, path, r, *args, *colour, name == "steel")
        return image

    def expose(self, lit: np.ndarray) -> np.ndarray:
        """The image as the camera gives it: blur, gain, noise, rounding, JPEG."""
        look = self.look
        seen = cv2.GaussianBlur(lit, (0, 0), look.blur_px) * np.array(look.gain, np.float32)
        start = int(self.rng.integers(self._bank.size - seen.size))
        noise = self._bank[start : start + seen.size].reshape(seen.shape)
        seen += np.float32(look.noise_dn) * noise
        image = np.clip(np.rint(seen), 0, 255).astype(np.uint8)
        if look.jpeg is None:
            return image
        code = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, look.jpeg])[1]
        return np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR))

    def shot(self, xy_m, velocity_m_s=(0.0, 0.0), t_s: float = 0.0) -> Shot:
        return Shot(self.expose(self.lit(xy_m, velocity_m_s)), *self.silhouette(xy_m), t_s)

    @cached_property
    def plate_mask(self) -> np.ndarray:
        """(h, w) uint8: 255 on the plate."""
        w, h = self.size
        mask = np.zeros((h, w), np.uint8)
        half = round(0.5 * PLATE_M * self.scale)
        mask[max(0, h // 2 - half) : h // 2 + half, max(0, w // 2 - half) : w // 2 + half] = 255
        return mask

    def bound_px(self, xy_m=(0.03, -0.02)) -> float:
        """Cramer-Rao bound of the centre per axis: (sigma / A) sqrt(2 s / (sqrt(pi) R)).

        A is the rms over the outline and the root sum over the channels of the contrast 3 px
        either side of it; s counts the lens and the pixel's area. A JPEG's loss is not in it.
        """
        look = self.look
        clean = cv2.GaussianBlur(self.lit(xy_m), (0, 0), look.blur_px) * np.array(look.gain)
        u, v, radius = self.silhouette(xy_m)
        turn = np.linspace(0, 2 * math.pi, 360, endpoint=False)
        rings = []
        for r in (radius - 3.0, radius + 3.0):
            at = np.rint([v + r * np.sin(turn), u + r * np.cos(turn)]).astype(int)
            rings.append(np.clip(clean[at[0], at[1]], 0, 255))
        contrast = math.sqrt(np.mean(np.sum((rings[0] - rings[1]) ** 2, axis=1)))
        noise = math.sqrt(look.noise_dn**2 + 1 / 12)
        blur = math.sqrt(look.blur_px**2 + 1 / 12)
        return noise / contrast * math.sqrt(2 * blur / (math.sqrt(math.pi) * radius))


def rolling(speed_m_s: float, count: int, fps: float = 60.0, span_m: float = 0.08):
    """Places (n, 2) m, velocities (n, 2) m/s and times (n,) s of a ball at constant speed."""
    fine = np.linspace(0.3, 40.0, 40001)
    x, y = span_m * np.sin(2.0 * fine), span_m * np.sin(1.37 * fine + 0.4)
    length = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))))
    t = np.arange(count) / fps
    s = (t * speed_m_s) % (0.98 * length[-1])
    places = np.column_stack((np.interp(s, length, x), np.interp(s, length, y)))
    ahead = np.column_stack((np.interp(s + 1e-4, length, x), np.interp(s + 1e-4, length, y)))
    return places, (ahead - places) / 1e-4 * speed_m_s, t


def _desk(size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    w, h = size
    grain = cv2.resize(rng.standard_normal((h // 4, w // 24)).astype(np.float32), (w, h))
    return (1.0 + 0.08 * grain[..., None]) * np.array((74.0, 98.0, 124.0), np.float32)


def _lay_plate(image: np.ndarray, look: Look, scale: float, rng: np.random.Generator) -> None:
    """The plate into an image (h, w, 3) float32, in place; a transparent one tints the desk."""
    h, w = image.shape[:2]
    half = round(0.5 * PLATE_M * scale)
    rows = slice(max(0, h // 2 - half), h // 2 + half)
    cols = slice(max(0, w // 2 - half), w // 2 + half)
    part = image[rows, cols]
    if look.plate == "transparent":
        image[rows, cols] = 0.8 * part + 34.0
        return
    amount = 0.12 if look.plate == "textured" else look.grain
    shape = part.shape[:2]
    grain = np.zeros(shape, np.float32)
    for cell, share in ((48, 0.5), (12, 0.4), (3, 0.35)):
        rough = rng.standard_normal((shape[0] // cell + 2, shape[1] // cell + 2))
        grain += share * cv2.resize(rough.astype(np.float32), shape[::-1])
    image[rows, cols] = np.array(PLATES[look.plate], np.float32) * (1 + amount * grain[..., None])


def _window(image: np.ndarray, scale: float) -> None:
    """A window mirrored in the plate: bright panes with a cross, and a soft glow; in place."""
    h, w = image.shape[:2]
    glow = np.zeros((h, w), np.float32)
    for dx, dy in ((-0.045, -0.03), (-0.005, -0.03), (-0.045, 0.02), (-0.005, 0.02)):
        corner = np.array([(0, 0), (0.035, 0.006), (0.033, 0.046), (-0.002, 0.042)])
        corner += np.array((dx, dy))
        cv2.fillConvexPoly(
            glow,
            np.rint(16 * (corner * scale + (w / 2, h / 2))).astype(np.int32),
            (38.0,),
            cv2.LINE_8,
            4,
        )
    v, u = np.mgrid[0:h, 0:w]
    glow += 45 * np.exp(-0.5 * ((u - 0.62 * w) ** 2 + (v - 0.35 * h) ** 2) / (0.03 * scale) ** 2)
    image += glow[..., None]


def _things(image: np.ndarray, bgr: Colour, scale: float) -> None:
    """A ball, a cup's rim and a book of the ball's colour on the desk; in place."""
    h, w = image.shape[:2]
    side = int(w / 2 - 0.5 * PLATE_M * scale)
    r = 0.019 * scale
    fine, shift = 16, 4
    ball = (round(fine * 0.45 * side), round(fine * 0.3 * h))
    cv2.circle(image, ball, round(fine * r), bgr, -1, cv2.LINE_AA, shift)
    cup = (round(fine * (w - 0.5 * side)), round(fine * 0.62 * h))
    cv2.circle(image, cup, round(fine * 1.3 * r), tuple(0.8 * c for c in bgr), -1, 16, shift)
    cv2.circle(image, cup, round(fine * 0.9 * r), (60.0, 60.0, 60.0), -1, cv2.LINE_AA, shift)
    image[int(0.7 * h) : int(0.95 * h), int(0.1 * side) : int(0.8 * side)] = bgr
