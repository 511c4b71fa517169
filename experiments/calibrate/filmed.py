"""The plate's tilt in frames, of a film or of the virtual camera, by a folder's lens and plate."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from calibration.bundle import load
from calibration.motion.timing import TiltRecorder, Wiggle
from experiments.calibrate.folder import FILE, CalibrationFolder
from experiments.own_camera import opened, with_camera
from experiments.runs.assemble import virtual_renderer
from rig.foreign_trial import Tells
from rig.parameters import Rig
from rig.simulation.rendered_camera import RenderedPlateCamera
from rig.simulation.simulator import SimulatedTable
from vision.sources.sources import recorded


def has_plate(folder: CalibrationFolder) -> bool:
    """Whether lens, plate and markers were measured, so that tilts can be seen."""
    draft = folder.draft
    return None not in (draft.lens, draft.plate, draft.markers)


def tilt_recorder(folder: CalibrationFolder) -> TiltRecorder:
    """A recorder for frames of the folder's camera. ValueError: it has no lens and plate yet."""
    path = folder.path
    if not has_plate(folder):
        lacks, maker = ("lens", "camera") if folder.draft.lens is None else ("plate", "table")
        raise ValueError(f"{path} has no {lacks} yet: run rig calibrate {maker} --out {path} first")
    bundle = load(path / FILE)
    return TiltRecorder(bundle.view, bundle.layout)


def files_of(source: str | None) -> list[Path]:
    """The file or folder that frames come from; none of a camera."""
    path = None if source is None else recorded(source)
    return [path] if path is not None and path.exists() else []


def filmed_motion(
    video: str, folder: CalibrationFolder, t_s: np.ndarray, angle_rad: np.ndarray
) -> Wiggle:
    """The angles (n, 2) of a recorded motion at `t_s` (n,), and the tilts in all frames of its
    video, stamped on the motion's clock. ValueError, OSError: as of `tilt_recorder`, or the video
    cannot be read; UserCameraError: as of `with_camera`."""

    def seen(tells: Tells) -> Wiggle:
        tilt = tilt_recorder(folder)
        with opened(video, tells) as frames:
            for frame in frames:
                tilt.add(frame)
        return tilt.wiggle(t_s, angle_rad)

    return with_camera(video, seen)


@contextmanager
def virtual_film(
    rig: Rig, folder: CalibrationFolder, *, seed: int
) -> Iterator[tuple[SimulatedTable, TiltRecorder]]:
    """The virtual table before the virtual camera, and the tilts in its frames.

    A frame is stamped when it is usable: the rig's delay, and what its effects add, after its
    light. seed: of the noise. ValueError: as of `tilt_recorder`.
    """
    added = rig.effects.get("camera_delay", {}).get("xy", {}).get("extra_s", 0.0)
    made = virtual_renderer(rig, np.random.default_rng([seed, 5]))
    tilt = tilt_recorder(folder)
    eye = RenderedPlateCamera(made, rig.camera.delay_s + added, tilt.add)
    with SimulatedTable(rig, np.random.default_rng([seed, 11]), held=True, eye=eye) as table:
        yield table, tilt
