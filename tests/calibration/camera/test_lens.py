"""The lens comes back from rendered pictures, and doubtful pictures are refused."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from calibration.camera.lens import calibrate_camera, calibrate_images, coverage
from calibration.camera.lens_fit import PARAMETERS
from calibration.camera.plate_uncertainty import disagreement_mm, shift_mm, std_mm
from calibration.camera.sheet import CalibrationError, Sheet, SheetView, find_sheet
from calibration.camera.virtual import sheet_poses
from vision.synthetic.synthetic import Renderer, Scene, virtual_camera, virtual_view

SHEET, SIZE = Sheet(), (640, 480)
FIELD = (640 / 1086, 480 / 1084)


def sheet_views(count=20, seed=2, noise_px=0.04, keep=None, bow=None, flat=False):
    """What a perfect finder would see: exact projections plus noise.

    `bow` lifts the sheet's points, `flat` holds it parallel to the sensor, `keep` hides pixels.
    """
    rng = np.random.default_rng(seed)
    points = np.asarray(SHEET.board.getChessboardCorners(), float).reshape(-1, 3)
    bent = points.copy()
    if bow is not None:
        bent[:, 2] += bow(points)
    views = []
    for index, pose in enumerate(sheet_poses(SHEET, FIELD, 0.75, count, rng)):
        turn = np.eye(3) if flat else pose[:3, :3]
        seen = bent @ turn.T + pose[:3, 3]
        uv = virtual_camera().pixel_from_ray(seen[:, :2] / seen[:, 2:])
        uv += rng.normal(0, noise_px, uv.shape)
        inside = np.all((uv > 3) & (uv < np.array(SIZE) - 4), axis=1)
        if keep is not None:
            inside &= keep(uv)
        if inside.sum() >= 12:
            views.append(SheetView(index, points[inside].astype("f4"), uv[inside].astype("f4")))
    return views


@cache
def pictures():
    renderer = Renderer(Scene(), virtual_view(), np.random.default_rng(0))
    poses = sheet_poses(SHEET, FIELD, 0.75, 20, np.random.default_rng(5))
    return poses, [renderer.render_sheet(SHEET.image(), SHEET.size_m, pose) for pose in poses]


def scores(calibration, camera):
    truth = [*camera.pinhole, *camera.lens]
    found = [*calibration.camera.pinhole, *calibration.camera.lens]
    std = [calibration.std[name] for name in PARAMETERS]
    return np.array([(f - t) / s for f, t, s in zip(found, truth, std, strict=True) if s > 0])


def test_found_corners_lie_where_they_were_drawn():
    poses, images = pictures()
    views = find_sheet(images, SHEET)
    assert len(views) >= 18
    errors = []
    for view in views:
        pose = poses[view.index]
        seen = view.points_m @ pose[:3, :3].T + pose[:3, 3]
        errors.append(view.corners_px - virtual_camera().pixel_from_ray(seen[:, :2] / seen[:, 2:]))
    errors = np.concatenate(errors)
    assert np.abs(errors.mean(axis=0)).max() < 0.01
    assert np.sqrt(np.mean(errors**2)) < 0.1


def test_lens_comes_back_from_pictures_within_its_stated_uncertainty():
    calibration = calibrate_images(pictures()[1], SHEET)
    z = scores(calibration, virtual_camera())
    assert len(z) == 8
    assert np.sqrt(np.mean(z**2)) < 2.2
    assert np.abs(z).max() < 4
    assert calibration.std["fx"] < 1.0
    assert calibration.rms_px < 0.12
    assert calibration.half_set_mm < 0.1
    assert calibration.plate_std_mm < 0.03
    assert not calibration.warnings
    assert disagreement_mm(calibration.camera, virtual_camera(), 0.75) < 0.06


def test_stated_uncertainty_is_the_true_spread():
    sets = [calibrate_camera(sheet_views(16, seed, 0.1), SIZE) for seed in range(16)]
    z = np.array([scores(c, virtual_camera()) for c in sets])
    assert np.all(np.sqrt(np.mean(z**2, axis=0)) < 1.6)
    assert 0.75 < np.sqrt(np.mean(z**2)) < 1.25
    real = [np.linalg.norm(shift_mm(c.camera, virtual_camera(), 0.75), axis=1) for c in sets]
    stated = np.mean([c.plate_std_mm for c in sets])
    assert 0.6 < np.sqrt(np.mean(np.square(real), axis=0)).max() / stated < 1.5


def test_uncertainty_on_the_plate_grows_with_the_lens_covariance():
    covariance = np.diag([1.0, 1.0, 0, 0, 0, 0, 0, 0, 0])
    one = std_mm(virtual_camera(), covariance, 0.75)
    assert np.allclose(std_mm(virtual_camera(), 4 * covariance, 0.75), 2 * one, rtol=0.02)
    assert np.all(shift_mm(virtual_camera(), virtual_camera(), 0.75) < 1e-6)


def with_view(views, index, **changes):
    return [*views[:index], replace(views[index], **changes), *views[index + 1 :]]


def test_refuses_too_few_views():
    with pytest.raises(CalibrationError, match="found in 9 pictures, 15 are needed"):
        calibrate_camera(sheet_views(9), SIZE)
    blank = [np.full((480, 640), 200, np.uint8)] * 20
    with pytest.raises(CalibrationError, match="found in 0 pictures"):
        calibrate_images(blank, SHEET)


def test_refuses_a_half_covered_image():
    views = sheet_views(30, keep=lambda uv: uv[:, 0] < 380)
    assert coverage(views, SIZE) < 0.8
    with pytest.raises(CalibrationError, match="covered 67% of a 6x4 grid"):
        calibrate_camera(views, SIZE)


def test_refuses_flat_views():
    with pytest.raises(CalibrationError, match="tilt"):
        calibrate_camera(sheet_views(24, flat=True), SIZE)


def test_refuses_a_bad_fit_and_names_the_picture():
    rng = np.random.default_rng(0)
    views = sheet_views(20)
    blurred = views[7].corners_px + rng.normal(0, 0.6, views[7].corners_px.shape).astype("f4")
    with pytest.raises(CalibrationError, match=f"picture {views[7].index} fits with 0.[5-9]"):
        calibrate_camera(with_view(views, 7, corners_px=blurred), SIZE)
    with pytest.raises(CalibrationError, match="reprojection rms"):
        calibrate_camera(sheet_views(20, noise_px=0.8), SIZE)


def test_half_sets_see_a_bent_sheet_that_a_small_rms_hides():
    def bent(bow_m):
        return sheet_views(bow=lambda p: bow_m * (2 * p[:, 0] / SHEET.size_m[0] - 1) ** 2)

    slightly = calibrate_camera(bent(0.0004), SIZE)
    assert slightly.rms_px < 0.1
    assert "two half sets disagree" in slightly.warnings[0]
    with pytest.raises(CalibrationError, match=r"half sets of the pictures disagree by 0\.6"):
        calibrate_camera(bent(0.001), SIZE)


def test_refuses_mixed_sizes_and_wrapped_opencv_errors():
    with pytest.raises(CalibrationError, match="one size"):
        calibrate_images([np.zeros((480, 640), np.uint8), np.zeros((240, 320), np.uint8)], SHEET)
    with pytest.raises(CalibrationError, match="no pictures"):
        calibrate_images([], SHEET)


def test_sheet_fits_on_a4_and_its_print_matches_its_size():
    width, height = SHEET.size_m
    assert max(width, height) < 0.297
    assert min(width, height) < 0.210
    image = SHEET.image(20)
    assert image.shape == (160, 220)
    edges = np.flatnonzero(np.abs(np.diff(image[2].astype(int))) > 100)
    assert np.all((edges + 1) % 20 == 0)
    assert cv2.countNonZero(image) > 0
