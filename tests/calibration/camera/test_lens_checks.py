"""Planted faults are refused or warned about by name; good sets pass without a word."""

import pytest

from calibration.camera.lens import calibrate_camera, calibrate_images
from calibration.camera.plate import level_pose
from calibration.camera.sheet import CalibrationError, Sheet
from tests.support.planted_pictures import (
    FAULTS,
    SIZE,
    good_set,
    pictures,
    seen_views,
    sheet_on_plate,
    verdict,
)
from vision.plate.markers import default_layout
from vision.synthetic.synthetic import virtual_camera


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.title)
def test_a_planted_fault_is_called_by_its_name(fault):
    outcome, said = verdict(fault, 1)
    assert outcome != "passed"
    assert fault.name in said
    assert "\n" not in said


@pytest.mark.parametrize("seed", range(20))
def test_a_good_set_passes_without_a_warning(seed):
    found = good_set(seed)
    assert not found.warnings
    assert found.half_set_mm < 0.2


def test_a_sheet_of_the_right_size_on_the_plate_passes():
    pose = level_pose(sheet_on_plate(3), virtual_camera(), default_layout(0.275), sheet=Sheet())
    assert pose.sheet_scale == pytest.approx(1, abs=0.003)
    assert pose.residual_mm < 0.1


def test_a_right_size_is_said_to_be_checked_where_it_was():
    plate = default_layout(0.275)
    held = calibrate_images(pictures(4), Sheet(), layout=plate)
    lying = calibrate_images([*pictures(4), sheet_on_plate(4)[0]], Sheet(), layout=plate)
    assert (held.scale_checked, lying.scale_checked) == (False, True)


def test_a_sheet_told_too_large_would_lie_below_the_plate():
    told = Sheet(square_m=0.027, marker_m=0.02025)
    with pytest.raises(CalibrationError, match=r"wrong square size: .* below the plate"):
        calibrate_images(pictures(4), told, layout=default_layout(0.275))


def test_all_faults_of_the_list_are_planted():
    names = {fault.name for fault in FAULTS}
    assert len(names) == 12


def test_a_lens_does_not_depend_on_the_squares_size():
    """Why a wrong size is looked for on the plate: the pictures of the sheet cannot show it."""
    views = seen_views(virtual_camera(), 4)
    told = calibrate_camera(views, SIZE)
    for view in views:
        view.points_m[:] *= 1.04
    larger = calibrate_camera(views, SIZE)
    assert larger.camera.matrix == pytest.approx(told.camera.matrix, abs=0.02)


def test_one_false_corner_is_left_out_and_said():
    views = seen_views(virtual_camera(), 5)
    views[3].corners_px[7] += 9.0
    found = calibrate_camera(views, SIZE)
    assert "false corners" in found.warnings[0]
    assert f"picture {views[3].index}" in found.warnings[0]
    assert found.rms_px < 0.1


def test_no_pictures_at_all():
    with pytest.raises(CalibrationError, match="too few views"):
        calibrate_camera([], (640, 480))
