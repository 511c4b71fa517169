"""The real table's camera on the page: through the eye of a run, or an idle eye between runs.

A camera serves one program at a time: a run or a calibration borrows it here, and the idle eye
opens it again when it is given back.
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from experiments.dashboard.session.virtual_camera import sight_words
from experiments.runs.live_eye import open_ball, watching
from rig.hardware.camera.eye import CameraEye
from rig.parameters import Rig

RETRY_S = 5.0  # wait after a camera could not be opened; chosen
OPENING_S = 20.0  # longest wait for the idle eye to let go of the camera; chosen


class RealCamera:
    """The real table's camera for the page, with the methods of `VirtualCamera`; `lend` frees it
    for a run or a calibration.

    rig: names the camera and its calibration. A thread of its own holds the camera between runs, so
    that neither page nor loop waits for it.
    """

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._wake = threading.Condition()
        self._wanted = self._closed = self._holds_camera = False
        self._borrowers = 0
        self._idle_eye: CameraEye | None = None
        self._run_eye: CameraEye | None = None
        self._error = ""
        self._thread = threading.Thread(target=self._serve, daemon=True, name="real camera")
        self._thread.start()

    def request(
        self, theta_rad: np.ndarray | None, ball_m: np.ndarray | None = None, t_s: float = 0.0
    ) -> None:
        """Note that somebody looks: the camera is opened where it is free. The pose is not used."""
        with self._wake:
            self._wanted = True
            self._wake.notify_all()

    def newest(self) -> tuple[np.ndarray, str] | None:
        """The image (240, 320, 3) uint8 RGB with words on it, where one came since the last call,
        else None.

        OSError: why the camera cannot be looked through.
        """
        with self._wake:
            if self._error:
                why, self._error = self._error, ""
                raise OSError(why)
            eye = self._run_eye or self._idle_eye
            preview = eye.preview.look() if eye is not None else None
        if preview is None:
            return None
        image, track, seen = preview
        return image, sight_words(track, seen)

    def release(self) -> None:
        """Close the camera that is held between runs, as nobody looks."""
        with self._wake:
            self._wanted = False
            self._wake.notify_all()

    def close(self) -> None:
        """End the thread and close the camera that it holds."""
        with self._wake:
            self._closed = True
            self._wake.notify_all()
        self._thread.join(5.0)

    def check_free(self) -> None:
        """Raise ValueError where a run or a calibration has the camera."""
        if self._borrowers:
            raise ValueError("a run or a calibration has the camera: wait until it has ended")

    @contextmanager
    def lend(self) -> Iterator[Callable[[CameraEye | None], None]]:
        """Free the camera for as long as the context lasts.

        Yields a function that takes the borrower's eye (or None), which the page then looks
        through. ValueError: the camera is lent already. OSError: it is still being opened.
        """

        def show_through(eye: CameraEye | None) -> None:
            with self._wake:
                self._run_eye = eye

        with self._wake:
            self.check_free()
            self._borrowers += 1
            self._wake.notify_all()
            free = self._wake.wait_for(lambda: not self._holds_camera, OPENING_S)
        try:
            if not free:
                raise OSError("the camera is still being opened to look through: try again")
            yield show_through
        finally:
            with self._wake:
                self._borrowers, self._run_eye = self._borrowers - 1, None
                self._wake.notify_all()

    # --- the thread that holds the camera between runs ---
    def _may_hold(self) -> bool:
        return self._wanted and not self._borrowers and not self._closed

    def _serve(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._may_hold() or self._closed)
                if self._closed:
                    return
                self._holds_camera = True
            try:
                self._watch()
                why = ""
            except (OSError, ValueError) as error:
                why = str(error)
            with self._wake:
                self._holds_camera, self._error = False, why
                self._wake.notify_all()
                if why:
                    self._wake.wait_for(lambda: self._closed, RETRY_S)

    def _watch(self) -> None:
        """Hold the camera until nobody looks or somebody needs it. OSError, ValueError: why not."""
        with watching(self._rig, open_ball) as eye, self._wake:
            self._idle_eye = eye
            try:
                while self._may_hold():
                    self._wake.wait(0.1)
                    eye.latest(-np.inf)  # raises what ended the camera
            finally:
                self._idle_eye = None
