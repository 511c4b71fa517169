"""The benchmark's hard cases in short, and the fitted rim in bad light and JPEG."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.benchmarks.vision.cases import followed
from tests.benchmarks.vision.scenes import SHADED, Studio
from tests.benchmarks.vision.scripts import cases
from vision.detection.appearance import Appearance
from vision.detection.detector import locate_ball
from vision.detection.rim import colour_is_smeared

CASES = [
    "a disc of its colour on the plate",
    "a hand over the ball",
    "corrupt frames",
    "half outside the image",
    "duplicated frames",
    "set down elsewhere, colour named",
]


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_hard_case_passes_no_wrong_position(name):
    figure = followed(name, cases()[name](48))
    assert figure.wrong == 0
    assert figure.first >= 0
    assert figure.found >= 0.8 * figure.shown


def errors_and_sigmas(look, count=8):
    """Errors (n, 2) px of the ball located from a rough guess, and the sigmas (n,) claimed."""
    studio, rng = Studio(look), np.random.default_rng(3)
    errors, sigmas, appearance = [], [], None
    for _ in range(count):
        shot = studio.shot(rng.uniform(-0.08, 0.08, 2))
        appearance = appearance or Appearance.learn(
            shot.image, shot.u_px, shot.v_px, shot.radius_px
        )
        found = locate_ball(shot.image, appearance, shot.u_px + 2.0, shot.v_px - 1.5, 30.0)
        assert found is not None
        errors.append((found.u_px - shot.u_px, found.v_px - shot.v_px))
        sigmas.append(found.sigma_px)
    return np.array(errors), np.array(sigmas)


@pytest.mark.parametrize(
    ("look", "limit_px"), [(SHADED, 0.02), (replace(SHADED, jpeg=85), 0.04)], ids=["raw", "jpeg"]
)
def test_light_from_a_side_hardly_moves_the_ball(look, limit_px):
    errors, sigmas = errors_and_sigmas(look)
    assert np.sqrt(np.mean(errors**2)) < limit_px
    assert 0.4 < np.sqrt(np.mean((errors / sigmas[:, None]) ** 2)) < 1.8


def test_coarsely_stored_colour_is_noticed():
    studio = Studio(SHADED)
    shot = studio.shot((0.02, 0.01))
    place = shot.u_px, shot.v_px, shot.radius_px
    assert not colour_is_smeared(shot.image, *place)
    code = cv2.imencode(".jpg", shot.image, [cv2.IMWRITE_JPEG_QUALITY, 85])[1]
    assert colour_is_smeared(np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR)), *place)
