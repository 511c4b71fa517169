"""How long a camera takes to expose one row after the other, from a plate that wiggles.

A rolling shutter exposes row v of h at t + r(v), r(v) = ((v + 1/2)/h - 1/2) T, T the readout time
and t the exposure of the middle row. A plate that moves with the rate w (rotation and translation
along the camera's axes) is then seen sheared: beside the pose of the frame, whose Jacobian at an
edge i of the print is J_i, the edge lies off by

    e_i = J_i m + J_i w r(v_i) + noise.

The pose fit takes up m and what of the second term looks like a motion; T is least squares on the
rest over all frames. w is the difference quotient of the poses before and after, so T needs no
encoder, and no calibrated lens beyond what the pose needs: what is fixed in the picture does not
change its sign with the plate's.
"""

import cv2
import numpy as np

from calibration.records import Value
from calibration.statistics import jackknife_std, student_quantile
from vision.plate.markers import MarkerLayout, residual_edges
from vision.view import View

MIN_FRAMES = 30
LONGEST_S = 0.1  # chosen: no sensor takes longer for a picture
_GROUPS = 10
_APART_S = 0.2  # chosen: over a longer gap between two frames no rate is taken


class ReadoutRecorder:
    """Collects what the frames of a moving plate say of the readout; `layout`: of its markers."""

    def __init__(self, layout: MarkerLayout) -> None:
        self._layout = layout
        self._before: list[tuple[float, View, np.ndarray]] = []
        self._sums: list[tuple[float, float]] = []

    def add(self, t_s: float, view: View | None, image: np.ndarray) -> None:
        """Take a frame (h, w, 3) of time `t_s` in which the plate was seen as `view`, None where it
        was not; frames come in order of time."""
        if view is None:
            self._before = []
            return
        if len(self._before) == 2:
            (first_s, first, _), (_, middle, picture) = self._before
            if 0 < t_s - first_s < _APART_S:
                rate = _rate(first, view, t_s - first_s)
                self._sums.append(_sums(picture, self._layout, middle, rate))
        self._before = [*self._before[-1:], (t_s, view, image)]

    def readout_s(self) -> Value | None:
        """The readout time [s] with its 95 % interval (jackknife over tenths of the frames); None
        where under 30 frames tell it, or nothing below 0.1 s."""
        sums = np.array(self._sums).reshape(-1, 2)
        if len(sums) < MIN_FRAMES or not sums[:, 1].sum() > 0:
            return None
        groups = np.arange(len(sums)) * _GROUPS // len(sums)
        parts = np.array([sums[groups == k].sum(axis=0) for k in range(_GROUPS)])
        whole = parts.sum(axis=0)
        without = whole - parts
        if not np.all(without[:, 1] > 0):
            return None
        spread = float(jackknife_std(without[:, :1] / without[:, 1:])[0])
        found = float(whole[0] / whole[1])
        if abs(found) > LONGEST_S:
            return None
        return Value.around(found, student_quantile(_GROUPS - 1) * spread)


def _rate(before: View, after: View, seconds: float) -> np.ndarray:
    """Rotation and translation (6,) [rad/s, m/s] along the camera's axes between two poses."""
    a, b = before.camera_from_plate, after.camera_from_plate
    turn = np.asarray(cv2.Rodrigues(b[:3, :3] @ a[:3, :3].T)[0]).ravel()
    return np.concatenate((turn, b[:3, 3] - a[:3, 3])) / seconds


def _sums(
    image: np.ndarray, layout: MarkerLayout, view: View, rate: np.ndarray
) -> tuple[float, float]:
    """sum w q e and sum w q^2 over a frame's edges: e what the pose leaves of them, q what it
    leaves of their motion a second of readout."""
    offset, weight, jacobian, rows = residual_edges(image, layout, view)
    moves = (jacobian @ rate) * ((rows + 0.5) / view.camera.height_px - 0.5)
    root = np.sqrt(weight)
    both = root[:, None] * np.column_stack((offset, moves))
    j = root[:, None] * jacobian
    left = both - j @ np.linalg.lstsq(j, both)[0]
    return float(left[:, 0] @ left[:, 1]), float(left[:, 1] @ left[:, 1])
