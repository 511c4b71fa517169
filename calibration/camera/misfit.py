"""Tests the residuals of a lens fit for a sheet that is not flat and a lens of another kind.

Parameters that the model lacks are added for one linear step, each view's pose projected out: a
sheet bent to z = a x^2 + b x y + c y^2, and a lens with radial powers r^6, r^8 and a tilted sensor.
If the residuals are noise, the drop of the sum of squares over the noise's variance is chi-squared
with k = 3 or 4 degrees of freedom; its z score by Wilson and Hilferty (Proc. Nat. Acad. Sci. 17,
1931), which unlike the exact tail does not underflow for gross faults.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from vision.view import Camera

_BENT, _LENS = 3, 4
_EPS = 1e-5


@dataclass(frozen=True)
class Misfit:
    """What a lens fit leaves unexplained.

    `bent_mm`: peak-to-peak height of the sheet over its best plane; `lens_px`: rms over the seen
    corners of what a richer lens would change; `bent_z`, `lens_z`: z scores of both, from the
    module's test (`lens_checks.CLEAR_Z` is the limit).
    """

    bent_mm: float
    bent_z: float
    lens_px: float
    lens_z: float


Posed = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # points, pixels, turn, shift


def misfit(views: Sequence[Posed], camera: Camera, free: np.ndarray) -> Misfit:
    """Test a fit's residuals for a bent sheet and a richer lens (the module's chi-squared test).

    `views`: per view the points (n, 3) [m], pixels (n, 2), rotation vector and translation [m];
    `camera`: the fitted camera; `free` (9,): which of its nine parameters were fitted.
    """
    scale = np.ptp(np.concatenate([points[:, :2] for points, *_ in views]), axis=0).max() / 2
    middle = np.mean(np.concatenate([points[:, :2] for points, *_ in views]), axis=0)
    lens = int(free.sum())
    size = lens + _BENT + _LENS
    normal, right, total = np.zeros((size, size)), np.zeros(size), 0.0
    rows, columns = 0, []
    for points, pixels, turn, shift in views:
        residual, pose, own, extra = _columns(
            points, pixels, turn, shift, camera, scale, middle, free
        )
        wide = np.hstack((own, extra))
        q, _ = np.linalg.qr(pose)
        wide, left = wide - q @ (q.T @ wide), residual - q @ (q.T @ residual)
        normal, right, total = normal + wide.T @ wide, right + wide.T @ left, total + left @ left
        rows += len(residual) - 6
        columns.append(wide)
    bent = np.arange(lens, lens + _BENT)
    richer = np.arange(lens + _BENT, size)
    base = np.arange(lens)
    start = float(total) - _explained(normal, right, base)
    bend, bend_z = _added(normal, right, base, bent, start, rows)
    more, more_z = _added(normal, right, base, richer, start, rows)
    shape = _rise(views, bend[lens:], scale, middle)
    kept = np.concatenate((base, richer))
    change = np.concatenate([wide[:, kept] @ more for wide in columns])
    change -= (
        np.concatenate([wide[:, base] for wide in columns])
        @ np.linalg.lstsq(normal[np.ix_(base, base)], right[base])[0]
    )
    return Misfit(
        1e3 * shape,
        bend_z,
        float(np.sqrt(np.mean(change**2) * 2)),
        more_z,
    )


def _explained(normal: np.ndarray, right: np.ndarray, used: np.ndarray) -> float:
    return float(right[used] @ np.linalg.lstsq(normal[np.ix_(used, used)], right[used])[0])


def _added(normal, right, base, more, start: float, rows: int) -> tuple[np.ndarray, float]:
    """Solution with `more` columns too, and the z score of what they explain beyond `base`."""
    used = np.concatenate((base, more))
    scale = np.sqrt(np.diag(normal)[used])
    small = normal[np.ix_(used, used)] / np.outer(scale, scale)
    found = np.linalg.lstsq(small, right[used] / scale, rcond=1e-12)[0] / scale
    gain = float(right[used] @ found) - _explained(normal, right, base)
    left = max(start - gain, 1e-12) / max(rows - len(used), 1)
    chi2 = max(gain, 0.0) / left
    k = len(more)
    return found, float(((chi2 / k) ** (1 / 3) - (1 - 2 / (9 * k))) / np.sqrt(2 / (9 * k)))


def _columns(points, pixels, turn, shift, camera: Camera, scale, middle, free):
    """Residual (2n,) and its columns: pose (2n, 6), lens, bend and richer lens (2n, 7)."""
    points = np.asarray(points, float)
    seen, jacobian = cv2.projectPoints(points, turn, shift, camera.matrix, camera.distortion)
    jacobian = np.asarray(jacobian).reshape(-1, 15)
    residual = (np.asarray(pixels, float) - np.asarray(seen).reshape(-1, 2)).ravel()
    xy = (points[:, :2] - middle) / scale
    lifted = points + np.array((0.0, 0.0, _EPS))
    higher, _ = cv2.projectPoints(lifted, turn, shift, camera.matrix, camera.distortion)
    by_z = (np.asarray(higher) - np.asarray(seen)).reshape(-1, 2) / _EPS
    powers = (xy[:, 0] ** 2, xy[:, 0] * xy[:, 1], xy[:, 1] ** 2)
    bend = [(power[:, None] * by_z).ravel() for power in powers]
    rotation = np.asarray(cv2.Rodrigues(np.asarray(turn))[0])
    place = points @ rotation.T + np.asarray(shift).reshape(3)
    x, y = (place[:, :2] / place[:, 2:]).T
    r2 = x * x + y * y
    fx, fy, _, _ = camera.pinhole
    richer = [np.column_stack((fx * x * power, fy * y * power)).ravel() for power in (r2**3, r2**4)]
    zero = np.zeros_like(r2)
    richer += [np.column_stack(pair).ravel() for pair in ((fx * r2 * r2, zero), (zero, fy * r2**2))]
    extra = np.column_stack([*bend, *richer])
    return residual, jacobian[:, :6], jacobian[:, 6:][:, free], extra


def _rise(views, bend: np.ndarray, scale: float, middle: np.ndarray) -> float:
    """Peak to peak height in m of the bent sheet over its best plane."""
    xy = np.unique(np.concatenate([points[:, :2] for points, *_ in views]), axis=0)
    x, y = ((xy - middle) / scale).T
    z = bend[0] * x * x + bend[1] * x * y + bend[2] * y * y
    plane = np.column_stack((np.ones_like(x), x, y))
    return float(np.ptp(z - plane @ np.linalg.lstsq(plane, z)[0]))
