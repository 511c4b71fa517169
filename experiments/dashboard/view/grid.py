"""A grid of centimetres on the plate, with numbers at two of its edges."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from viser import ClientHandle, ViserServer

FINE_M, COARSE_M = 0.01, 0.05
FINE, COARSE = (206, 211, 219), (150, 158, 170)
HEIGHT_M = 0.0003  # above the plate, below trail and target
BESIDE_M = 0.012  # of the numbers, off the edge
BELOW_M = 0.06  # of words below them; chosen: clear of them on a phone
LETTERS = 0.85  # of all labels in the 3-D view, as viser scales them: about 9 points


def grid_lines(side_m: float, step_m: float) -> np.ndarray:
    """Lines (n, 2, 3) [m] at all whole multiples of step_m on a plate of this side, both ways."""
    half = side_m / 2
    count = int(half / step_m)
    lines = []
    for k in range(-count, count + 1):
        at = k * step_m
        lines.append([[at, -half, HEIGHT_M], [at, half, HEIGHT_M]])
        lines.append([[-half, at, HEIGHT_M], [half, at, HEIGHT_M]])
    return np.array(lines, np.float32)


def grid_numbers(side_m: float) -> list[tuple[str, tuple[float, float, float]]]:
    """Numbers [cm] and their places [m]: x along the near edge, y along the left one,
    away from the play gauges' labels."""
    half = side_m / 2
    count = int(half / COARSE_M)
    found = []
    for k in range(-count, count + 1):
        at, text = k * COARSE_M, f"{100 * k * COARSE_M:.0f}"
        found.append((text, (at, -half - BESIDE_M, 0.0)))
        found.append((text, (-half - BESIDE_M, at, 0.0)))
    return found


def axis_letters(side_m: float) -> list[tuple[str, tuple[float, float, float]]]:
    """Names of the axes and their places [m]: where the numbers of the grid end."""
    off, end = -side_m / 2 - BESIDE_M, side_m / 2 + 0.03
    return [("x", (end, off, 0.0)), ("y", (off, end, 0.0))]


def below_numbers(side_m: float) -> tuple[float, float, float]:
    """Where words end at the top [m] that hide none of the numbers, however small the table is."""
    return 0.0, -side_m / 2 - BELOW_M, 0.0


def draw_grid(server: "ViserServer | ClientHandle", plate: str, side_m: float) -> None:
    """Draw grid and numbers under the scene's node `plate`, so that they tilt with it."""
    scene = server.scene
    for name, step_m, colour, thickness in (
        ("fine", FINE_M, FINE, 0.0004),
        ("coarse", COARSE_M, COARSE, 0.0008),
    ):
        lines = grid_lines(side_m, step_m)
        scene.add_line_segments(f"{plate}/grid_{name}", lines, colour, thickness=thickness)
    for i, (text, place) in enumerate(grid_numbers(side_m)):
        scene.add_label(
            f"{plate}/grid_number_{i}",
            text,
            position=place,
            anchor="center-center",
            font_screen_scale=LETTERS,
        )
