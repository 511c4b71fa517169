"""How right and how honest is one located outline? `python -m tests.benchmarks.vision.locating`

A ball of some 31 px in six lights on two renderers that share no code with `vision` or with each
other: the benchmarks' own (`vision_scenes`: looks straight down, adds light in grey levels) and the
second world's (`tests/support/other_world`: looks askew, linear light, the plate's markers close to
the ball). Located from a guess that is 0.7 px off, its looks learnt at the first place of a scene;
the lamp, the ball's colour and the plate are drawn anew for each of `--looks` looks. Errors are px
per axis; "over sigma" is the rms of the error over what was claimed, 1 where sigma is honest.
`sparse` is the outline that the dense rays start from (`vision.detection.detector`). One minute.
"""

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np

from tests.benchmarks.vision.scenes import CLEAN, SHADED, STANDARD, Look, Shot, Studio
from tests.support.other_world.rays import cast, silhouette
from vision.detection import detector
from vision.detection.appearance import Appearance
from vision.detection.detector import locate_ball

SCENES = ("clean", "shaded", "MJPG q85", "motion", "glare", "low light")
GOALS_PX = (0.0027, 0.015, 0.020, 0.028, 0.055, 0.045)
PLACES, GUESS_PX = 4, 0.7
SIZE, FOCAL_PX, AWAY_M, RADIUS_M = (260, 220), 1125.0, 0.75, 0.020
BALLS = ((0.01, 0.16, 0.80), (0.06, 0.25, 0.05), (0.40, 0.08, 0.02), (0.012, 0.012, 0.014))
PLATE = (0.60, 0.64, 0.66)


@dataclass(frozen=True)
class Strange:
    """A scene of the second world; `gain` of the sensor, `gloss` of the ball."""

    ambient: float = 0.35
    gloss: float = 0.3
    noise: float = 0.004
    jpeg: int | None = None
    speed_m_s: float = 0.0
    exposure_s: float = 0.0
    gain: float = 1.0
    grain: float = 0.05


STRANGE = {
    "clean": Strange(ambient=0.9, gloss=0.0, grain=0.0, noise=0.003),
    "shaded": Strange(),
    "MJPG q85": Strange(jpeg=85),
    "motion": Strange(speed_m_s=0.5, exposure_s=0.008),
    "glare": Strange(gloss=0.9, ambient=0.25),
    "low light": Strange(gain=0.04, noise=0.010),
}


def strange_shots(scene: Strange, rng: np.random.Generator) -> Iterator[Shot]:
    """Images of one look: the ball beside the markers of a plate that is seen askew."""
    way, lean = rng.uniform(0, 2 * math.pi), rng.uniform(0.3, 1.0)
    lamp = np.array((lean * math.cos(way), lean * math.sin(way), 1.0))
    tilt = rng.uniform(0.0, 0.6)
    place = AWAY_M * np.array((0.0, -math.sin(tilt), math.cos(tilt)))
    forward = -place / AWAY_M
    camera = np.stack((np.array((1.0, 0, 0)), np.cross(forward, (1.0, 0, 0)), forward, place))
    marks = []
    for x, y in ((-0.05, -0.04), (-0.05, 0.04), (0.05, -0.04), (0.05, 0.04)):
        marks += [(x, y, 0.014, 0, 0, 0.8, 0.8, 0.8), (x, y, 0.011, 0, 0, 0.02, 0.02, 0.02)]
    ball = np.array(BALLS[int(rng.integers(len(BALLS)))])
    blur_px, light = rng.uniform(0.45, 0.9), np.array((scene.ambient, 1.0 - scene.ambient))
    plate = np.vstack((np.eye(3), np.zeros(3), (0.1375, 0, 0)))
    for _ in range(PLACES):
        at = np.array((*rng.uniform(-0.018, 0.018, 2), RADIUS_M))
        turn = rng.uniform(0, 2 * math.pi)
        sweep = scene.speed_m_s * scene.exposure_s * np.array((math.cos(turn), math.sin(turn), 0.0))
        numbers = (
            np.full(3, 0.1), np.empty((0, 8)), np.array(PLATE), np.array(marks), scene.grain, ball,
            ball, np.eye(3), 0, scene.gloss, lamp / np.linalg.norm(lamp), light,
        )  # fmt: skip
        args = numbers, plate, np.array((*at, RADIUS_M)), sweep, np.empty((0, 10)), np.zeros(8)
        linear, _ = cast(SIZE, camera, FOCAL_PX, *args)
        image = cv2.GaussianBlur(linear, (0, 0), blur_px) * scene.gain
        noise = scene.noise * np.sqrt(0.1 + np.clip(image, 0, 1))
        image = image + noise * rng.standard_normal(image.shape)
        seen = np.rint(255 * np.clip(image, 0, 1) ** (1 / 2.2)).astype(np.uint8)
        if scene.jpeg is not None:
            _, code = cv2.imencode(".jpg", seen, [cv2.IMWRITE_JPEG_QUALITY, scene.jpeg])
            seen = np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR))
        yield Shot(seen, *silhouette(camera, FOCAL_PX, SIZE, at, RADIUS_M), 0.0)


def own_shots(look: Look, rng: np.random.Generator) -> Iterator[Shot]:
    """Images of one look of the benchmarks' renderer, the lamp and the ball drawn anew."""
    way, lean = rng.uniform(0, 2 * math.pi), rng.uniform(0.3, 1.0)
    if look.name != CLEAN.name:
        light = (lean * math.cos(way), lean * math.sin(way), SHADED.light[2])
        ball = str(rng.choice(("orange", "green", "black")))
        look = replace(look, light=light, ball=ball, blur_px=rng.uniform(0.45, 0.9))
    studio = Studio(look, (640, 480), int(rng.integers(1_000_000)))
    for _ in range(PLACES):
        turn = rng.uniform(0, 2 * math.pi)
        speed = look.speed_m_s * math.cos(turn), look.speed_m_s * math.sin(turn)
        yield studio.shot(tuple(rng.uniform(-0.08, 0.08, 2)), speed)


Off = tuple[float, float, float]  # error u, error v, sigma, px


def judged(shots: Iterator[Shot], rng: np.random.Generator) -> list[dict[str, Off]]:
    """Each shot's errors by estimate; empty where the ball was not located."""
    appearance, found, variance = None, [], detector._line_variance
    for shot in shots:
        u, v, radius = shot.u_px, shot.v_px, shot.radius_px
        appearance = appearance or Appearance.learn(shot.image, u, v, radius)
        parts: dict[str, Off] = {}

        def watched(line, parts=parts, u=u, v=v):
            parts["sparse"] = (line.u_px - u, line.v_px - v, math.sqrt(variance(line)))
            return variance(line)

        detector._line_variance = watched
        try:
            du, dv = GUESS_PX * rng.normal(size=2)
            disc = locate_ball(shot.image, appearance, u + du, v + dv, radius)
        finally:
            detector._line_variance = variance
        if disc is not None:
            parts["ours"] = (disc.u_px - u, disc.v_px - v, disc.sigma_px)
        found.append(parts)
    return found


def row(name: str, renderer: str, found: list[dict[str, Off]], goal_px: float) -> str:
    """A line of the table."""
    cells = [name, renderer, f"{goal_px:g}"]
    for part in ("ours", "sparse"):
        off = np.array([f[part] for f in found if part in f])
        if not len(off):
            cells.append("-")
            continue
        error = math.sqrt(np.mean(off[:, :2] ** 2))
        ratio = math.sqrt(np.mean((off[:, :2] / off[:, 2:]) ** 2))
        cells.append(f"{error:.4f}, {ratio:.2f}")
    missed = sum("ours" not in f for f in found)
    return "| " + " | ".join([*cells, f"{missed} of {len(found)}"]) + " |"


def main() -> None:
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--looks", type=int, default=8)
    options.add_argument("--seed", type=int, default=1)
    chosen = options.parse_args()
    cv2.setNumThreads(1)
    looks = {look.name: look for look in STANDARD}
    head = "scene", "renderer", "goal px", "ours: px, over sigma", "sparse", "missed"
    print("| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|")
    for name, goal in zip(SCENES, GOALS_PX, strict=True):
        for renderer in ("own", "second"):
            rng, found = np.random.default_rng([chosen.seed, len(name)]), []
            for _ in range(chosen.looks):
                own = renderer == "own"
                shots = own_shots(looks[name], rng) if own else strange_shots(STRANGE[name], rng)
                found += judged(shots, rng)
            print(row(name, renderer, found, goal), flush=True)


if __name__ == "__main__":
    main()
