"""A calibration bundle that is right to the last digit: the virtual camera's own numbers, called
measured."""

from datetime import UTC, datetime

import numpy as np

from calibration.bundle import Bundle, markers_record
from calibration.records import LensRecord, PlateRecord, TimingRecord, Value
from vision.synthetic.synthetic import Scene
from vision.view import View


def exact_bundle(view: View, scene: Scene, **timing_s: float) -> Bundle:
    """The bundle of `view` and `scene`; timing_s: numbers of its section `timing`, if any."""
    camera = view.camera
    lens = LensRecord(
        matrix=camera.matrix.tolist(),
        distortion=camera.distortion.tolist(),
        width_px=camera.width_px,
        height_px=camera.height_px,
        std={},
        rms_px=0.0,
        views=0,
        coverage=0.0,
        plate_std_mm=0.0,
        half_set_mm=0.0,
        flags=[],
    )
    plate = PlateRecord(
        camera_from_plate=view.camera_from_plate.tolist(),
        covariance=(1e-12 * np.eye(6)).tolist(),
        residual_mm=0.0,
        scatter_mm=0.0,
        frames=1,
        side_m=scene.plate_side_m,
    )
    timing = None
    if timing_s:
        values = {key: Value.around(value, 0.0005) for key, value in timing_s.items()}
        play = {"x": 0.0, "y": 0.0}
        timing = TimingRecord(play_rad=play, frames=100, source="markers", **values)
    return Bundle(
        made=datetime(2026, 1, 1, tzinfo=UTC),
        source="measured",
        lens=lens,
        plate=plate,
        markers=markers_record(scene.layout),
        ball_radius_m=scene.ball_radius_m,
        timing=timing,
    )
