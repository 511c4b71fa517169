"""A film of somebody else's table, drawn at random from a seed.

Another camera and place, ball, plate, light, markers, clutter, hand, leaf, frame rate; the ball
rests, rolls, is taken away and put down again. Nothing here was chosen by what a tracker can do.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from tests.support.other_world.rays import cast, silhouette
from tests.support.strange_film import StrangeFilm
from vision.frames import Frame

COLOURS = {  # linear BGR, 0..1
    "orange": (0.01, 0.16, 0.80),
    "green": (0.06, 0.25, 0.05),
    "muted green": (0.10, 0.16, 0.09),
    "tan": (0.12, 0.27, 0.45),
    "blue": (0.40, 0.08, 0.02),
    "pink": (0.35, 0.25, 0.75),
    "white": (0.82, 0.84, 0.84),
    "black": (0.012, 0.012, 0.014),
    "steel": (0.3, 0.3, 0.3),
}
PLATES = {
    "pale": (0.60, 0.64, 0.66),
    "white": (0.80, 0.82, 0.82),
    "wood": (0.10, 0.22, 0.38),
    "dark": (0.025, 0.022, 0.02),
    "grey": (0.2, 0.2, 0.2),
    "blue": (0.30, 0.14, 0.05),
}
SKINS = ((0.22, 0.32, 0.62), (0.10, 0.16, 0.32), (0.04, 0.07, 0.16))
SIDE_M = 0.30


@dataclass
class _Plan:
    """What a seed drew."""

    rng: np.random.Generator
    fps: float
    seconds: float
    size: tuple[int, int]
    ball: str
    plate: str
    kind: int
    radius_px: float
    radius_m: float
    focal: float
    camera: np.ndarray
    tilt_rad: float
    rest_s: float
    gone: tuple[float, float] | None
    arm: str
    leaf: bool
    exposure_s: float
    noise: float
    blur_px: float
    jpeg: int | None
    gain: float


def strange_film(seed: int, *, quick: bool = False) -> StrangeFilm:
    """The film of a seed, with everything in it drawn at random; `quick`: small and short."""
    plan = _draw(seed, quick)
    numbers = _things(plan)
    words = (
        f"{plan.ball}{('', ' striped', ' half', '')[plan.kind]} r {plan.radius_px:.0f} "
        f"on {plan.plate}, "
        f"{plan.size[0]}x{plan.size[1]} at {plan.fps:.0f}/s, rest {plan.rest_s:.1f} s"
        f"{', put down again' if plan.gone else ''}{', ' + plan.arm if plan.arm else ''}"
        f"{', leaf' if plan.leaf else ''}"
    )
    film = StrangeFilm(seed, words)
    for k, moment in enumerate(_motion(plan)):
        _take(film, plan, numbers, moment, k)
    return film


def _draw(seed: int, quick: bool) -> _Plan:
    rng = np.random.default_rng([seed, 77])
    fps = float(rng.choice((30.0, 30.0, 100.0, 250.0)))
    sizes = ((320, 240), (640, 480), (640, 480), (960, 540), (1280, 720))
    size = sizes[0] if quick or fps > 200 else sizes[int(rng.integers(0, 3 if fps > 50 else 5))]
    ball = str(rng.choice(list(COLOURS)))
    plate = str(rng.choice([p for p in PLATES if _differ(ball, p)]))
    kind = 3 if ball == "steel" else int(rng.choice((0, 0, 0, 1, 2)))
    low, high = 5.0, 0.25 * size[1]
    radius_px = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    if rng.random() < 0.08:
        radius_px = float(rng.uniform(0.3, 0.4)) * size[1]
    radius_m = float(rng.uniform(0.012, 0.022)) if radius_px < 0.15 * size[1] else 0.035
    away = float(rng.uniform(0.5, 1.0))
    lift = math.radians(float(rng.choice((90, 80, 60, 40, 25)) + rng.uniform(-4, 4)))
    seconds = 3.0 if fps < 90 else 2.0 if fps < 200 else 1.5
    gone = None
    if rng.random() < 0.4:
        start = 0.4 * seconds + float(rng.uniform(0.0, 0.2))
        gone = (start, start + 0.25 * seconds)
    return _Plan(
        rng,
        fps,
        seconds,
        size,
        ball,
        plate,
        kind,
        radius_px,
        radius_m,
        radius_px * away / radius_m,
        _look(away, lift, float(rng.uniform(-math.pi, math.pi))),
        math.radians(float(rng.uniform(2, 10))),
        float(rng.choice((0.0, 0.0, 0.6, 1.2, seconds))),
        gone,
        "hand"
        if gone or rng.random() < 0.3
        else "sleeve of its colour"
        if rng.random() < 0.1
        else "",
        bool(rng.random() < 0.25),
        float(rng.choice((0.001, 0.004, 0.012))) if fps < 90 else 0.3 / fps,
        float(rng.uniform(0.002, 0.012)),
        float(rng.uniform(0.4, 1.3)),
        None if rng.random() < 0.4 else int(rng.integers(60, 95)),
        float(rng.uniform(0.5, 1.1)),
    )


def _differ(ball: str, plate: str) -> bool:
    """Whether a person could tell them apart."""
    a, b = (np.array(c) ** (1 / 2.2) for c in (COLOURS[ball], PLATES[plate]))
    return float(np.linalg.norm(a - b)) > 0.28


def _look(away: float, lift: float, turn: float) -> np.ndarray:
    """Camera (4, 3) that looks at the plate's centre from `away` m, `lift` rad above the desk."""
    place = away * np.array(
        (math.cos(lift) * math.cos(turn), math.cos(lift) * math.sin(turn), math.sin(lift))
    )
    forward = -place / away
    right = np.cross(
        forward, (0.0, 0.0, 1.0) if lift < 1.5 else (math.cos(turn), math.sin(turn), 0)
    )
    right /= np.linalg.norm(right)
    return np.stack((right, np.cross(forward, right), forward, place))


def _things(plan: _Plan) -> tuple:
    """The scene's numbers that stay, as `rays.cast` takes them, without the ball's turn."""
    rng = plan.rng
    marks = []
    half = SIDE_M / 2
    dark = (0.02, 0.02, 0.02) if sum(PLATES[plan.plate]) > 0.3 else (0.5, 0.5, 0.5)
    style = int(rng.integers(0, 4))
    if style == 1:  # square markers with white margins in the corners
        for x, y in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
            at = (0.82 * half * x, 0.82 * half * y)
            marks += [(*at, 0.022, 0, 0, 0.8, 0.8, 0.8), (*at, 0.017, 0, 0, 0.02, 0.02, 0.02)]
            marks += [(at[0] + 0.004, at[1] - 0.003, 0.006, 0, 0, 0.8, 0.8, 0.8)]
    elif style == 2:  # screws and a cross
        marks += [
            (0.9 * half * x, 0.9 * half * y, 0.005, 0, 1, *dark) for x in (-1, 1) for y in (-1, 1)
        ]
    elif style == 3:  # a bull's eye
        marks += [(0, 0, 0.06, 0.056, 1, *dark), (0, 0, 0.11, 0.107, 1, *dark)]
    desk_marks = []
    for _ in range(int(rng.integers(0, 7))):  # coins, tape, papers beside the plate
        a, far = rng.uniform(0, 2 * np.pi), rng.uniform(0.22, 0.4)
        wide, kind = rng.uniform(0.008, 0.04), float(rng.integers(0, 2))
        ring = 0.6 * wide if kind and rng.random() < 0.5 else 0.0
        colour = rng.uniform(0.02, 0.7, 3)
        desk_marks.append((far * np.cos(a), far * np.sin(a), wide, ring, kind, *colour))
    ball = np.array(COLOURS[plan.ball])
    two = np.array(COLOURS[str(rng.choice(("white", "black", "blue", "orange")))])
    lamp = np.array((rng.uniform(-0.8, 0.8), rng.uniform(-0.8, 0.8), 1.0))
    ambient = float(rng.uniform(0.25, 0.6))
    return (
        rng.uniform(0.02, 0.5, 3),
        np.array(desk_marks or np.empty((0, 8)), float).reshape(-1, 8),
        np.array(PLATES[plan.plate]),
        np.array(marks, float).reshape(-1, 8),
        float(rng.uniform(0.0, 0.25)),
        ball,
        two,
        np.eye(3),
        plan.kind,
        float(rng.choice((0.0, 0.2, 0.8))),
        lamp / np.linalg.norm(lamp),
        np.array((ambient, 1.0 - ambient)),
    )


@dataclass
class _Moment:
    t_s: float
    plate: np.ndarray
    xy: np.ndarray
    speed: np.ndarray
    turn: np.ndarray
    there: bool
    hand: np.ndarray | None  # palm [m]
    leaf: np.ndarray


def _motion(plan: _Plan):
    """The moments of the film, one a frame: smooth paths of plate, ball, hand and leaf."""
    rng = plan.rng
    # No farther out than the image and the plate show.
    reach = min(0.4 * SIDE_M, 0.5 * plan.size[1] * np.linalg.norm(plan.camera[3]) / plan.focal)
    reach = max(0.3 * reach, reach - 1.2 * plan.radius_m)
    phase, rate = rng.uniform(0, 2 * np.pi, 4), rng.uniform(1.2, 3.5, 2)
    turn, last = np.eye(3), None
    put = rng.uniform(-0.6, 0.6, 2) * reach
    for k in range(round(plan.seconds * plan.fps)):
        t = k / plan.fps
        moving = max(0.0, t - plan.rest_s)
        ease = moving * moving / (moving + 0.3) if moving else 0.0
        xy = 0.8 * reach * np.array([math.sin(rate[i] * ease + phase[i]) for i in range(2)])
        there = True
        if plan.gone:
            there = not plan.gone[0] <= t < plan.gone[1]
            if t >= plan.gone[1]:  # put down elsewhere; it rests, then rolls
                later = max(0.0, t - plan.gone[1] - 0.3)
                xy = put + 0.3 * reach * np.array((math.sin(2.5 * later), 1 - math.cos(2 * later)))
        step = xy - last if last is not None else np.zeros(2)
        if np.hypot(*step) > 0.05:
            step = np.zeros(2)
        last = xy
        turn = turn @ _rolled(step / plan.radius_m)
        wag = plan.tilt_rad * (moving > 0 or plan.gone is not None)
        tilt = wag * np.array((math.sin(2.1 * t + phase[2]), math.sin(1.7 * t + phase[3])))
        hand = _hand_at(plan, t, xy, reach)
        leaf = _leaf_at(plan, t, reach)
        yield _Moment(t, _plate_at(tilt), xy, step * plan.fps, turn, there, hand, leaf)


def _rolled(angle: np.ndarray) -> np.ndarray:
    """Turn (3, 3) of a ball that rolled by `angle` (2,) rad in x and y."""
    matrix, _ = cv2.Rodrigues(np.array((angle[1], -angle[0], 0.0)))
    return np.asarray(matrix)


def _plate_at(tilt: np.ndarray) -> np.ndarray:
    turn, _ = cv2.Rodrigues(np.array((-tilt[1], tilt[0], 0.0)))
    return np.vstack((np.asarray(turn).T, np.zeros(3), (SIDE_M / 2, 0, 0)))


def _hand_at(plan: _Plan, t: float, xy: np.ndarray, reach: float) -> np.ndarray | None:
    """Place of the palm [m]: it comes for the ball and brings it back, or waves about beside it."""
    if not plan.arm:
        return None
    if plan.gone:
        near = min(abs(t - plan.gone[0]), abs(t - plan.gone[1]))
        return np.array(
            (xy[0] + 0.7 * near, xy[1] + 0.25 * near, 0.02 + plan.radius_m + 0.1 * near)
        )
    a = 2.0 * t
    return np.array((0.17 + 0.08 * math.sin(a), 0.1 * math.cos(1.3 * a), 0.06))


def _leaf_at(plan: _Plan, t: float, reach: float) -> np.ndarray:
    colour = (0.03, 0.20, 0.06)
    if not plan.leaf:
        return np.zeros(8)
    across = 0.25 - 0.5 * ((0.8 * t) % 1.0)
    return np.array((across, 0.12 + 0.02 * math.sin(9 * t), 0.05, 0.008, 3.0 * t, *colour))


def _arm(plan: _Plan, palm: np.ndarray | None, skin: np.ndarray) -> np.ndarray:
    """Capsules (n, 10): forearm in its sleeve, palm, five fingers that reach for the plate."""
    if palm is None:
        return np.empty((0, 10))
    sleeve = np.array(COLOURS[plan.ball]) if "colour" in plan.arm else 0.3 * skin[::-1] + 0.05
    wrist, elbow = palm + np.array((0.09, 0.03, 0.05)), palm + np.array((0.45, 0.2, 0.2))
    rows = [(*wrist, *elbow, 0.04, *sleeve), (*palm, *wrist, 0.026, *skin)]
    for k in range(5):
        a = 0.5 * (k - 2)
        tip = palm + np.array((-0.05 * math.cos(a), 0.05 * math.sin(a), -0.02))
        rows.append((*palm, *tip, 0.009, *skin))
    return np.array(rows)


def _take(film: StrangeFilm, plan: _Plan, numbers: tuple, now: _Moment, k: int) -> None:
    """Render one frame and note its truth."""
    centre = now.plate[:3].T @ np.array((*now.xy, plan.radius_m))
    ball = np.array((*centre, plan.radius_m if now.there else 0.0))
    sweep = now.plate[:2].T @ now.speed * plan.exposure_s
    skin = np.array(SKINS[film.seed % 3])
    scene = (*numbers[:7], now.turn, *numbers[8:])
    arms = _arm(plan, now.hand, skin)
    args = plan.camera, plan.focal, scene, now.plate, ball, sweep, arms, now.leaf
    linear, shown = cast(plan.size, *args)
    u, v, r = silhouette(plan.camera, plan.focal, plan.size, centre, plan.radius_m)
    image = cv2.GaussianBlur(linear, (0, 0), plan.blur_px) * plan.gain
    noise = plan.noise * np.sqrt(0.1 + np.clip(image, 0, 1))
    image = image + noise * plan.rng.standard_normal(image.shape)
    seen = np.rint(255 * np.clip(image, 0, 1) ** (1 / 2.2)).astype(np.uint8)
    if plan.jpeg is not None:
        ok, data = cv2.imencode(".jpg", seen, [cv2.IMWRITE_JPEG_QUALITY, plan.jpeg])
        assert ok
        seen = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR))
    film.frames.append(Frame(seen, now.t_s, k))
    film.truth.append((u, v, r))
    film.shown.append(shown / (math.pi * r * r))
