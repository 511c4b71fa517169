"""Where is a pixel on the tilting plate, and where does a ball above the plate appear?

A sphere (centre C = (X, Y, Z) in the camera frame, radius r) is seen inside a cone of rays d with
(d.C)^2 = (|C|^2 - r^2) |d|^2. In normalised coordinates the outline is an ellipse with

    centre  m = (X, Y) Z / (Z^2 - r^2)               not (X, Y) / Z: it lies further out
    axes    a = r sqrt(|C|^2 - r^2) / (Z^2 - r^2)    along (X, Y)
            b = r / sqrt(Z^2 - r^2)                  across

A ball that lies on the plate has n.C = d (n the plate's normal, d = n.t + r, t the plate's origin).
With C = (m g, Z), g = Z - r^2/Z this is one quadratic, s Z^2 - d Z - w r^2 = 0, where
w = n_x m_x + n_y m_y and s = w + n_z; so both directions are closed form.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from math import atan2, hypot, pi, sqrt

import numpy as np

from vision.lens import Coefficients, distort, distort_jacobian, undistort

_CIRCLE = np.linspace(0.0, 2.0 * pi, 16, endpoint=False)


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera with OpenCV's lens; `matrix` (3, 3) [px] without skew, `distortion` (5,) =
    (k1, k2, p1, p2, k3), see `lens`; `width_px`, `height_px`: of its images; `readout_s`: time
    from the first row's exposure to the last's (rolling shutter), whose middle is the frame's.

    `ValueError`: focal lengths that are not positive, or a skew.
    """

    matrix: np.ndarray
    distortion: np.ndarray
    width_px: int
    height_px: int
    readout_s: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrix", np.asarray(self.matrix, float).reshape(3, 3))
        object.__setattr__(self, "distortion", np.asarray(self.distortion, float).reshape(5))
        if not (self.matrix[0, 0] > 0 and self.matrix[1, 1] > 0) or self.matrix[0, 1] != 0:
            raise ValueError("camera matrix: focal lengths must be positive and the skew zero")

    @cached_property
    def pinhole(self) -> tuple[float, float, float, float]:
        """Focal lengths and centre (fx, fy, cx, cy) [px]."""
        m = self.matrix
        return float(m[0, 0]), float(m[1, 1]), float(m[0, 2]), float(m[1, 2])

    @cached_property
    def lens(self) -> Coefficients:
        """Distortion coefficients (k1, k2, p1, p2, k3) as floats."""
        k1, k2, p1, p2, k3 = (float(k) for k in self.distortion)
        return k1, k2, p1, p2, k3

    def row_s(self, v: float) -> float:
        """How much later than its frame's time the row `v` [px] of an image is exposed [s]."""
        return ((v + 0.5) / self.height_px - 0.5) * self.readout_s

    def pixel_from_ray(self, xy: np.ndarray) -> np.ndarray:
        """Raw pixels (n, 2) of normalised ideal coordinates `xy` (n, 2) = (X/Z, Y/Z)."""
        xy = np.asarray(xy, float).reshape(-1, 2)
        x, y = distort(xy[:, 0], xy[:, 1], self.lens)
        fx, fy, cx, cy = self.pinhole
        return np.column_stack((fx * x + cx, fy * y + cy))

    def ray_from_pixel(self, uv: np.ndarray) -> np.ndarray:
        """Normalised ideal (undistorted) coordinates (n, 2) of raw pixels `uv` (n, 2)."""
        uv = np.asarray(uv, float).reshape(-1, 2)
        fx, fy, cx, cy = self.pinhole
        return np.column_stack(undistort((uv[:, 0] - cx) / fx, (uv[:, 1] - cy) / fy, self.lens))


@dataclass(frozen=True, eq=False)
class View:
    """A camera and where the plate is: `camera_from_plate` (4, 4) [m].

    `pose_cov` (6, 6), if known: covariance of a small rotation w [rad] and translation v [m], both
    along the camera's axes: R <- exp([w]x) R, t <- t + v.
    """

    camera: Camera
    camera_from_plate: np.ndarray
    pose_cov: np.ndarray | None = None

    def __post_init__(self) -> None:
        pose = np.asarray(self.camera_from_plate, float).reshape(4, 4)
        object.__setattr__(self, "camera_from_plate", pose)

    def tilted(self, rotation: np.ndarray) -> "View":
        """The view after the plate turned about its centre by `rotation` (3, 3, world_from_plate);
        `pose_cov` is kept."""
        pose = self.camera_from_plate.copy()
        pose[:3, :3] = pose[:3, :3] @ rotation
        return replace(self, camera_from_plate=pose)

    def pixel_from_plate(self, points_m: np.ndarray) -> np.ndarray:
        """Raw pixels (n, 2) of `points_m` (n, 3) in the plate frame, which must lie in front of the
        camera.
        """
        pose = self.camera_from_plate
        points = np.asarray(points_m, float).reshape(-1, 3) @ pose[:3, :3].T + pose[:3, 3]
        return self.camera.pixel_from_ray(points[:, :2] / points[:, 2:])

    def plate_from_pixel(self, uv: np.ndarray, height_m: float = 0.0) -> np.ndarray:
        """Places (n, 2) [m], in the plane `height_m` above the plate's surface, that raw pixels
        `uv` (n, 2) show.

        `ValueError`: a ray does not meet the plane in front of the camera.
        """
        rays = np.column_stack((self.camera.ray_from_pixel(uv), np.ones(np.size(uv) // 2)))
        pose = self.camera_from_plate
        rays_plate = rays @ pose[:3, :3]
        eye = -pose[:3, :3].T @ pose[:3, 3]
        with np.errstate(divide="ignore"):
            reach = (height_m - eye[2]) / rays_plate[:, 2]
        if not np.all((reach > 0) & np.isfinite(reach)):
            raise ValueError("a pixel's ray does not meet the plate's plane: check the plate pose")
        return eye[:2] + reach[:, None] * rays_plate[:, :2]

    @cached_property
    def _plate(self) -> tuple[float, ...]:
        """R by rows, then t, as plain floats: twenty times faster than array entries."""
        pose = self.camera_from_plate
        return (*pose[:3, :3].ravel().tolist(), *pose[:3, 3].tolist())

    def _centre(self, xy_m: tuple[float, float] | np.ndarray, radius_m: float):
        """The ball's centre in the camera frame."""
        r00, r01, r02, r10, r11, r12, r20, r21, r22, tx, ty, tz = self._plate
        x, y = float(xy_m[0]), float(xy_m[1])
        return (
            r00 * x + r01 * y + r02 * radius_m + tx,
            r10 * x + r11 * y + r12 * radius_m + ty,
            r20 * x + r21 * y + r22 * radius_m + tz,
        )

    def outline_from_ball(
        self, xy_m: tuple[float, float] | np.ndarray, radius_m: float, angles: np.ndarray = _CIRCLE
    ) -> np.ndarray:
        """Points (n, 2) on the outline of a ball at `xy_m` on the plate, in raw pixels; `angles`
        (n,) [rad] are those of the ellipse's parametrisation."""
        mx, my, a, b, turn = _ellipse(self._centre(xy_m, radius_m), radius_m)
        p, q = a * np.cos(angles), b * np.sin(angles)
        c, s = np.cos(turn), np.sin(turn)
        return self.camera.pixel_from_ray(np.column_stack((mx + c * p - s * q, my + s * p + c * q)))

    def silhouette_from_ball(
        self, xy_m: tuple[float, float] | np.ndarray, radius_m: float
    ) -> tuple[float, float, float]:
        """Centre (u, v) and mean radius [px] of the outline of a ball at `xy_m` on the plate (the
        module's equations).

        With a distorting lens the outline is no ellipse; the centre is then that of the
        least-squares circle through it, which is what an edge-based detector finds.

        `ValueError`: the ball is not in front of the camera.
        """
        centre = self._centre(xy_m, radius_m)
        if centre[2] <= radius_m:
            raise ValueError("the ball is not in front of the camera: check the plate pose")
        ellipse = _ellipse(centre, radius_m)
        fx, fy, cx, cy = self.camera.pinhole
        mx, my, a, b, _ = ellipse
        if not any(self.camera.lens):
            return fx * mx + cx, fy * my + cy, sqrt(a * b * fx * fy)
        xd, yd = distort(mx, my, self.camera.lens)
        xx, xy, yy = distort_jacobian(mx, my, self.camera.lens)
        du, dv = self._lens_shift(ellipse, xd, yd)
        return fx * xd + cx + du, fy * yd + cy + dv, sqrt(a * b * fx * fy * (xx * yy - xy * xy))

    def _lens_shift(self, ellipse: tuple[float, ...], xd: float, yd: float) -> tuple[float, float]:
        """Centre of the distorted outline minus the distorted centre, px.

        A circle fitted to points c + n(t) R + e(t) moves by 2 mean(n (n.e)).
        """
        mx, my, a, b, turn = ellipse
        fx, fy, _, _ = self.camera.pinhole
        n_x, n_y = np.cos(_CIRCLE + turn), np.sin(_CIRCLE + turn)
        c, s = np.cos(turn), np.sin(turn)
        p, q = a * np.cos(_CIRCLE), b * np.sin(_CIRCLE)
        x, y = distort(mx + c * p - s * q, my + s * p + c * q, self.camera.lens)
        across = n_x * fx * (x - xd) + n_y * fy * (y - yd)
        return 2.0 * float((n_x * across).mean()), 2.0 * float((n_y * across).mean())

    def ball_from_silhouette(
        self, uv: tuple[float, float] | np.ndarray, radius_m: float, sigma_px: float = 0.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Ball centre (2,) [m] in the plate frame and its covariance (2, 2) [m^2] from the
        outline's centre `uv` in raw pixels (the module's quadratic).

        The covariance propagates `sigma_px` (per axis) and, where known, `pose_cov` to first order
        through the closed form.

        `ValueError`: the ray does not meet the plate.
        """
        fx, fy, cx, cy = self.camera.pinhole
        lens = self.camera.lens
        u, v = (float(uv[0]) - cx) / fx, (float(uv[1]) - cy) / fy
        if not any(lens):
            x, y = u, v
        else:
            x, y = undistort(u, v, lens, steps=3)
            du, dv = self._lens_shift(_ellipse(self._on_plate(x, y, radius_m), radius_m), u, v)
            # The shift hardly changes over its own length: one round suffices.
            x, y = undistort(u - du / fx, v - dv / fy, lens, steps=3)
        X, Y, Z = self._on_plate(x, y, radius_m)
        r00, r01, _, r10, r11, _, r20, r21, _, tx, ty, tz = self._plate
        dx, dy, dz = X - tx, Y - ty, Z - tz
        xy = np.array((r00 * dx + r10 * dy + r20 * dz, r01 * dx + r11 * dy + r21 * dz))
        return xy, self._covariance((x, y), (X, Y, Z), radius_m, sigma_px)

    def _on_plate(self, x: float, y: float, radius_m: float) -> tuple[float, float, float]:
        """Ball centre in the camera frame whose outline's centre is (x, y), normalised."""
        _, _, nx, _, _, ny, _, _, nz, tx, ty, tz = self._plate
        w = nx * x + ny * y
        s = w + nz
        d = nx * tx + ny * ty + nz * tz + radius_m
        under = d * d + 4.0 * s * w * radius_m * radius_m
        if s * d <= 0.0 or under <= 0.0:
            raise ValueError("the ball's ray does not meet the plate: check the plate pose")
        Z = (d + (sqrt(under) if d > 0 else -sqrt(under))) / (2.0 * s)
        g = Z - radius_m * radius_m / Z
        return x * g, y * g, Z

    def _covariance(self, m, centre, radius_m: float, sigma_px: float) -> np.ndarray:
        """Derivatives of the closed form by its pixel and, where its covariance is known, pose."""
        (x, y), Z, r2 = m, centre[2], radius_m * radius_m
        R = self.camera_from_plate[:3, :3]
        t = self.camera_from_plate[:3, 3]
        n = R[:, 2]
        s_m = float(n[0] * x + n[1] * y + n[2])
        d = float(n @ t) + radius_m
        root = 2.0 * s_m * Z - d
        by_Z = np.array((x * (1 + r2 / Z**2), y * (1 + r2 / Z**2), 1.0))  # dC / dZ
        g = Z - r2 / Z
        C_m = np.outer(by_Z, -(Z * Z - r2) / root * n[:2])  # (3, 2)
        C_m[0, 0] += g
        C_m[1, 1] += g
        fx, fy, _, _ = self.camera.pinhole
        xx, xy, yy = distort_jacobian(x, y, self.camera.lens)
        det = xx * yy - xy * xy
        m_uv = np.array(((yy / fx, -xy / fy), (-xy / fx, xx / fy))) / det
        J = R[:, :2].T @ C_m @ m_uv
        cov = sigma_px * sigma_px * (J @ J.T)
        if self.pose_cov is not None:
            P = self._by_pose(np.array((x, y, 1.0)), np.asarray(centre), by_Z, root, radius_m)
            cov = cov + P @ self.pose_cov @ P.T
        return cov

    def _by_pose(self, m, C, by_Z, root: float, radius_m: float) -> np.ndarray:
        """d xy / d (rotation, translation) (2, 6) at a fixed pixel."""
        R, t = self.camera_from_plate[:3, :3], self.camera_from_plate[:3, 3]
        n, Z = R[:, 2], C[2]
        # d(s Z^2 - d Z - w r^2) = 0, with dn = w x n, so a.dn = w.(n x a)
        weight = Z * Z * m - Z * t - radius_m**2 * np.array((m[0], m[1], 0.0))
        Z_pose = -np.concatenate((np.cross(n, weight), -Z * n)) / root
        arm = C - t
        turn = np.array(((0, -arm[2], arm[1]), (arm[2], 0, -arm[0]), (-arm[1], arm[0], 0)))
        # d(R^T (C - t)) = R^T (dC - v - w x (C - t)), and -w x a = [a]x w
        return R[:, :2].T @ (np.outer(by_Z, Z_pose) + np.hstack((turn, -np.eye(3))))


def _ellipse(centre: tuple[float, float, float], radius_m: float) -> tuple[float, ...]:
    """Normalised outline of a ball: centre (mx, my), semi-axes (a, b), angle of `a` in rad."""
    X, Y, Z = centre
    q = Z * Z - radius_m * radius_m
    a = radius_m * sqrt(q + X * X + Y * Y) / q
    turn = atan2(Y, X) if hypot(X, Y) > 0 else 0.0
    return X * Z / q, Y * Z / q, a, radius_m / sqrt(q), turn
