"""Is the ball where the films of the third world say it is? MuJoCo's own segmentation is asked.

It colours every pixel by the thing that it shows, after MuJoCo's camera, not by `ball_in`.
"""

import importlib
import math
from typing import Any

import numpy as np
import pytest

from tests.support.parts import need
from tests.support.third_world.plan import draw
from tests.support.third_world.scene import model_text, pictures

need("mujoco", "EGL")
Studio: Any = importlib.import_module("tests.support.third_world.film").Studio
mujoco: Any = importlib.import_module("mujoco")

EVERY, ASKED = 10, 4  # frames from one that is asked to the next, and how many are
# Of a side of the box about whole pixels, and so of its middle.
GRAIN_PX = 0.5
# Of the radius of a disc of n whole pixels, chosen: some twice what a circle of 5 px sways by.
RADIUS_PX = 0.25


@pytest.mark.parametrize("seed", [0, 8, 9, 12, 15])  # plain, transparent, zoom, carried, large
def test_ball_is_where_the_film_says(seed: int):
    plan = draw(seed, quick=True)
    rng = np.random.default_rng(seed)
    model = mujoco.MjModel.from_xml_string(model_text(plan), pictures(plan, rng))
    data, asked = mujoco.MjData(model), 0
    ball = model.geom("ball").id
    corner = 2.0 * math.pi / model.vis.quality.numslices  # the sphere is drawn as a polyhedron
    least = math.sqrt(math.sin(corner) / corner)  # radius of the polygon's area
    with mujoco.Renderer(model, plan.size[1], plan.size[0]) as renderer:
        for k, (_, truth, shown) in enumerate(Studio(plan, model, data, renderer, rng).takes()):
            if asked == ASKED:
                return
            if k % EVERY or shown < 1.0:
                continue
            renderer.enable_segmentation_rendering()
            renderer.update_scene(data, "eye")
            i, j = np.nonzero(renderer.render()[..., 0] == ball)
            renderer.disable_segmentation_rendering()
            middle = 0.5 * (j.min() + j.max()), 0.5 * (i.min() + i.max())
            assert math.dist(middle, truth[:2]) < math.sqrt(2.0) * GRAIN_PX, k
            radius = math.sqrt(len(i) / math.pi)
            assert least * truth[2] - RADIUS_PX < radius < truth[2] + RADIUS_PX, k
            asked += 1
    pytest.fail(f"the ball was wholly seen in {asked} of the frames that were asked")
