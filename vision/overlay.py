"""What did the tracker see? Its state, the ball's outline, uncertainty and trail, drawn in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import cv2
import numpy as np

from vision.frames import Track

COLOURS = {  # BGR
    "search": (255, 160, 0),
    "track": (80, 255, 80),
    "coast": (0, 200, 255),
    "lost": (60, 60, 255),
}
# One sigma of a good fit is far below a pixel: drawn enlarged, and said so in the caption.
SIGMA_ZOOM = 50.0
SHIFT = 4  # sub-pixel bits of OpenCV's drawing functions


def draw_track(
    image: np.ndarray, track: Track, trail: Sequence[tuple[float, float]], *, note: str = ""
) -> np.ndarray:
    """A copy of an image (h, w, 3) uint8 BGR with the track drawn in.

    `trail`: past centres (u, v) [px], NaN where there was none; `note` is added to the caption. The
    circle of sigma is drawn `SIGMA_ZOOM` times enlarged, except in "coast". `KeyError`: a state
    that is none of `Track`'s.
    """
    out = image.copy()
    colour = COLOURS[track.state]
    points = [(u, v) for u, v in trail if math.isfinite(u) and math.isfinite(v)]
    for (u0, v0), (u1, v1) in pairwise(points):
        cv2.line(out, _fixed(u0, v0), _fixed(u1, v1), (255, 255, 0), 1, cv2.LINE_AA, SHIFT)
    caption = f"{track.state} {note}".strip()
    if math.isfinite(track.u_px) and math.isfinite(track.radius_px):
        at, one = _fixed(track.u_px, track.v_px), 1 << SHIFT
        cv2.circle(out, at, round(track.radius_px * one), colour, 2, cv2.LINE_AA, SHIFT)
        spread = min(SIGMA_ZOOM * track.sigma_px, 4.0 * track.radius_px)
        if track.state == "coast":
            spread = min(track.sigma_px, 4.0 * track.radius_px)
        cv2.circle(out, at, round(max(spread, 1.0) * one), (255, 0, 255), 1, cv2.LINE_AA, SHIFT)
        caption += f" ({track.u_px:.1f}, {track.v_px:.1f}) +- {track.sigma_px:.2f} px"
    cv2.rectangle(out, (0, 0), (out.shape[1], 20), (0, 0, 0), -1)
    cv2.putText(out, caption, (6, 15), cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv2.LINE_AA)
    return out


def contact_sheet(images: Sequence[np.ndarray], columns: int) -> np.ndarray:
    """One image of many `images` of one size (h, w, 3) uint8, in rows of `columns`; empty cells are
    black.

    `ValueError`: no images, no columns, or images of different sizes.
    """
    if not images or columns < 1:
        raise ValueError("a contact sheet needs at least one image and one column")
    if len({im.shape for im in images}) > 1:
        raise ValueError("a contact sheet needs images of one size; resize them first")
    rows = math.ceil(len(images) / columns)
    blank = np.zeros_like(images[0])
    cells = [*images, *[blank] * (rows * columns - len(images))]
    return np.vstack([np.hstack(cells[r * columns : (r + 1) * columns]) for r in range(rows)])


MEANINGS = (  # of the colours that `draw_track` uses
    ("search: none yet", COLOURS["search"]),
    ("track: outline of the ball", COLOURS["track"]),
    ("coast: predicted", COLOURS["coast"]),
    ("lost", COLOURS["lost"]),
    ("where it was", (255, 255, 0)),
    (f"{SIGMA_ZOOM:.0f} sigma of its place", (255, 0, 255)),
)


def legend(title: str, width_px: int) -> np.ndarray:
    """A strip (h, width_px, 3) uint8 BGR: the title, and below it what each colour means."""
    font, size, line = cv2.FONT_HERSHEY_SIMPLEX, 0.5, 22
    places, x, y = [], 8, 2
    for words, colour in MEANINGS:
        wide = cv2.getTextSize(words, font, size, 1)[0][0] + 40
        if x > 8 and x + wide > width_px:
            x, y = 8, y + 1
        places.append((words, colour, x, y * line - 6))
        x += wide
    out = np.zeros((y * line + 4, width_px, 3), np.uint8)
    cv2.putText(out, title, (8, line - 6), font, size, (255, 255, 255), 1, cv2.LINE_AA)
    for words, colour, left, base in places:
        cv2.line(out, (left, base - 5), (left + 16, base - 5), colour, 4)
        cv2.putText(out, words, (left + 22, base), font, size, (255, 255, 255), 1, cv2.LINE_AA)
    return out


def _fixed(u: float, v: float) -> tuple[int, int]:
    """Sub-pixel coordinates as OpenCV's drawing functions take them."""
    return round(u * (1 << SHIFT)), round(v * (1 << SHIFT))
