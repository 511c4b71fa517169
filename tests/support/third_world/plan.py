"""What a seed draws: camera, ball, plate, light, and the one difficulty that names the film."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

KINDS = (
    "plain",
    "hand",
    "sleeve of its colour",
    "leaves",
    "steel",
    "white on pale",
    "striped",
    "half",
    "transparent plate",
    "zoom",
    "exposure",
    "rolls out and in",
    "taken and put down",
    "always at rest",
    "small",
    "large",
)
BALLS = {  # grey levels RGB, 0..255
    "red": (196, 40, 42),
    "orange": (240, 130, 40),
    "yellow": (232, 208, 60),
    "lime": (140, 196, 60),
    "turquoise": (50, 170, 170),
    "navy": (36, 48, 110),
    "purple": (118, 62, 140),
    "black": (30, 30, 32),
    "wood": (188, 148, 104),
    "white": (240, 240, 236),
}
PLATES = {
    "acrylic white": (226, 228, 228),
    "birch": (206, 176, 134),
    "black": (38, 38, 40),
    "aluminium": (150, 152, 156),
    "blue": (60, 84, 140),
    "felt": (52, 96, 60),
}
STEEL = (150, 150, 152)
PALE, GLASS = (206, 206, 202), (214, 226, 228)
LEAST_CONTRAST = 70.0  # grey levels over three channels, below which nobody would play so
SIZES = {True: ((320, 240), (400, 300)), False: ((640, 480), (1280, 720), (1920, 1080))}
RATES = (30.0, 60.0, 100.0, 250.0)
SIDE_M = 0.28  # of the plate


@dataclass(frozen=True)
class Plan:
    """What one film is like; colours are RGB grey levels, lengths m, `lift_rad` the camera's
    height above the desk, `shift` its aim beside the plate's centre."""

    seed: int
    kind: str
    size: tuple[int, int]
    fps: float
    seconds: float
    ball: str
    ball_rgb: tuple[int, ...]
    second_rgb: tuple[int, ...]
    plate: str
    plate_rgb: tuple[int, ...]
    radius_px: float
    radius_m: float
    away_m: float
    lift_rad: float
    turn_rad: float
    shift: tuple[float, float]
    rest_s: float
    lamp: tuple[float, float, float]
    ambient: float
    gloss: float
    markers: bool
    clutter: int
    exposure_s: float
    noise: float
    soft_px: float
    sensor: str
    skin: tuple[int, ...]

    @property
    def focal_px(self) -> float:
        """Of a pinhole camera that shows the ball in the plate's centre at its radius."""
        return self.radius_px * self.away_m / self.radius_m

    @property
    def words(self) -> str:
        """The film in some words."""
        return (
            f"{self.kind}: {self.ball} r {self.radius_px:.0f} on {self.plate}, "
            f"{self.size[0]}x{self.size[1]} at {self.fps:.0f}/s, rest {self.rest_s:.1f} s, "
            f"{self.sensor}"
        )


def draw(seed: int, *, quick: bool = False) -> Plan:
    """The plan of a seed; its kind goes round `KINDS`, all else is drawn."""
    rng = np.random.default_rng([seed, 31337])
    kind = KINDS[seed % len(KINDS)]
    fps = float(rng.choice(RATES))
    sizes = SIZES[quick]
    size = sizes[int(rng.integers(0, len(sizes)))] if quick or fps < 70 else sizes[0]
    ball, plate = _pair(rng, kind)
    short = size[1]
    low, high = {"small": (5.0, 7.0), "large": (0.22 * short, 0.3 * short)}.get(
        kind, (5.0 if short < 600 else 8.0, 0.2 * short)
    )
    radius_px = math.exp(rng.uniform(math.log(low), math.log(high)))
    seconds = 3.0 if fps < 90 else 2.4 if fps < 200 else 1.6
    rest_s = float(rng.choice((0.0, 0.0, 0.5, 1.0)))
    second = BALLS[str(rng.choice([b for b in BALLS if b != ball]))]
    return Plan(
        seed,
        kind,
        size,
        fps,
        seconds,
        ball,
        STEEL if kind == "steel" else BALLS[ball],
        second,
        plate,
        {"pale": PALE, "transparent": GLASS}.get(plate) or PLATES[plate],
        radius_px,
        radius_m=float(rng.uniform(0.01, 0.02)) if radius_px < 0.12 * short else 0.03,
        away_m=float(rng.uniform(0.4, 0.9)),
        lift_rad=math.radians(float(rng.uniform(28, 88))),
        turn_rad=float(rng.uniform(-math.pi, math.pi)),
        shift=tuple(rng.uniform(-0.02, 0.02, 2)),
        rest_s=seconds if kind == "always at rest" else rest_s,
        lamp=(float(rng.uniform(-0.7, 0.7)), float(rng.uniform(-0.7, 0.7)), 1.2),
        ambient=float(rng.uniform(0.25, 0.6)),
        gloss=float(rng.choice((0.05, 0.3, 0.8))),
        markers=bool(rng.random() < 0.5),
        clutter=int(rng.integers(0, 6)),
        exposure_s=float(rng.choice((0.001, 0.005, 0.012))) if fps < 90 else 0.25 / fps,
        noise=float(rng.uniform(0.5, 4.0)),
        soft_px=float(rng.uniform(0.0, 1.1)),
        sensor=str(rng.choice(("raw", "jpeg", "bayer", "bayer and jpeg"))),
        skin=((224, 172, 140), (160, 110, 84), (90, 60, 48))[int(rng.integers(0, 3))],
    )


def _pair(rng: np.random.Generator, kind: str) -> tuple[str, str]:
    """A ball and a plate that a person tells apart."""
    if kind == "white on pale":
        return "white", "pale"
    if kind == "steel":
        return "steel", str(rng.choice([p for p in PLATES if p != "aluminium"]))
    while True:
        ball, plate = str(rng.choice(list(BALLS))), str(rng.choice(list(PLATES)))
        if math.dist(BALLS[ball], PLATES[plate]) > LEAST_CONTRAST:
            return ball, "transparent" if kind == "transparent plate" else plate
