"""What a hardware table sees with: the rig file's camera in a process of its own, by one recipe."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

from rig.hardware.camera.eye import STALL_S, CameraEye, Sees, Watcher
from rig.parameters import Rig

if TYPE_CHECKING:
    from calibration.bundle import Bundle
    from vision.sources.sources import Source

Recipe = Callable[[Rig], "tuple[Source, Sees]"]
OTHER_BALL = 0.02  # chosen: a ball of 20 mm is seen 0.1 mm elsewhere in a corner of the plate


@contextmanager
def watching(rig: Rig, recipe: Recipe, *, stall_s: float = STALL_S) -> Iterator[CameraEye]:
    """Open the eye of `rig.table.camera` by a recipe, and wait for its first frame.

    recipe: called with the rig in the camera's process, returns the source of frames and what is
    seen in them; stall_s: longest time [s] without a frame. CameraStopped (an OSError): no first
    frame.
    """
    eye = CameraEye(rig.linkage.ratio, stall_s=stall_s)
    try:
        with Watcher(eye, partial(recipe, rig)):
            yield eye
    finally:
        eye.close()


def open_ball(rig: Rig) -> tuple[Source, Sees]:
    """Open the camera on the monotonic clock, with the calibrated ball detector (a `Recipe`), which
    dates what it sees by `Bundle.stamped_late_s`.

    Runs in the process that evaluates the frames. ValueError (also BundleError), OSError: the
    camera or its calibration cannot be used, or the frames have another size than the
    calibration's.
    """
    from experiments.runs.assemble import ball_camera

    source, bundle = _open(rig)
    _warm_up(rig, bundle)
    return source, ball_camera(rig, bundle, bundle.stamped_late_s)


def _warm_up(rig: Rig, bundle: Bundle) -> None:
    """See a drawn ball come, roll and go: whatever is compiled is loaded before a loop waits."""
    from dataclasses import replace

    import numpy as np

    from experiments.runs.assemble import ball_camera, virtual_scene
    from vision.frames import Frame
    from vision.synthetic.synthetic import Renderer

    orange = replace(rig, ball=replace(rig.ball, colour="orange"))
    scene = replace(virtual_scene(rig), layout=bundle.layout, ball_radius_m=bundle.ball_radius_m)
    renderer = Renderer(scene, bundle.view, np.random.default_rng(0))
    camera, level = ball_camera(orange, bundle), np.eye(3)
    rolling = [None, *((0.01 * k, 0.0) for k in range(6)), None]
    for k, ball in enumerate(rolling):
        camera.step(Frame(renderer.render(level, ball), k / 30, k), level)


def open_markers(rig: Rig) -> tuple[Source, Sees]:
    """Open the camera, with what measures the plate's tilt from its markers (a `Recipe`).

    Runs in the process that evaluates the frames. ValueError (also BundleError), OSError: the
    camera or its calibration cannot be used, or the frames have another size than the
    calibration's.
    """
    from rig.hardware.camera.plate_tilt import MarkerTilt

    source, bundle = _open(rig)
    return source, MarkerTilt(bundle.view, bundle.layout)


def real_calibration(rig: Rig) -> Bundle:
    """The calibration of a real table's camera. ValueError (also BundleError), OSError: it cannot
    be used, is the virtual camera's, or of another ball than the rig file's.
    """
    from calibration.bundle import BundleError, load

    bundle = load(rig.table.calibration)
    if bundle.source == "simulated":
        raise BundleError(
            f"{rig.table.calibration} is of the virtual camera, not of yours: run rig calibrate "
            "camera and table on frames of your camera"
        )
    seen_m, known_m = bundle.ball_radius_m, rig.ball.radius_m
    if abs(seen_m - known_m) > OTHER_BALL * known_m:
        raise BundleError(
            f"{rig.table.calibration} is of a ball of {1e3 * seen_m:.1f} mm radius, the rig file "
            f"says ball.radius_m = {known_m:g}: correct it, or calibrate the table with this ball"
        )
    return bundle


def _open(rig: Rig) -> tuple[Source, Bundle]:
    from vision.sources.sources import open_source

    bundle = real_calibration(rig)
    source = open_source(rig.table.camera, start_s=0.0)
    try:
        bundle.check_size(*source.size)
    except BaseException:
        source.__exit__(None, None, None)
        raise
    return source, bundle
