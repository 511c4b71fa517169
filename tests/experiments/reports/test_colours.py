"""With is red, without is blue, what is wanted is green: everywhere, and for the colour-blind."""

import re

import numpy as np
import pytest
from matplotlib import colormaps

from experiments.dashboard.view.scene import ARMS
from experiments.reports.figures import CENTRE, HELPS_HURTS, WITH, WITHOUT, colour_of
from tests.support import ROOT

# Machado, Oliveira, Fernandes 2009: full dichromacy, on linear RGB.
BLIND = {
    "none": np.eye(3),
    "protanopia": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "deuteranopia": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    "tritanopia": [[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]],
}
XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
APART = 30.0  # CIELAB; chosen: ten times what is just noticed side by side


def rgb(colour: str) -> np.ndarray:
    return np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])


def lab(colour: str, matrix) -> np.ndarray:
    """CIELAB of a colour as somebody sees it whose cones `matrix` describes."""
    value = rgb(colour) / 255
    linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.asarray(matrix) @ linear, 0.0, 1.0)
    x, y, z = np.cbrt(XYZ @ seen / np.array([0.9505, 1.0, 1.089]))
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize("kind", BLIND)
def test_the_three_colours_are_told_apart(kind: str):
    seen = [lab(colour, BLIND[kind]) for colour in (WITH, WITHOUT, CENTRE)]
    for i, one in enumerate(seen):
        for other in seen[:i]:
            assert np.linalg.norm(one - other) > APART


def test_a_colour_means_one_thing_in_figures_and_on_the_plate():
    assert (colour_of("with"), colour_of("without")) == (WITH, WITHOUT)
    assert {arm: tuple(rgb(colour_of(arm))) for arm in ARMS} == ARMS


# The page's filter in the dark, as https://www.w3.org/TR/filter-effects-1 has it: light and dark
# change places, and hues turn by half a circle.
TURN = np.array([[-0.574, 1.430, 0.144], [0.426, 0.430, 0.144], [0.426, 1.430, -0.856]])


def in_the_dark(colour: np.ndarray, share: float) -> np.ndarray:
    return np.clip(TURN @ (share * (1.0 - colour) + (1.0 - share) * colour), 0.0, 1.0)


def luminance(colour: np.ndarray) -> float:
    light = np.where(colour <= 0.03928, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
    return float(light @ [0.2126, 0.7152, 0.0722])


@pytest.mark.parametrize(
    "file", ["reports/templates/style.css", "dashboard/server/shell.css"], ids=lambda name: name
)
def test_letters_on_every_cell_of_a_map_are_read_in_the_light_and_in_the_dark(file: str):
    """Half of the cells had a contrast of 2.5 to 4.5 in the dark."""
    told = re.findall(
        r"invert\(([\d.]+)\) hue-rotate\(180deg\)", (ROOT / "experiments" / file).read_text()
    )
    assert told
    black = np.zeros(3)
    for part in np.linspace(0.0, 1.0, 101):
        cell = np.array(colormaps.get_cmap(HELPS_HURTS)(part)[:3])
        assert luminance(cell) + 0.05 > 4.5 * 0.05
        for share in map(float, told):
            letters = luminance(in_the_dark(black, share)) + 0.05
            assert letters > 4.5 * (luminance(in_the_dark(cell, share)) + 0.05)
