"""A camera that watches the plate of a simulated table: rendered frames, no ball, stamped late."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rig.linkage import plate_rotation
from vision.frames import Frame, Observation
from vision.synthetic import Renderer


@dataclass
class PlateEye:
    """Renders every frame without a ball and hands it to `keep`, stamped `late_s` after its light,
    as a driver stamps what has arrived; an `Eye` of `SimulatedTable` that never sees a ball."""

    renderer: Renderer
    late_s: float
    keep: Callable[[Frame], object]
    frames: int = 0

    def see(
        self,
        exposed_s: float,
        ball_xy_m: tuple[float, float] | None,
        tilt_sines_true: tuple[float, float],
        velocity_m_s: tuple[float, float],
        theta_rad: tuple[float, float],
    ) -> Observation | None:
        image: np.ndarray = self.renderer.render(plate_rotation(tilt_sines_true), None)
        self.keep(Frame(image, exposed_s + self.late_s, self.frames))
        self.frames += 1
        return None
