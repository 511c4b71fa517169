"""Test footage drawn with numpy: a textured plate, still things of the ball's colour, the ball.

Truth is exact: the ball is a disc with an error-function edge about (u, v).
"""

import math
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from scipy.special import erf

from vision.frames import Frame

BGR = {
    "orange": (40, 130, 240),
    "white": (238, 240, 240),
    "black": (22, 20, 20),
    "green": (40, 120, 30),
    "red": (40, 40, 190),
    "blue": (190, 80, 30),
    "yellow": (40, 210, 230),
}
PLATES = {
    "wood": ((95, 140, 180), 12.0),
    "white": ((215, 220, 222), 3.0),
    "dark": ((48, 44, 42), 5.0),
    "grey": ((128, 130, 128), 4.0),
}


@dataclass
class Film:
    """Frames with truth: `truth[k]` is (u, v) or None where the ball is not to be seen."""

    frames: list[Frame] = field(default_factory=list)
    truth: list[tuple[float, float] | None] = field(default_factory=list)

    def add(self, image: np.ndarray, t_s: float, place: tuple[float, float] | None) -> None:
        self.frames.append(Frame(image, t_s, len(self.frames)))
        self.truth.append(place)


def plate(
    name: str, size: tuple[int, int], rng: np.random.Generator, *, lamp: float = 0.15
) -> np.ndarray:
    """(h, w, 3) float32: a plate with grain and a brightness ramp, on a dark desk."""
    w, h = size
    colour, grain = PLATES[name]
    coarse = rng.normal(0, 1, (h // 8 + 2, w // 32 + 2))
    texture = np.kron(coarse, np.ones((8, 32)))[:h, :w] * grain
    ramp = 1.0 + lamp * (np.linspace(-1, 1, w)[None] + np.linspace(-0.5, 0.5, h)[:, None])
    image = np.full((h, w, 3), 30.0)
    inner = (np.array(colour)[None, None] + texture[..., None]) * ramp[..., None]
    m = h // 16
    image[m : h - m, m * 2 : w - m * 2] = inner[m : h - m, m * 2 : w - m * 2]
    return image.astype(np.float32)


def disc(
    image: np.ndarray,
    place: tuple[float, float],
    radius: float,
    colour: np.ndarray,
    *,
    shade: float = 0.0,
    steel: bool = False,
    blur: float = 0.8,
) -> None:
    """Draw a shaded (share of brightness) or mirroring ball into a float image, sub-pixel exact."""
    u, v = place
    h, w = image.shape[:2]
    reach = int(radius + 5 * blur) + 2
    i0, i1 = max(0, int(v) - reach), min(h, int(v) + reach + 1)
    j0, j1 = max(0, int(u) - reach), min(w, int(u) + reach + 1)
    if i0 >= i1 or j0 >= j1:
        return
    y, x = np.mgrid[i0:i1, j0:j1].astype(float)
    d = np.hypot(x - u, y - v)
    cover = 0.5 * (1 - erf((d - radius) / (blur * math.sqrt(2))))[..., None]
    ball = np.broadcast_to(np.asarray(colour, float), (*d.shape, 3)).copy()
    if shade:
        ball *= (1 - shade * ((x - u) * 0.6 + (y - v) * 0.8) / radius)[..., None]
    if steel:
        ball = _mirror(image[i0:i1, j0:j1].mean((0, 1)), (x - u) / radius, (y - v) / radius)
    image[i0:i1, j0:j1] = image[i0:i1, j0:j1] * (1 - cover) + ball * cover


def _mirror(surround: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A polished ball (..., 3): a dim room above, a lamp, and the plate in its outer third."""
    d2 = x * x + y * y
    room = np.repeat((85 + 35 * np.cos(3.0 * x + 1.0) * (1 - d2))[..., None], 3, -1)
    rim = 0.7 * surround * (1 - 0.15 * (x + y))[..., None]
    mixed = np.where((d2 > 0.65)[..., None], rim, room)
    lamp = np.exp(-((x + 0.3) ** 2 + (y + 0.35) ** 2) / 0.01)[..., None]
    return mixed * (1 - lamp) + 255 * lamp


def exposed(image: np.ndarray, noise: float, rng: np.random.Generator) -> np.ndarray:
    """The float image as a camera would give it: noise, rounding, clipping."""
    bank = _noise_bank(image.shape)
    shift = int(rng.integers(0, image.shape[1])), int(rng.integers(0, len(bank)))
    seen = image + np.float32(noise) * np.roll(bank[shift[1]], shift[0], axis=1)
    return np.clip(np.rint(seen), 0, 255).astype(np.uint8)


@lru_cache(maxsize=4)
def _noise_bank(shape: tuple[int, ...]) -> list[np.ndarray]:
    """Some frames of unit noise: drawing it anew for every frame would take most of the time."""
    rng = np.random.default_rng(99)
    return [rng.standard_normal(shape, np.float32) for _ in range(6)]


def still_disc(
    radius: float, place: tuple[float, float], *, noise: float, shade: float, seed: int
) -> np.ndarray:
    """One image (160, 160, 3) of an orange ball on grey."""
    rng = np.random.default_rng(seed)
    image = np.full((160, 160, 3), (150.0, 165.0, 175.0), np.float32)
    disc(image, place, radius, np.array((30.0, 120.0, 190.0)), shade=shade)
    return exposed(image, noise, rng)


def rolling(
    colour: str,
    *,
    on: str = "wood",
    radius: float = 16.0,
    seconds: float = 4.0,
    fps: float = 30.0,
    size: tuple[int, int] = (640, 480),
    noise: float = 2.0,
    decoys: bool = False,
    hidden: tuple[float, float] | None = None,
    leaves_s: float | None = None,
    rest_s: float = 0.5,
    seed: int = 1,
) -> Film:
    """A ball that rests, then rolls on a Lissajous curve; a hand hides it in `hidden` (s, s).

    `decoys` lays still things of its very colour on the plate: an equal disc and a bar. From
    `leaves_s` on the ball runs off to the right.
    """
    rng = np.random.default_rng(seed)
    ground = plate(on, size, rng)
    bgr = np.array(BGR.get(colour, (128, 128, 128)), float)
    w, h = size
    if decoys:
        disc(ground, (0.8 * w, 0.25 * h), radius, bgr, shade=0.2, steel=colour == "steel")
        ground[int(0.8 * h) : int(0.8 * h + radius), int(0.2 * w) : int(0.2 * w + 5 * radius)] = bgr
    film = Film()
    place = (0.3 * w, 0.5 * h)
    for k in range(round(seconds * fps)):
        t = k / fps
        phase = 2.2 * max(0.0, t - rest_s)
        if leaves_s is not None and t > leaves_s:
            place = (place[0] + 450.0 / fps, place[1])
        else:
            place = (w * (0.5 - 0.2 * math.cos(phase)), h * (0.5 + 0.25 * math.sin(1.4 * phase)))
        image = ground.copy()
        disc(image, place, radius, bgr, shade=0.25, steel=colour == "steel")
        gone = hidden is not None and hidden[0] <= t < hidden[1]
        if hidden is not None and hidden[0] - 0.2 < t < hidden[1] + 0.2:
            _hand(image, place, radius, gone)
        visible = not gone and place[0] < w - radius
        film.add(exposed(image, noise, rng), t, place if visible else None)
    return film


def _hand(image: np.ndarray, place: tuple[float, float], radius: float, over: bool) -> None:
    """A skin-coloured fist, over the ball or beside it, and its arm."""
    skin = np.array((110.0, 140.0, 200.0))
    u, v = place if over else (place[0], place[1] - 6.0 * radius)
    arm = slice(max(0, int(u - radius)), max(1, int(u + 1.5 * radius)))
    image[: max(0, int(v)), arm] = 0.9 * skin
    for du, dv, size in ((0, 0, 1.7), (-1.3, 0.5, 1.0), (1.4, 0.3, 1.1), (0.4, 1.2, 1.0)):
        at = (u + du * radius, v + dv * radius)
        disc(image, at, size * radius, skin, shade=0.3, blur=2.0)
