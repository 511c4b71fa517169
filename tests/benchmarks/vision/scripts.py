"""Scripts of the hard cases: frames with exact truth, and whether the ball can be seen in each."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import cv2
import numpy as np

from tests.benchmarks.vision.scenes import BALLS, PLATES, SHADED, Look, Shot, Studio, rolling

SKIN = (120.0, 150.0, 205.0)
Script = Iterator[tuple[Shot, bool | None]]  # the shot; whether the ball shows, None: half of it


def plain(look: Look, n: int, *, fps: float = 60.0, size: tuple[int, int] = (640, 480)) -> Script:
    """The ball rolls on its curve."""
    studio = Studio(look, size)
    places, speeds, times = rolling(look.speed_m_s, n, fps)
    for place, speed, t in zip(places, speeds, times, strict=True):
        yield studio.shot(place, speed, t), True


def changing_light(n: int) -> Script:
    """Light from 0.3 to 2 times (what is brighter than white is white) and 3000 to 6500 K."""
    studio = Studio(SHADED)
    places, speeds, times = rolling(0.3, n)
    for k in range(n):
        level = 0.3 * (2.0 / 0.3) ** (0.5 - 0.5 * np.cos(4 * np.pi * k / n))
        warm = 0.5 + 0.5 * np.sin(6 * np.pi * k / n)
        tint = np.array((1.0, 1.0, 1.0)) * (1 - warm) + np.array((0.5, 0.85, 1.2)) * warm
        studio.look = replace(SHADED, gain=tuple(0.6 * level * tint))
        yield studio.shot(places[k], speeds[k], times[k]), True


def hand(n: int) -> Script:
    """A hand comes over the ball, hides it, and goes."""
    studio = Studio(SHADED)
    places, speeds, times = rolling(0.25, n)
    for k in range(n):
        lit = studio.lit(places[k], speeds[k])
        u, v, r = studio.silhouette(places[k])
        away = max(0.0, abs(k - 0.6 * n) / (0.6 * n) * 14.0 - 1.5)  # radii to the fist's middle
        _paint_hand(lit, u, v - away * r, r)
        clear = True if away > 2.6 else None if away > 0.9 else False
        yield Shot(studio.expose(lit), u, v, r, times[k]), clear


def second_ball(n: int) -> Script:
    """Another ball of the same kind comes to roll on the plate too; the first is the ball."""
    studio = Studio(SHADED)
    places, speeds, times = rolling(0.25, n)
    others, _, _ = rolling(0.35, n, span_m=0.07)
    for k in range(n):
        other = (others[k][1] - 0.03, -others[k][0])
        ground = studio.background
        if k > 0.3 * n and np.hypot(*(np.array(other) - places[k])) > 0.045:
            ground = studio.lit(other)
        lit = studio.lit(places[k], speeds[k], ground=ground)
        yield Shot(studio.expose(lit), *studio.silhouette(places[k]), times[k]), True


def set_down_elsewhere(n: int) -> Script:
    """The ball lies still and is elsewhere, 4 to 60 mm away, every third frame."""
    studio, rng = Studio(SHADED), np.random.default_rng(6)
    place = np.zeros(2)
    for k in range(n):
        while k % 3 == 0:
            far, way = rng.choice((0.004, 0.013, 0.02, 0.06)), rng.uniform(0, 2 * np.pi)
            there = place + far * np.array((np.cos(way), np.sin(way)))
            if np.abs(there).max() < 0.1:
                place = there
                break
        yield studio.shot(tuple(place), (0.0, 0.0), k / 60), True


def twin_mark(n: int) -> Script:
    """A flat disc of the ball's colour and size lies on the plate, beside the ball's path."""
    studio = Studio(SHADED)
    u, v, r = studio.silhouette((0.045, 0.075))
    fine = (round(16 * u), round(16 * v))
    colour = tuple(0.9 * c for c in BALLS["orange"])
    cv2.circle(studio.background, fine, round(16 * r), colour, -1, cv2.LINE_AA, 4)
    places, speeds, times = rolling(0.25, n, span_m=0.06)
    for k in range(n):
        far = np.hypot(*(places[k] - (0.045, 0.075))) > 0.043
        yield studio.shot(places[k], speeds[k], times[k]), True if far else None


def out_of_the_image(n: int) -> Script:
    """The ball rolls off at the image's lower edge and comes back, twice."""
    studio = Studio(SHADED)
    for k in range(n):
        y = -0.11 - 0.075 * np.sin(4 * np.pi * k / n)
        shot = studio.shot((0.02, y), (0.0, 0.0), k / 60)
        left = (479.5 - shot.v_px) / shot.radius_px  # radii of the centre inside the image
        yield shot, True if left > 1.1 else None if left > -1.05 else False


def dropped(n: int) -> Script:
    """Three frames of ten never arrive."""
    rng = np.random.default_rng(4)
    for k, pair in enumerate(plain(replace(SHADED, speed_m_s=0.4), n)):
        if k < 12 or rng.random() > 0.3:
            yield pair


def duplicated(n: int) -> Script:
    """Every third frame comes twice, the second time with a later stamp."""
    for k, (shot, clear) in enumerate(plain(replace(SHADED, speed_m_s=0.3), n)):
        yield shot, clear
        if k % 3 == 2:
            yield replace(shot, t_s=shot.t_s + 0.008), clear


def corrupt(n: int) -> Script:
    """Every fifth frame is broken: its lower half grey or shifted, all noise, or all black."""
    rng = np.random.default_rng(5)
    for k, (shot, clear) in enumerate(plain(replace(SHADED, speed_m_s=0.3), n)):
        image, kind = shot.image.copy(), (k // 5) % 4
        if k < 12 or k % 5:
            yield shot, clear
            continue
        if kind == 0:
            image[240:] = 128
        elif kind == 1:
            image[200:] = np.roll(image[200:], 97, axis=1)
        elif kind == 2:
            image[:] = rng.integers(0, 255, image.shape, np.uint8)
        else:
            image[:] = 0
        yield replace(shot, image=image), None


def streaks(n: int) -> Script:
    """Exposed while it rolls 40 px; the truth is the middle of the streak."""
    look = replace(SHADED, speed_m_s=0.8, exposure_s=0.0333)
    return plain(look, n, fps=30.0)


def sudden_streaks(n: int) -> Script:
    """As `streaks`, but the ball was exposed briefly until it was known."""
    studio = Studio(replace(SHADED, speed_m_s=0.8))
    places, speeds, times = rolling(0.8, n, fps=30.0)
    for k in range(n):
        slow = k < 12 or k % 12 == 11
        studio.look = replace(studio.look, exposure_s=0.001 if slow else 0.0333)
        yield studio.shot(places[k], speeds[k], times[k]), True


def cases() -> dict[str, Callable[[int], Script]]:
    """Name -> script of about n frames."""
    found: dict[str, Callable[[int], Script]] = {}
    for ball in BALLS:
        for plate in PLATES:
            look = replace(SHADED, ball=ball, plate=plate)
            found[f"{ball} ball, {plate} plate"] = lambda n, look=look: plain(look, n)
    found |= {
        "light 0.3 to 2 times, 3000 to 6500 K": changing_light,
        "a hand over the ball": hand,
        "a second ball": second_ball,
        "a disc of its colour on the plate": twin_mark,
        "half outside the image": out_of_the_image,
        "streaks of 40 px": streaks,
        "streaks of 40 px, ball known": sudden_streaks,
        "set down elsewhere, colour named": set_down_elsewhere,
        "dropped frames": dropped,
        "duplicated frames": duplicated,
        "corrupt frames": corrupt,
        "defocus, 3 px": lambda n: plain(replace(SHADED, blur_px=3.0), n),
        "low light, colour named": lambda n: plain(
            replace(SHADED, gain=(0.16, 0.16, 0.16), noise_dn=3.5), n
        ),
    }
    return found


def _paint_hand(image: np.ndarray, u: float, v: float, r: float) -> None:
    """A fist at (u, v) and its arm from above, in place."""
    arm = (int(u - 0.9 * r), 0), (int(u + 1.2 * r), max(0, int(v)))
    cv2.rectangle(image, *arm, tuple(0.9 * c for c in SKIN), -1)
    for du, dv, size in ((0.1, -0.2, 1.6), (-1.2, 0.2, 0.8), (-0.4, 0.9, 0.7), (0.5, 0.9, 0.7)):
        centre = round(16 * (u + du * r)), round(16 * (v + dv * r))
        shade = tuple((0.85 + 0.1 * size) * c for c in SKIN)
        cv2.circle(image, centre, round(16 * size * r), shade, -1, cv2.LINE_AA, 4)
