"""Pictures of a plan: MuJoCo renders them, a sensor spoils them, and the ball's place is known."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass

os.environ.setdefault("MUJOCO_GL", "egl")  # read when MuJoCo is imported

import cv2
import mujoco
import numpy as np

from tests.support.strange_film import StrangeFilm
from tests.support.third_world.motion import Moment, moments
from tests.support.third_world.plan import Plan, draw
from tests.support.third_world.scene import PLATE_Z_M, grain, model_text, pictures
from tests.support.third_world.steel import reflected
from vision.frames import Frame

MOST_SUBFRAMES = 4  # images that are averaged to a motion blur
# Points (n, 2) spread evenly over a disc of radius 0.97: a sunflower's seeds.
_TURN = 2.399963 * np.arange(120)
_SPREAD = (
    0.97
    * np.sqrt((np.arange(120)[:, None] + 0.5) / 120)
    * np.stack((np.cos(_TURN), np.sin(_TURN)), 1)
)


@dataclass(frozen=True)
class Eye:
    """The camera: place [m], axes (3, 3) as rows right, down, ahead, and focal length [px]."""

    place: np.ndarray
    axes: np.ndarray
    focal_px: float
    size: tuple[int, int]

    def project(self, points: np.ndarray) -> np.ndarray:
        """Pixels (n, 2) of points (n, 3) [m]; the centre of the first pixel is (0, 0)."""
        seen = (points - self.place) @ self.axes.T
        middle = 0.5 * (np.array(self.size) - 1.0)
        return self.focal_px * seen[:, :2] / seen[:, 2:] + middle


def third_film(seed: int, *, quick: bool = False) -> StrangeFilm:
    """The film of a seed; `quick`: small and short of pixels."""
    plan = draw(seed, quick=quick)
    rng = np.random.default_rng([seed, 4711])
    assets = pictures(plan, rng)
    model = mujoco.MjModel.from_xml_string(model_text(plan), assets)
    film = StrangeFilm(seed, plan.words, plan.kind)
    with mujoco.Renderer(model, plan.size[1], plan.size[0]) as renderer:
        studio = Studio(plan, model, mujoco.MjData(model), renderer, rng)
        for k, (image, truth, shown) in enumerate(studio.takes()):
            film.frames.append(Frame(image, k / plan.fps, k))
            film.truth.append(truth)
            film.shown.append(shown)
    return film


def ball_in(eye: Eye, centre: np.ndarray, radius_m: float) -> tuple[float, float, float]:
    """(u, v, radius) px of a sphere's outline: the circle where lines of sight touch it, projected;
    the middle of its box and the radius of the disc with its area."""
    away = centre - eye.place
    far = float(np.linalg.norm(away))
    ahead = away / far
    side = np.cross(ahead, eye.axes[1])
    side /= np.linalg.norm(side)
    up = np.cross(ahead, side)
    sine = radius_m / far
    turn = np.linspace(0.0, 2.0 * math.pi, 96, endpoint=False)[:, None]
    ring = np.cos(turn) * side + np.sin(turn) * up
    points = centre - sine * radius_m * ahead + radius_m * math.sqrt(1 - sine**2) * ring
    rim = eye.project(points)
    (u, v), (x, y) = 0.5 * (rim.max(0) + rim.min(0)), rim.T
    area = 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
    return float(u), float(v), math.sqrt(area / math.pi)


class Studio:
    """A film in the making."""

    def __init__(self, plan: Plan, model, data, renderer, rng: np.random.Generator) -> None:
        self._plan, self._model, self._data, self._renderer = plan, model, data, renderer
        self._rng = rng
        self._room = grain(rng, 256, 0.9)
        self._ball_id = model.geom("ball").id

    def takes(self) -> Iterator[tuple[np.ndarray, tuple[float, float, float], float]]:
        """Image (h, w, 3) BGR, the ball's (u, v, radius) px, and the share of it that is seen."""
        plan = self._plan
        for moment in moments(plan, self._rng):
            eye = self._eye(moment.t_s)
            truth = ball_in(eye, moment.ball, plan.radius_m)
            image = self._exposed(eye, moment)
            self._place(eye, moment, moment.ball)
            yield self._sensed(image, moment.t_s), truth, self._shown(eye, truth)

    def _eye(self, t_s: float) -> Eye:
        plan = self._plan
        c, s = math.cos(plan.lift_rad), math.sin(plan.lift_rad)
        aim = np.array((*plan.shift, PLATE_Z_M))
        back = np.array((c * math.cos(plan.turn_rad), c * math.sin(plan.turn_rad), s))
        right = np.array((-math.sin(plan.turn_rad), math.cos(plan.turn_rad), 0.0))
        axes = np.stack((right, np.cross(-back, right), -back))
        zoom = 1.0
        if plan.kind == "zoom":
            zoom = 1.0 - 0.3 * (1.0 - math.cos(2.0 * math.pi * t_s / plan.seconds)) / 2.0
        return Eye(aim + plan.away_m * back, axes, zoom * plan.focal_px, plan.size)

    def _exposed(self, eye: Eye, moment: Moment) -> np.ndarray:
        """Image (h, w, 3) RGB float32 over the exposure."""
        plan = self._plan
        ends = [moment.ball + at * plan.exposure_s * moment.speed for at in (-0.5, 0.5)]
        way = math.dist(*eye.project(np.array(ends)))
        many = max(1, min(MOST_SUBFRAMES, math.ceil(way / 1.5)))
        total = np.zeros((plan.size[1], plan.size[0], 3), np.float32)
        for k in range(many):
            at = (k + 0.5) / many - 0.5
            ball = moment.ball + at * plan.exposure_s * moment.speed
            self._place(eye, moment, ball)
            self._renderer.update_scene(self._data, "eye")
            image = self._renderer.render().astype(np.float32)
            if plan.kind == "steel":
                paint = np.array(plan.plate_rgb, np.float32)
                reflected(image, eye, ball, plan.radius_m, self._room, paint)
            total += image
        return total / many

    def _place(self, eye: Eye, moment: Moment, ball: np.ndarray) -> None:
        model, data = self._model, self._data
        places = {"ball": (ball, moment.turn), "plate": (None, moment.plate)}
        places["hand"] = (moment.hand, np.eye(3))
        for k, leaf in enumerate(moment.leaves if self._plan.kind == "leaves" else ()):
            c, s = math.cos(5 * moment.t_s + k), math.sin(5 * moment.t_s + k)
            places[f"leaf{k}"] = (leaf, np.array(((c, -s, 0), (s, c, 0), (0, 0, 1.0))))
        for name, (place, turn) in places.items():
            mocap = model.body(name).mocapid[0]
            if place is not None:
                data.mocap_pos[mocap] = place
            mujoco.mju_mat2Quat(data.mocap_quat[mocap], np.ascontiguousarray(turn).ravel())
        model.cam_pos[0] = eye.place
        seen = np.stack((eye.axes[0], -eye.axes[1], -eye.axes[2]), 1)
        mujoco.mju_mat2Quat(model.cam_quat[0], np.ascontiguousarray(seen).ravel())
        model.cam_fovy[0] = math.degrees(2 * math.atan(0.5 * eye.size[1] / eye.focal_px))
        mujoco.mj_forward(model, data)

    def _shown(self, eye: Eye, truth: tuple[float, float, float]) -> float:
        """Share of points of the ball's disc that lie in the image with nothing before them."""
        (w, h), seen = eye.size, 0
        for x, y in _SPREAD:
            u, v = truth[0] + truth[2] * x, truth[1] + truth[2] * y
            if not (-0.5 < u < w - 0.5 and -0.5 < v < h - 0.5):
                continue
            ahead = (u - 0.5 * (w - 1), v - 0.5 * (h - 1), eye.focal_px) @ eye.axes
            first = np.array([-1], np.int32)
            args = eye.place, ahead, None, 1, -1, first
            mujoco.mj_ray(self._model, self._data, *args, None)
            seen += int(first[0]) == self._ball_id
        return seen / len(_SPREAD)

    def _sensed(self, rgb: np.ndarray, t_s: float) -> np.ndarray:
        """Image (h, w, 3) BGR uint8 of a sensor: soft, noisy, of changing exposure, mosaicked,
        packed."""
        plan, rng = self._plan, self._rng
        if plan.soft_px > 0.25:
            rgb = cv2.GaussianBlur(rgb, (0, 0), plan.soft_px)
        gain = 1.0
        if plan.kind == "exposure":
            gain = 0.75 + 0.35 * math.tanh(8.0 * math.sin(5.0 * t_s + plan.turn_rad))
        noise = plan.noise * rng.standard_normal(rgb.shape, dtype=np.float32)
        raw = np.clip(np.rint(gain * rgb + noise), 0, 255).astype(np.uint8)
        bgr = np.ascontiguousarray(raw[..., ::-1])
        if "bayer" in plan.sensor:
            mosaic = bgr[..., 1].copy()
            mosaic[0::2, 0::2], mosaic[1::2, 1::2] = bgr[0::2, 0::2, 2], bgr[1::2, 1::2, 0]
            bgr = cv2.cvtColor(mosaic, cv2.COLOR_BayerRGGB2BGR)
        if "jpeg" in plan.sensor:
            quality = 55 + (11 * plan.seed) % 40
            data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
            bgr = cv2.imdecode(data, cv2.IMREAD_COLOR)
        assert bgr is not None
        return bgr
