"""The mountings of the camera trials, by geometry and through frames."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.blind import through_camera
from experiments.blind.through_camera import VARIANTS, camera_log, draw_camera_trials, mounted
from vision.plate.markers import default_layout
from vision.synthetic.synthetic import virtual_view


def test_each_variant_hides_what_it_says():
    trials = draw_camera_trials(5, 2)
    assert [trial.variant for trial in trials] == [*VARIANTS, *VARIANTS]
    for trial in trials:
        hidden = list(trial.hidden)
        expected = {
            "delayed": "camera_delay",
            "turned": "camera_yaw",
            "ball height": "camera_scale",
        }
        assert hidden == ([expected[trial.variant]] if trial.variant in expected else [])
        assert trial.believed["effects"] == {}
    delayed, turned = trials[0], trials[1]
    assert delayed.plant["effects"]["camera_delay"] == delayed.hidden["camera_delay"]
    assert "camera_yaw" not in turned.plant["effects"]
    assert trials[3].hidden["camera_scale"]["xy"]["fraction"] == pytest.approx(0.0269, abs=1e-4)


def test_a_wrongly_mounted_sheet_turns_and_shifts_every_position():
    right, layout = virtual_view(), default_layout(0.275)
    view, moved = mounted(right, layout, 0.05, [0.006, -0.004])
    true = np.array([[0.03, -0.02], [0.0, 0.05]])
    pixels = right.pixel_from_plate(np.column_stack([true, np.full(2, 0.02)]))
    c, s = np.cos(0.05), np.sin(0.05)
    expected = true @ np.array([[c, s], [-s, c]]) + [0.006, -0.004]
    np.testing.assert_allclose(view.plate_from_pixel(pixels, 0.02), expected, atol=1e-9)
    corners = np.column_stack([moved.corners_m.reshape(-1, 2), np.zeros(moved.corners_m.size // 2)])
    where = np.column_stack([layout.corners_m.reshape(-1, 2), np.zeros(len(corners))])
    np.testing.assert_allclose(
        view.pixel_from_plate(corners), right.pixel_from_plate(where), atol=1e-6
    )


@pytest.mark.slow
def test_frames_go_through_the_real_chain(monkeypatch: pytest.MonkeyPatch):
    """A shifted sheet shifts what is measured; only half a second, with a perfect calibration."""
    from types import SimpleNamespace

    layout = default_layout(0.275)
    ideal = SimpleNamespace(view=virtual_view(), layout=layout, ball_radius_m=0.019625)
    monkeypatch.setattr(through_camera, "_bundle", lambda: ideal)
    read = through_camera.read_protocol
    short = lambda name: read(name).model_copy(update={"duration_s": 0.5})  # noqa: E731
    monkeypatch.setattr(through_camera, "read_protocol", short)
    trial = draw_camera_trials(5, 1)[VARIANTS.index("as it should be")]
    shifted = replace(trial, camera=(trial.camera or {}) | {"shift_m": [0.005, 0.0]})
    first = [camera_log(t, "steps", 3).ball()[1][0] for t in (trial, shifted)]
    np.testing.assert_allclose(first[1] - first[0], [0.005, 0.0], atol=3e-4)
