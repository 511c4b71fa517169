"""What a hardware table sees with: a live source and the calibrated ball camera, by one recipe."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rig.hardware.eye import CameraEye, Opener, Watcher
from rig.parameters import Rig

if TYPE_CHECKING:
    from vision.ball_camera import BallCamera
    from vision.frame_source import Source


def open_camera(address: str, bundle_path: Path, rig: Rig) -> tuple[Source, BallCamera]:
    """Frames of `address` on the monotonic clock, and the ball camera of the bundle.

    Raises what `vision.sources.open_source` and `calibration.bundle.load` raise.
    """
    from calibration.bundle import load
    from vision.appearance import Appearance
    from vision.ball_camera import BallCamera
    from vision.sources import open_source

    bundle = load(bundle_path)
    camera = BallCamera.over_plate(
        bundle.view,
        bundle.layout,
        bundle.ball_radius_m,
        rig.linkage.plate_side_m,
        appearance=Appearance.of_colour(rig.ball.colour),
    )
    return open_source(address, start_s=0.0), camera


def opener(address: str, bundle_path: Path, rig: Rig) -> Opener:
    """The recipe as it travels to the process that sees."""
    return partial(open_camera, address, bundle_path, rig)


def watching(rig: Rig, address: str, bundle_path: Path) -> Watcher:
    """`with watching(...) as seen:` the camera is on; give `seen.eye` to the table and the job,
    and close it after the run."""
    return Watcher(CameraEye(rig.linkage.ratio), opener(address, bundle_path, rig))
