"""The simulated table seen through rendered frames and the real vision chain."""

from dataclasses import dataclass, field

import numpy as np

from rig.linkage import plate_rotation, tilt_sines
from vision.ball_camera import BallCamera
from vision.frames import Frame, Observation, Track
from vision.synthetic import Renderer


@dataclass
class RenderedEye:
    """Renders what the light shows, then sees it as a real camera would: only pixels pass between.

    `hint` of the plate's pose comes from the encoders. `pairs` keeps (exposed_s, true x, y,
    measured x, y) for the fit of a statistical camera and for tests: no controller reads it.
    """

    renderer: Renderer
    ball_camera: BallCamera
    ratio: float
    exposure_s: float = 0.004
    frames: int = 0
    pairs: list[tuple[float, ...]] = field(default_factory=list)
    image: np.ndarray | None = None
    track: Track | None = None

    def see(
        self,
        exposed_s: float,
        ball_xy_m: tuple[float, float] | None,
        tilt_sines_true: tuple[float, float],
        velocity_m_s: tuple[float, float],
        theta_rad: tuple[float, float],
    ) -> Observation | None:
        self.image = self.renderer.render(
            plate_rotation(tilt_sines_true),
            ball_xy_m,
            velocity_m_s=velocity_m_s,
            exposure_s=self.exposure_s,
        )
        hint = plate_rotation(tilt_sines(theta_rad, self.ratio))
        frame = Frame(self.image, exposed_s, self.frames)
        observation, self.track, _ = self.ball_camera.step(frame, hint)
        self.frames += 1
        if ball_xy_m is not None:
            seen = observation.xy_m if observation else (np.nan, np.nan)
            self.pairs.append((exposed_s, *ball_xy_m, *seen))
        return observation
