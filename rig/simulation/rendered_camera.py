"""The simulated table seen through rendered frames and the real vision chain."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from rig.plant.ball import plate_rotation, tilt_sines
from vision.ball_camera import BallCamera
from vision.frames import Frame, Observation, Track
from vision.synthetic.synthetic import Renderer


@dataclass
class RenderedCamera:
    """A camera of the simulated table that renders frames and runs the real vision chain on them.

    Nothing but pixels and the encoders' angles passes from the simulation to the vision chain.
    ratio: 2 R_d/L of the linkage; exposure_s: length of the exposure. frames: rendered so far;
    image, track: the newest frame (h, w) uint8 and what the tracker made of it. pairs: (exposed_s,
    true x, y, measured x, y) of every frame with a ball, NaN where it was not seen, for the fit of
    a statistical camera and for tests: no controller reads it.
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
        """Render the exposure at `exposed_s` and return what the vision chain measures, or None.

        ball_xy_m: true position in the plate's frame [m], None without a ball; tilt_sines_true:
        (sin phi_x, sin phi_y); velocity_m_s: of the ball, for motion blur; theta_rad: encoder
        angles, the hint of the plate's pose.
        """
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


@dataclass
class RenderedPlateCamera:
    """A camera of the simulated table that renders frames without a ball and hands them to `keep`.

    Each frame is stamped `late_s` after its light, as a driver stamps what has arrived. It never
    sees a ball.
    """

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
        """Render the empty plate at `exposed_s` and hand the frame to `keep`; returns None.

        tilt_sines_true: (sin phi_x, sin phi_y). ball_xy_m, velocity_m_s and theta_rad are not used.
        """
        image: np.ndarray = self.renderer.render(plate_rotation(tilt_sines_true), None)
        self.keep(Frame(image, exposed_s + self.late_s, self.frames))
        self.frames += 1
        return None
