"""The real table's camera on the page: through a run's own eye, or one of its own between runs.

A camera serves one program at a time: whoever needs it (a run, a calibration) borrows it here, and
looking on begins again when it is given back.
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from experiments.dashboard.virtual_eye import sight_words
from experiments.live_eye import open_ball, watching
from rig.hardware.eye import CameraEye
from rig.parameters import Rig

AGAIN_S = 5.0  # after a camera that could not be opened
PATIENCE_S = 20.0


class RealCamera:
    """The interface of `VirtualEye`: `look`, `newest`, `rest`; and `lent` to who needs the camera.

    A thread holds the eye between runs, so that neither page nor loop waits for a camera.
    """

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._wake = threading.Condition()
        self._wanted = self._closed = self._holds = False
        self._lent = 0
        self._own: CameraEye | None = None
        self._runs: CameraEye | None = None
        self._why = ""
        self._thread = threading.Thread(target=self._serve, daemon=True, name="real camera")
        self._thread.start()

    def look(
        self, theta_rad: np.ndarray | None, ball_m: np.ndarray | None = None, t_s: float = 0.0
    ) -> None:
        """Somebody wants to see; the angles help an eye that is not a run's own."""
        with self._wake:
            self._wanted = True
            self._wake.notify_all()

    def newest(self) -> tuple[np.ndarray, str] | None:
        """The image (240, 320, 3) RGB and what is said of it, since the last call.

        OSError: the camera cannot be looked through, why.
        """
        with self._wake:
            if self._why:
                why, self._why = self._why, ""
                raise OSError(why)
            eye = self._runs or self._own
            found = eye.peephole.look() if eye is not None else None
        if found is None:
            return None
        image, track, seen = found
        return image, sight_words(track, seen)

    def rest(self) -> None:
        """Nobody looks: between runs the camera is let go of."""
        with self._wake:
            self._wanted = False
            self._wake.notify_all()

    def close(self) -> None:
        with self._wake:
            self._closed = True
            self._wake.notify_all()
        self._thread.join(5.0)

    def check_free(self) -> None:
        """ValueError: a run or a calibration has the camera."""
        if self._lent:
            raise ValueError("a run or a calibration has the camera: wait until it has ended")

    @contextmanager
    def lent(self) -> Iterator[Callable[[CameraEye | None], None]]:
        """The camera is free while inside; what is yielded takes the eye that now looks.

        ValueError: somebody has it already. OSError: it is still being opened by this page.
        """

        def shown(eye: CameraEye | None) -> None:
            with self._wake:
                self._runs = eye

        with self._wake:
            self.check_free()
            self._lent += 1
            self._wake.notify_all()
            free = self._wake.wait_for(lambda: not self._holds, PATIENCE_S)
        try:
            if not free:
                raise OSError("the camera is still being opened to look through: try again")
            yield shown
        finally:
            with self._wake:
                self._lent, self._runs = self._lent - 1, None
                self._wake.notify_all()

    # --- the thread that holds the camera between runs ---
    def _ours(self) -> bool:
        return self._wanted and not self._lent and not self._closed

    def _serve(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._ours() or self._closed)
                if self._closed:
                    return
                self._holds = True
            try:
                self._watch()
                why = ""
            except (OSError, ValueError) as error:
                why = str(error)
            with self._wake:
                self._holds, self._why = False, why
                self._wake.notify_all()
                if why:
                    self._wake.wait_for(lambda: self._closed, AGAIN_S)

    def _watch(self) -> None:
        """Hold the camera until nobody looks or somebody needs it. OSError, ValueError: why not."""
        with watching(self._rig, open_ball) as eye, self._wake:
            self._own = eye
            try:
                while self._ours():
                    self._wake.wait(0.1)
                    eye.latest(-np.inf)  # raises what ended the camera
            finally:
                self._own = None
