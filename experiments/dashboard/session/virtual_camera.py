"""The virtual camera looked through: frames of the measured pose, rendered and tracked elsewhere.

It shows what a camera above the table would see; the loop's own observations do not come from it.
A process of its own renders and tracks the newest pose only, so that nothing waits for it.
"""

import multiprocessing
import os
from contextlib import suppress
from math import sqrt
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from rig.parameters import Rig

SMALL = (320, 240)


class Looker:
    """Renders poses as the virtual camera sees them, and tracks the ball in what it rendered."""

    def __init__(self, rig: Rig) -> None:
        from experiments.assemble import virtual_scene
        from vision.appearance import Appearance
        from vision.ball_camera import BallCamera
        from vision.synthetic import Renderer, virtual_view

        scene, view = virtual_scene(rig), virtual_view()
        self.size = view.camera.width_px, view.camera.height_px
        self._ratio, self._count = rig.linkage.ratio, 0
        self._renderer = Renderer(scene, view, np.random.default_rng(1))
        self._camera = BallCamera.over_plate(
            view, scene.layout, rig.ball.radius_m, rig.linkage.plate_side_m,
            appearance=Appearance.of_colour(rig.ball.colour),
        )  # fmt: skip

    def look(
        self, theta: tuple[float, float], ball: tuple[float, float] | None, t_s: float
    ) -> tuple[np.ndarray, str]:
        """The image (h, w, 3) BGR with what the tracker saw drawn in, and the same in words."""
        from rig.linkage import plate_rotation, tilt_sines
        from vision.frames import Frame
        from vision.overlay import draw

        turn = plate_rotation(tilt_sines(theta, self._ratio))
        image = self._renderer.render(turn, ball)
        seen, track, _ = self._camera.step(Frame(image, t_s, self._count), turn)
        self._count += 1
        return draw(image, track, ()), sight_words(track, seen)


def _see(rig: Rig, here: Connection) -> None:
    """The eye's process: pose in, image and words out, until the other end is closed."""
    import cv2

    with suppress(OSError, AttributeError):
        os.nice(5)
    cv2.setNumThreads(1)
    looker = Looker(rig)
    with suppress(EOFError, OSError, KeyboardInterrupt):
        while True:
            image, words = looker.look(*here.recv())
            small = cv2.resize(image, SMALL, interpolation=cv2.INTER_AREA)
            here.send((np.ascontiguousarray(small[:, :, ::-1]), words))


def sight_words(track: Any, seen: Any) -> str:
    """State, ellipse and covariance of a frame."""
    words = f"tracker: **{track.state}**"
    if np.isfinite(track.u_px):
        words += (
            f", ellipse at ({track.u_px:.1f}, {track.v_px:.1f}) px, radius {track.radius_px:.1f}, "
            f"± {track.sigma_px:.3f} px"
        )
    if seen is not None:
        xx, xy, yy = (1e6 * v for v in seen.cov_m2)
        x, y = (100 * v for v in seen.xy_m)
        words += (
            f"  \nball at ({x:+.2f}, {y:+.2f}) cm, std {sqrt(xx):.3f}, {sqrt(yy):.3f} mm, "
            f"cov {xy:+.4f} mm²"
        )
    return words


class VirtualEye:
    """`look` at a pose (dropped while the last one is still being seen); `newest` what was seen."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._pipe: Connection | None = None
        self._process: Any = None
        self._busy = False

    def look(self, theta_rad: np.ndarray | None, ball_m: np.ndarray | None, t_s: float) -> None:
        if theta_rad is None:
            return
        if self._pipe is None:
            context = multiprocessing.get_context("spawn")
            self._pipe, there = context.Pipe()
            self._process = context.Process(
                target=_see, args=(self._rig, there), daemon=True, name="virtual eye"
            )
            self._process.start()
            there.close()
        if self._busy:
            return
        ball = None
        if ball_m is not None and np.all(np.isfinite(ball_m)):
            ball = float(ball_m[0]), float(ball_m[1])
        theta = float(theta_rad[0]), float(theta_rad[1])
        with suppress(OSError):
            self._pipe.send((theta, ball, t_s))
            self._busy = True

    def newest(self) -> tuple[np.ndarray, str] | None:
        """The image (240, 320, 3) RGB and words of what was seen since the last call."""
        if self._pipe is None:
            return None
        with suppress(EOFError, OSError):
            if self._pipe.poll():
                found = self._pipe.recv()
                self._busy = False
                return found
        return None

    def rest(self) -> None:
        """End the process."""
        if self._pipe is None:
            return
        self._pipe.close()
        self._process.terminate()
        self._process.join(2.0)
        self._pipe, self._process, self._busy = None, None, False

    close = rest
