"""What would a camera over the table see? Rendered frames whose sub-pixel truth is known exactly.

The truth is the `View`: what it says about a plate point or the ball's outline is where the edge
of the rendered picture lies (50 % of the way from one side to the other). The lens is OpenCV's,
with distortion: every pixel's undistorted ray is computed once, and all geometry is done on rays.
Not modelled: rolling shutter, the plate's motion during the exposure, reflections.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from math import ceil

import cv2
import numpy as np

from vision.plate.markers import MarkerLayout, default_layout
from vision.synthetic.shading import cast_shadow, expose_sensor, lay_over, paint_ball, texel_maps
from vision.synthetic.texture import PADDING, TEXELS, desk_picture, plate_from_texel, plate_texture
from vision.view import Camera, View

Colour = tuple[float, float, float]  # blue, green, red, 0 to 255
_PIXEL_SIGMA = 12**-0.5  # a square pixel's own blur


@dataclass(frozen=True)
class DeskBall:
    """A ball-like thing that lies on the desk beside the plate, for example a decoy; `xy_m` along
    the plate's axes, colour in BGR."""

    xy_m: tuple[float, float]
    radius_m: float
    bgr: Colour


@dataclass(frozen=True, eq=False)
class Scene:
    """What the camera looks at; colours are BGR, 0..255. `light` points from the level plate to the
    lamp.

    `desk_drop_m`: how far the desk lies below the plate; `shadow` (0..1): the share of light that
    the ball's shadow takes; `lens_blur_px` and `noise_dn` (grey levels): standard deviations.
    """

    plate_side_m: float = 0.275
    layout: MarkerLayout = field(default_factory=lambda: default_layout(0.275))
    ball_radius_m: float = 0.019625
    ball_bgr: Colour = (36.0, 118.0, 238.0)
    plate_bgr: Colour = (208.0, 217.0, 221.0)
    desk_bgr: Colour = (74.0, 98.0, 124.0)
    desk_balls: tuple[DeskBall, ...] = ()
    desk_drop_m: float = 0.09
    light: tuple[float, float, float] = (-0.38, 0.42, 0.82)
    shadow: float = 0.6
    lens_blur_px: float = 0.45
    noise_dn: float = 2.0


def virtual_camera(*, distorted: bool = True) -> Camera:
    """A camera of 640 x 480 px, 33 x 25 degrees: a 1/2.9-inch sensor behind a 6 mm lens, with mild
    barrel distortion unless `distorted` is False."""
    matrix = np.array([[1086.0, 0, 322.7], [0, 1084.4, 241.9], [0, 0, 1]])
    lens = (-0.09, 0.04, 4e-4, -3e-4, 0.0) if distorted else (0.0,) * 5
    return Camera(matrix, np.array(lens), 640, 480)


def virtual_view(camera: Camera | None = None, plate_side_m: float = Scene.plate_side_m) -> View:
    """The level plate under a camera (default: `virtual_camera()`) that hangs about one degree
    askew, 0.75 m above a plate of 0.275 m and as much higher as the plate is larger."""
    turn, _ = cv2.Rodrigues(np.radians([0.9, -1.3, 1.1]))
    pose = np.eye(4)
    pose[:3, :3] = np.asarray(turn) @ np.diag([1.0, -1.0, -1.0])
    pose[:3, 3] = -0.0032, 0.0021, 0.75 * (plate_side_m / Scene.plate_side_m)
    return View(camera or virtual_camera(), pose)


class Renderer:
    """Draws frames of a scene; `view` is the camera with the plate level.

    All randomness (textures, a bank of sensor noise, the place in it for each frame) comes from
    `rng`: the same generator state gives the same frames. `ValueError`: a marker of the scene lies
    off the plate.
    """

    def __init__(self, scene: Scene, view: View, rng: np.random.Generator) -> None:
        self.scene, self.view, self._rng = scene, view, rng
        camera = view.camera
        self._shape = (camera.height_px, camera.width_px)
        self._rays = _rays(camera, 1)
        light = np.asarray(scene.light, float)
        self._light_plate = light / np.linalg.norm(light)
        self._light = view.camera_from_plate[:3, :3] @ self._light_plate
        half = self._light + np.array((0.0, 0.0, -1.0))
        self._half = half / np.linalg.norm(half)
        self._soft_px = float(np.hypot(scene.lens_blur_px, _PIXEL_SIGMA))
        pixel_m = view.camera_from_plate[2, 3] / camera.pinhole[0]
        blur_texels = self._soft_px * pixel_m * TEXELS / scene.plate_side_m
        self._texture = plate_texture(
            scene.layout, scene.plate_side_m, scene.plate_bgr, blur_texels, rng
        )
        self._texel_from_plate = np.linalg.inv(plate_from_texel(scene.plate_side_m))
        self._desk = self._draw_desk()
        self._noise = self._draw_noise()

    def render(
        self,
        rotation: np.ndarray,
        ball_xy_m: tuple[float, float] | np.ndarray | None,
        *,
        velocity_m_s: tuple[float, float] | np.ndarray = (0.0, 0.0),
        exposure_s: float = 0.004,
        brightness: float = 1.0,
    ) -> np.ndarray:
        """One frame (h, w, 3) uint8 BGR of the plate turned by `rotation` (3, 3, world_from_plate).

        `ball_xy_m`: the ball's centre in the plate frame at mid exposure, None for no ball; it
        moves with `velocity_m_s` (2,) during `exposure_s`. `brightness` scales all light (1 =
        normal).
        """
        view = self.view.tilted(rotation)
        image = self._desk.copy()
        cover = self._draw_plate(image, view, rotation)
        if ball_xy_m is not None:
            streak = np.asarray(velocity_m_s, float) * exposure_s
            self._draw_ball(image, cover, view, np.asarray(ball_xy_m, float), streak)
        return self._expose(image, brightness)

    def render_sheet(
        self, sheet: np.ndarray, size_m: tuple[float, float], camera_from_sheet: np.ndarray
    ) -> np.ndarray:
        """One frame (h, w, 3) uint8 BGR of a flat printed sheet held between camera and plate, as
        for a calibration.

        `sheet` (h, w) uint8 covers `size_m` (width, height). `camera_from_sheet` (4, 4) [m]: pose
        of the sheet's frame, which has its origin in the top left corner of the print, x right, y
        down (OpenCV's boards). The sheet is drawn three times finer and averaged, since its scale
        varies too much to prefilter.
        """
        h, w = sheet.shape
        pose = np.asarray(camera_from_sheet, float)
        scale = np.array(
            [[size_m[0] / w, 0, 0.5 * size_m[0] / w], [0, size_m[1] / h, 0], [0, 0, 1]]
        )
        scale[1, 2] = 0.5 * size_m[1] / h
        ray_from_texel = pose[:3, [0, 1, 3]] @ scale
        fine = self._fine_rays
        maps = np.empty(fine.shape[:2], np.float32), np.empty(fine.shape[:2], np.float32)
        texel_maps(fine, np.linalg.inv(ray_from_texel), *maps)
        layer = cv2.merge((sheet, np.full_like(sheet, 255)))
        drawn = cv2.remap(layer, *maps, cv2.INTER_LINEAR, borderValue=(0, 0))
        drawn = cv2.resize(drawn, self._shape[::-1], interpolation=cv2.INTER_AREA)
        drawn = cv2.GaussianBlur(drawn, (0, 0), self.scene.lens_blur_px)
        image = self._desk.copy()
        self._draw_plate(image, self.view, np.eye(3))
        ink = (drawn[..., 0] * 0.82 + drawn[..., 1] * 0.11).astype(np.uint8)  # paper, not paint
        lay_over(image, cv2.merge((ink, ink, ink, drawn[..., 1])), 1.0)
        return self._expose(image, 1.0)

    @cached_property
    def _fine_rays(self) -> np.ndarray:
        return _rays(self.view.camera, 3)

    def _expose(self, image: np.ndarray, brightness: float) -> np.ndarray:
        start = int(self._rng.integers(self._noise.size - image.size))
        noise = self._noise[start : start + image.size]
        return expose_sensor(image.reshape(-1), noise, brightness).reshape(image.shape)

    def _draw_noise(self) -> np.ndarray:
        """Sensor noise in 1/64 DN, longer than a frame; every frame starts elsewhere in it."""
        size = 3 * self._shape[0] * self._shape[1] + 100_003
        noise = self._rng.standard_normal(size, dtype=np.float32)
        noise *= 64.0 * self.scene.noise_dn
        return np.clip(np.rint(noise), -32767, 32767).astype(np.int16)

    def _draw_desk(self) -> np.ndarray:
        scene = self.scene
        lower = self.view.camera_from_plate.copy()
        lower[:3, 3] -= scene.desk_drop_m * lower[:3, 2]
        desk = replace(self.view, camera_from_plate=lower)
        to_desk = np.linalg.inv(lower[:3, [0, 1, 3]])
        rays = np.concatenate((self._rays, np.ones_like(self._rays[..., :1])), axis=2) @ to_desk.T
        points = rays[..., :2] / rays[..., 2:]
        light = self._light_plate
        picture = desk_picture(
            points, scene.plate_side_m, scene.desk_bgr, light, scene.desk_drop_m, self._rng
        )
        image = np.clip(np.rint(picture), 0, 255).astype(np.uint8)
        for thing in scene.desk_balls:
            everywhere = np.full(self._shape, 255, np.uint8)
            xy = np.asarray(thing.xy_m, float)
            self._paint(image, everywhere, desk, xy, np.zeros(2), thing.radius_m, thing.bgr)
        return image

    def _draw_plate(self, image: np.ndarray, view: View, rotation: np.ndarray) -> np.ndarray:
        """Draw the plate in place; returns its alpha (h, w), zero where there is no plate."""
        half = self.scene.plate_side_m * (0.5 + PADDING / TEXELS)
        corners = half * np.array([(-1, 1, 0), (1, 1, 0), (1, -1, 0), (-1, -1, 0)])
        uv = view.pixel_from_plate(corners)
        x0, y0, x1, y1 = _window(uv.min(0), uv.max(0), 3.0, self._shape)
        cover = np.zeros(self._shape, np.uint8)
        if x1 <= x0 or y1 <= y0:
            return cover
        ray_from_plate = view.camera_from_plate[:3, [0, 1, 3]]
        texel_from_ray = self._texel_from_plate @ np.linalg.inv(ray_from_plate)
        maps = np.empty((y1 - y0, x1 - x0), np.float32), np.empty((y1 - y0, x1 - x0), np.float32)
        texel_maps(self._rays[y0:y1, x0:x1], texel_from_ray, *maps)
        layer = cv2.remap(self._texture, *maps, cv2.INTER_LINEAR, borderValue=(0, 0, 0, 0))
        facing = float(rotation[:, 2] @ self._light_plate) / float(self._light_plate[2])
        lay_over(image[y0:y1, x0:x1], layer, 0.5 + 0.5 * facing)
        cover[y0:y1, x0:x1] = layer[..., 3]
        return cover

    def _draw_ball(self, image, cover, view: View, xy: np.ndarray, streak: np.ndarray) -> None:
        scene = self.scene
        self._paint(image, cover, view, xy, streak, scene.ball_radius_m, scene.ball_bgr)

    def _paint(self, image, cover, view: View, xy, streak, radius_m: float, bgr: Colour) -> None:
        """A ball and its shadow, in place; `streak` (2,) m is its path during the exposure."""
        ends = np.array([view.silhouette_from_ball(xy + s * streak, radius_m) for s in (-0.5, 0.5)])
        reach = ends[:, 2].max()
        low, high = ends[:, :2].min(0), ends[:, :2].max(0)
        R, t = view.camera_from_plate[:3, :3], view.camera_from_plate[:3, 3]
        centre = R @ (xy[0], xy[1], radius_m) + t
        if self.scene.shadow > 0:
            x0, y0, x1, y1 = _window(low, high, 2.6 * reach, self._shape)
            at = slice(y0, y1), slice(x0, x1)
            normal, light = np.ascontiguousarray(R[:, 2]), self._light
            shade = radius_m, light, self.scene.shadow
            cast_shadow(image[at], self._rays[at], cover[at], normal, centre, *shade)
        # One copy a half pixel of path: the steps stay below the lens's own blur.
        copies = 1 + 2 * ceil(float(np.hypot(*(ends[1] - ends[0])[:2])))
        steps = (np.arange(copies) + 0.5) / copies - 0.5
        centres = centre + steps[:, None] * (R[:, :2] @ streak)
        x0, y0, x1, y1 = _window(low, high, reach * 1.1 + 3, self._shape)
        at = slice(y0, y1), slice(x0, x1)
        look = reach / radius_m, self._soft_px, np.asarray(bgr, float), self._light, self._half
        paint_ball(image[at], self._rays[at], centres, radius_m, *look)


def _window(low, high, margin: float, shape: tuple[int, int]) -> tuple[int, int, int, int]:
    """Pixels (x0, y0, x1, y1) of a box with margin, cut to the image; empty when outside."""
    x0, y0 = (int(max(np.floor(c - margin), 0)) for c in low)
    x1, y1 = (int(min(np.ceil(c + margin) + 1, n)) for c, n in zip(high, shape[::-1], strict=True))
    return min(x0, shape[1]), min(y0, shape[0]), max(x1, 0), max(y1, 0)


def _rays(camera: Camera, finer: int) -> np.ndarray:
    """Undistorted normalised coordinates (h, w, 2) float32 of all pixels, `finer` times denser.

    Denser ones are interpolated: over one pixel a lens is straight to 1e-6 px.
    """
    u, v = np.meshgrid(np.arange(-1.0, camera.width_px + 1), np.arange(-1.0, camera.height_px + 1))
    rays = camera.ray_from_pixel(np.column_stack((u.ravel(), v.ravel()))).reshape(*u.shape, 2)
    if finer > 1:
        rays = cv2.resize(rays, None, fx=finer, fy=finer, interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(rays[finer:-finer, finer:-finer], np.float32)
