"""The plate's tilt as its markers show it, picture by picture: what homing believes."""

from threading import Lock, Thread

from vision.frame_source import Source
from vision.markers import MarkerLayout, find_pose, track_pose
from vision.source_errors import SourceError
from vision.view import View


class MarkerTilt:
    """Looks in its own thread; called in every tick: the plate's sines of a new picture, or None.

    `level` is the calibrated view of the level plate. A camera that fails ends the looking.
    """

    def __init__(self, source: Source, level: View, layout: MarkerLayout) -> None:
        self._source, self._level, self._layout = source, level, layout
        self._newest: tuple[float, float] | None = None
        self._lock, self._over = Lock(), False
        self.seen = 0
        self._thread = Thread(target=self._work, daemon=True, name="plate tilt")
        self._thread.start()

    def __call__(self, t_s: float) -> tuple[float, float] | None:
        with self._lock:
            newest, self._newest = self._newest, None
        return newest

    def end(self) -> None:
        """Stop looking; the source may be closed afterwards."""
        self._over = True
        self._thread.join(2.0)

    def _work(self) -> None:
        last, misses = self._level, 0
        try:
            for frame in self._source:
                if self._over:
                    return
                fit = track_pose(frame.image, self._layout, last)
                if not fit.accepted and misses % 5 == 0:
                    fit = find_pose(frame.image, self._layout, self._level.camera) or fit
                misses = 0 if fit.accepted else misses + 1
                if fit.accepted:
                    last = fit.view
                    with self._lock:
                        self._newest = sines(fit.view, self._level)
                    self.seen += 1
        except SourceError:
            return


def sines(view: View, level: View) -> tuple[float, float]:
    """How far the +x and +y sides are down: the third row of world_from_plate, negated."""
    turn = level.camera_from_plate[:3, :3].T @ view.camera_from_plate[:3, :3]
    return float(-turn[2, 0]), float(-turn[2, 1])
