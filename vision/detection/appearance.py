"""What does the ball look like: which colours are its own, and along which does its edge show best?

*Is this pixel of the ball?* is answered by a table of P(ball | colour) over all colours (5 bits a
channel), which represents any ball: orange, white, steel, black. *Where does it end?* is answered
along one direction in colour space, ball minus plate whitened by the scatter of both (Fisher's
discriminant), so that shading, which moves the colours of ball and plate along their own
brightness, does not bias the edge.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

import cv2
import numpy as np

from vision.detection.pixels import adapted_table, fisher, mean_probability
from vision.detection.rim import colour_is_smeared

BINS = 32
NAMED = {
    "white": "#f4f4f0",
    "black": "#161616",
    "grey": "#8c8c8c",
    "gray": "#8c8c8c",
    "steel": "#8c8c8c",
    "silver": "#a8a8a8",
    "orange": "#f07818",
    "red": "#c81e1e",
    "yellow": "#e6d21e",
    "green": "#1e9632",
    "cyan": "#1eb4c8",
    "blue": "#1e46c8",
    "purple": "#7828aa",
    "magenta": "#c828a0",
    "pink": "#f08cb4",
    "brown": "#784620",
}
# Sensor noise and quantisation that every whitening assumes at least, grey levels.
NOISE_FLOOR = 3.0
# Below this many standard deviations between ball and surround the sign of the edge is not reliable
# (a steel ball mirrors the plate); edges of either sign are then taken.
SIGNED_ABOVE = 2.0
# Scatter of coarsely stored colour, per share of the contrast and root of the radius: it moves the
# edge by 0.3 px, and noise moves the centre the less the larger the ball is.
SMEAR = 0.3


@dataclass(frozen=True, eq=False)
class Appearance:
    """The ball's colours and edge. Colours are BGR, 0..255.

    `ball_bgr` and `surround_bgr` (3,) are means; `direction` (3,) is whitened ball minus surround,
    scaled so that a full edge is 1; `separation` is their distance in standard deviations; `table`
    (32768,) uint8 is 255 P(ball | colour), colour = b << 10 | g << 5 | r of 5 bits each; `fill` is
    the mean P of the ball's own pixels (low for a ball that mirrors the plate); `learned` says
    whether all this was seen in images or assumed from a name; `smeared` whether colour differences
    are stored more coarsely than brightness, as JPEG and most video do.
    """

    ball_bgr: np.ndarray
    surround_bgr: np.ndarray
    direction: np.ndarray
    separation: float
    table: np.ndarray
    fill: float
    learned: bool
    smeared: bool = False

    @property
    def signed(self) -> bool:
        """Whether ball and plate differ enough (`separation` over SIGNED_ABOVE) for the edge to
        have a sign."""
        return self.separation > SIGNED_ABOVE

    @staticmethod
    def of_colour(colour: str) -> Appearance:
        """The appearance assumed of a name in `NAMED` or "#rrggbb"; the first lock refines it.

        `ValueError`: any other name.
        """
        bgr = parse_colour(colour)
        # A mid grey stands in for a plate that has not been seen yet.
        surround = np.full(3, 128.0)
        contrast = bgr - surround
        direction = contrast / max(float(contrast @ contrast), 1.0)
        # Half of a usual scene is mid grey: a table of that colour cannot tell a steel ball.
        fill = 0.0 if _chroma(bgr) < 30 and 70 < bgr.mean() < 200 else 0.6
        return Appearance(bgr, surround, direction, 0.0, _named_table(bgr), fill, learned=False)

    @staticmethod
    def learn(image: np.ndarray, u_px: float, v_px: float, radius_px: float) -> Appearance:
        """The appearance, with its table of colours, of the disc at (u_px, v_px) of radius
        `radius_px` in an image (h, w, 3) uint8 BGR."""
        table = _learned_table(image, u_px, v_px, radius_px)
        fill = mean_probability(image, table, u_px, v_px, 0.0, 0.85 * radius_px)
        return replace(
            Appearance.sketch(image, u_px, v_px, radius_px),
            table=table,
            fill=fill,
            smeared=colour_is_smeared(image, u_px, v_px, radius_px),
        )

    @staticmethod
    def sketch(image: np.ndarray, u_px: float, v_px: float, radius_px: float) -> Appearance:
        """The appearance of the disc at (u_px, v_px) without its table (all zero): cheap, for
        guesses that are not confirmed yet. Image (h, w, 3) uint8 BGR."""
        return Appearance(*_contrast(image, u_px, v_px, radius_px), _EMPTY, 0.0, learned=True)

    def adapted(
        self,
        image: np.ndarray,
        u_px: float,
        v_px: float,
        radius_px: float,
        share: float,
    ) -> Appearance:
        """A copy moved by `share` (0..1) towards the disc's present colours; disc and image as in
        `learn`."""
        ball, surround, direction, separation = _contrast(image, u_px, v_px, radius_px)
        return replace(
            self,
            ball_bgr=self.ball_bgr + share * (ball - self.ball_bgr),
            surround_bgr=self.surround_bgr + share * (surround - self.surround_bgr),
            direction=self.direction + share * (direction - self.direction),
            separation=self.separation + share * (separation - self.separation),
            table=adapted_table(self.table, image, u_px, v_px, radius_px, share),
        )

    def here(
        self, image: np.ndarray, u_px: float, v_px: float, radius_px: float, *, fine: bool = False
    ) -> tuple[np.ndarray, float, float]:
        """(direction (3,), separation, contrast) measured at the disc (u_px, v_px, radius_px).

        The contrast is ball minus surround along the appearance's own direction: 1 where both have
        the learned colours, negative where dark and bright are exchanged. A `fine` direction is the
        one in which a known edge lies best: where colour is `smeared`, it leans on brightness.
        """
        smear = SMEAR * math.sqrt(radius_px) if fine and self.smeared else 0.0
        ball, ring, direction, separation = _contrast(image, u_px, v_px, radius_px, smear)
        return direction, separation, float(self.direction @ (ball - ring))


_EMPTY = np.zeros(BINS**3, np.uint8)


def parse_colour(colour: str) -> np.ndarray:
    """Colour (3,) BGR, 0..255, of a name in `NAMED` or of "#rrggbb". `ValueError`: any other
    text."""
    text = NAMED.get(colour.strip().lower(), colour.strip())
    if not re.fullmatch(r"#[0-9a-fA-F]{6}", text):
        names = ", ".join(NAMED)
        raise ValueError(f"ball colour {colour!r} is not known; use #rrggbb or one of {names}")
    r, g, b = (int(text[i : i + 2], 16) for i in (1, 3, 5))
    return np.array([b, g, r], float)


def _contrast(
    image: np.ndarray, u: float, v: float, radius: float, smear: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """(ball (3,), surround (3,), direction (3,), separation) of a disc, see `pixels.fisher`."""
    reach = 0.8 * radius, 1.25 * radius, 1.7 * radius + 2.0
    return fisher(image, u, v, *reach, NOISE_FLOOR, smear)


def _grid_bgr() -> np.ndarray:
    """(32768, 3) BGR at the middle of each bin, in the table's order."""
    level = (np.arange(BINS) + 0.5) * 256 / BINS
    return np.stack(np.meshgrid(level, level, level, indexing="ij"), -1).reshape(-1, 3)


def _named_table(bgr: np.ndarray) -> np.ndarray:
    """P(ball | colour) of an assumed colour: by hue where it has one, else by brightness.

    Shading keeps hue and saturation and changes brightness, so the tolerance in brightness is wide
    for a coloured ball; a colourless one has little but its brightness.
    """
    grid = _grid_bgr()
    top, chroma = grid.max(1), _chroma(grid)
    saturation = chroma / top
    want_top = max(float(bgr.max()), 1.0)
    want_saturation = float(_chroma(bgr)) / want_top
    if want_saturation > 0.25:
        turn = np.abs(_hue(grid) - _hue(bgr[None])) % 360
        turn = np.minimum(turn, 360 - turn)
        score = np.exp(-0.5 * (turn / 16.0) ** 2)
        score *= np.clip((saturation - 0.3 * want_saturation) / (0.6 * want_saturation), 0, 1)
        score *= np.clip((top - 0.12 * want_top) / (0.12 * want_top), 0, 1)
    else:
        # Colourless: in the dark saturation is noise, so chroma is what is judged. A mid grey ball
        # is of polished metal and shows every brightness.
        spread = 38.0 if bgr.mean() < 70 or bgr.mean() > 200 else 75.0
        score = np.exp(-0.5 * (chroma / 22.0) ** 2)
        score *= np.exp(-0.5 * ((grid.mean(1) - bgr.mean()) / spread) ** 2)
    return np.round(255 * score).astype(np.uint8)


def _chroma(bgr: np.ndarray) -> np.ndarray:
    """Largest minus smallest channel of colours (..., 3)."""
    return bgr.max(-1) - bgr.min(-1)


def _hue(bgr: np.ndarray) -> np.ndarray:
    """Hue in degrees (n,) of colours (n, 3): the angle in the opponent plane."""
    b, g, r = bgr[:, 0], bgr[:, 1], bgr[:, 2]
    return np.degrees(np.arctan2(np.sqrt(3.0) * (g - b), 2.0 * r - g - b)) % 360


def _histogram(colours: np.ndarray) -> np.ndarray:
    """Smoothed density (32, 32, 32) of colours (n, 3), sum 1."""
    bins = np.clip(colours, 0, 255).astype(np.int64) >> 3
    index = bins[:, 0] << 10 | bins[:, 1] << 5 | bins[:, 2]
    counts = np.bincount(index, minlength=BINS**3).astype(np.float32).reshape((BINS,) * 3)
    for axis in range(3):
        counts = np.moveaxis(counts, axis, 0)
        flat = np.ascontiguousarray(counts.reshape(BINS, -1))
        flat = cv2.GaussianBlur(flat, (1, 7), sigmaX=1.2, sigmaY=1.2, borderType=cv2.BORDER_REFLECT)
        counts = np.moveaxis(flat.reshape(counts.shape), 0, axis)
    return counts / max(float(counts.sum()), 1e-9)


def _learned_table(image: np.ndarray, u: float, v: float, radius: float) -> np.ndarray:
    """P(ball | colour) from the disc's colours against those of the rest of the image.

    The disc's colours count at eight brightnesses, since the ball rolls through light and shade.
    """
    reach = 2.5 * radius + 4
    x0, y0 = max(0, int(u - reach)), max(0, int(v - reach))
    window = image[y0 : max(0, int(v + reach) + 2), x0 : max(0, int(u + reach) + 2)]
    near = _distances(window, u - x0, v - y0)
    disc = window[near < max(0.85 * radius, 1.5)].astype(float)
    ring = window[(near > 1.25 * radius + 1) & (near < reach)]
    step = max(1, round(math.sqrt(image.shape[0] * image.shape[1] / 40000)))
    sparse = image[::step, ::step]
    rest = sparse[step * _distances(sparse, u / step, v / step) > 1.25 * radius + 1]
    shaded = np.concatenate([disc * gain for gain in (0.6, 0.75, 0.88, 1.0, 1.0, 1.0, 1.12, 1.25)])
    ball = _histogram(shaded)
    plate = 0.5 * _histogram(rest.astype(float)) + 0.5 * _histogram(ring.astype(float))
    # The floor keeps colours that neither has shown from counting as the ball's.
    floor = 0.002 * float(ball.max())
    return np.round(255 * ball / (ball + plate + floor)).astype(np.uint8).reshape(-1)


def _distances(image: np.ndarray, u: float, v: float) -> np.ndarray:
    """Distances (h, w) px of the pixels of an image (h, w, 3) from the place (u, v)."""
    return np.hypot(np.arange(image.shape[1]) - u, np.arange(image.shape[0])[:, None] - v)
