"""What a hardware table sees with: the rig file's camera in a process of its own, by one recipe."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

from rig.hardware.eye import STALL_S, CameraEye, Sees, Watcher
from rig.parameters import Rig

if TYPE_CHECKING:
    from calibration.bundle import Bundle
    from vision.frame_source import Source

Recipe = Callable[[Rig], "tuple[Source, Sees]"]


@contextmanager
def watching(rig: Rig, recipe: Recipe, *, stall_s: float = STALL_S) -> Iterator[CameraEye]:
    """The eye of `rig.table.camera`, its first frame seen. CameraStopped: there is none."""
    eye = CameraEye(rig.linkage.ratio, stall_s=stall_s)
    try:
        with Watcher(eye, partial(recipe, rig)):
            yield eye
    finally:
        eye.close()


def open_ball(rig: Rig) -> tuple[Source, Sees]:
    """Frames on the monotonic clock, and the calibrated ball camera; in the process that sees."""
    from experiments.assemble import ball_camera

    source, bundle = _open(rig)
    _warm_up(rig, bundle)
    return source, ball_camera(rig, bundle)


def _warm_up(rig: Rig, bundle: Bundle) -> None:
    """See a drawn ball come, roll and go: whatever is compiled is loaded before a loop waits."""
    from dataclasses import replace

    import numpy as np

    from experiments.assemble import ball_camera, virtual_scene
    from vision.frames import Frame
    from vision.synthetic import Renderer

    orange = replace(rig, ball=replace(rig.ball, colour="orange"))
    scene = replace(virtual_scene(rig), layout=bundle.layout, ball_radius_m=bundle.ball_radius_m)
    renderer = Renderer(scene, bundle.view, np.random.default_rng(0))
    camera, level = ball_camera(orange, bundle), np.eye(3)
    rolling = [None, *((0.01 * k, 0.0) for k in range(6)), None]
    for k, ball in enumerate(rolling):
        camera.step(Frame(renderer.render(level, ball), k / 30, k), level)


def open_markers(rig: Rig) -> tuple[Source, Sees]:
    """Frames, and what tells the plate's tilt from its markers; in the process that sees."""
    from rig.hardware.plate_tilt import MarkerTilt

    source, bundle = _open(rig)
    return source, MarkerTilt(bundle.view, bundle.layout)


def _open(rig: Rig) -> tuple[Source, Bundle]:
    from calibration.bundle import load
    from vision.sources import open_source

    bundle = load(rig.table.calibration)
    source = open_source(rig.table.camera, start_s=0.0)
    try:
        bundle.check_size(*source.size)
    except BaseException:
        source.__exit__(None, None, None)
        raise
    return source, bundle
