"""The virtual camera on the page: the measured pose, rendered and tracked in another process.

It shows what a camera above the table would see; the loop's own observations do not come from it.
Only the newest pose is rendered, and nothing waits for it.
"""

import multiprocessing
from contextlib import suppress
from math import sqrt
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from experiments.dashboard.session.worker_process import stand_back
from rig.loop.child_process import start
from rig.parameters import Rig

IMAGE_SIZE_PX = (320, 240)  # width and height on the page; chosen: as wide as its panel


class VirtualCameraRenderer:
    """Renders poses as the virtual camera sees them, and tracks the ball in the rendered images."""

    def __init__(self, rig: Rig) -> None:
        from experiments.runs.assemble import MAX_TILT_RAD, virtual_renderer
        from vision.ball_camera import BallCamera
        from vision.detection.appearance import Appearance

        self._renderer = virtual_renderer(rig, np.random.default_rng(1))
        view = self._renderer.view
        self.size = view.camera.width_px, view.camera.height_px
        self._ratio, self._count = rig.linkage.ratio, 0
        self._camera = BallCamera.over_plate(
            view,
            self._renderer.scene.layout,
            rig.ball.radius_m,
            rig.linkage.side_m,
            MAX_TILT_RAD,
            appearance=Appearance.of_colour(rig.ball.colour),
        )

    def look(
        self, theta_rad: np.ndarray, ball_m: np.ndarray | None, t_s: float
    ) -> tuple[np.ndarray, str]:
        """Render a pose; returns the image (h, w, 3) uint8 BGR with the tracker's ellipse drawn in,
        and the same in words.

        theta_rad (2,): servo angles; ball_m (2,): the ball in the plate's frame, None or NaN
        without it; t_s: time of the pose, which must grow from call to call.
        """
        from rig.plant.ball import plate_rotation, tilt_sines
        from vision.frames import Frame
        from vision.overlay import draw_track

        ball = None
        if ball_m is not None and np.all(np.isfinite(ball_m)):
            ball = float(ball_m[0]), float(ball_m[1])
        turn = plate_rotation(tilt_sines((float(theta_rad[0]), float(theta_rad[1])), self._ratio))
        image = self._renderer.render(turn, ball)
        seen, track, _ = self._camera.step(Frame(image, t_s, self._count), turn)
        self._count += 1
        return draw_track(image, track, ()), sight_words(track, seen)


def _serve_images(rig: Rig, pipe: Connection) -> None:
    """The camera's process: pose in, image and words out, until the other end is closed."""
    import cv2

    stand_back()
    cv2.setNumThreads(1)
    renderer = VirtualCameraRenderer(rig)
    with suppress(EOFError, OSError):
        while True:
            image, words = renderer.look(*pipe.recv())
            small = cv2.resize(image, IMAGE_SIZE_PX, interpolation=cv2.INTER_AREA)
            pipe.send((np.ascontiguousarray(small[:, :, ::-1]), words))


STATE_WORDS = {
    "search": "The ball is searched",
    "track": "Ball followed",
    "coast": "Ball hidden for a moment: predicted",
    "lost": "The ball is lost",
}


def sight_words(track: Any, seen: Any) -> str:
    """One line: whether the ball is followed, where it is and how sure; what of the image it is
    from. Of the same frame as the picture it is shown with.

    track: `vision` track of a frame; seen: its observation, or None.
    """
    words = STATE_WORDS.get(track.state, str(track.state))
    if seen is not None:
        xx, _, yy = (1e6 * v for v in seen.cov_m2)
        x, y = (100 * v for v in seen.xy_m)
        words += f" at x {x:+.2f}, y {y:+.2f} cm (± {sqrt(0.5 * (xx + yy)):.2f} mm)"
    if np.isfinite(track.u_px):
        words += f"; its outline: radius {track.radius_px:.1f} px (± {track.sigma_px:.3f} px)"
    return words


class VirtualCamera:
    """Images of the virtual camera from a process that starts with the first `request`; `newest`
    picks them up.
    """

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._pipe: Connection | None = None
        self._process: Any = None
        self._busy = False

    def request(self, theta_rad: np.ndarray | None, ball_m: np.ndarray | None, t_s: float) -> None:
        """Ask for an image of a pose, without waiting; dropped while the last one is still being
        made.

        theta_rad (2,): servo angles, None: unknown yet, no image; ball_m (2,): the ball in the
        plate's frame, None: no ball; t_s: the pose's time.
        """
        if theta_rad is None:
            return
        if self._pipe is None:
            context = multiprocessing.get_context("spawn")
            self._pipe, there = context.Pipe()
            self._process = context.Process(
                target=_serve_images, args=(self._rig, there), daemon=True, name="virtual camera"
            )
            start(self._process)
            there.close()
        if self._busy:
            return
        with suppress(OSError):
            self._pipe.send((theta_rad, ball_m, t_s))
            self._busy = True

    def newest(self) -> tuple[np.ndarray, str] | None:
        """The image (240, 320, 3) uint8 RGB with words on it, where one came since the last call,
        else None.
        """
        if self._pipe is None:
            return None
        with suppress(EOFError, OSError):
            if self._pipe.poll():
                answer = self._pipe.recv()
                self._busy = False
                return answer
        return None

    def release(self) -> None:
        """End the process, as nobody looks; the next `request` starts it again."""
        if self._pipe is None:
            return
        self._pipe.close()
        self._process.terminate()
        self._process.join(2.0)
        self._pipe, self._process, self._busy = None, None, False

    close = release
