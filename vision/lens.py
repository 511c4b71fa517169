"""Where does the lens put a ray? OpenCV's model (Brown-Conrady), for floats and arrays alike.

Points are undistorted, frames never. Normalised coordinates x = X/Z, y = Y/Z of a camera that looks
along +Z; coefficients k = (k1, k2, p1, p2, k3) in OpenCV's order. Source: OpenCV, calib3d,
"Detailed description".
"""

from typing import Any

Coefficients = tuple[float, float, float, float, float]


def distort(x: Any, y: Any, k: Coefficients) -> tuple[Any, Any]:
    """The distorted point of the ideal point (x, y) by OpenCV's model: normalised coordinates,
    floats or arrays of any shape; `k` = (k1, k2, p1, p2, k3).

    With r^2 = x^2 + y^2 and g = 1 + k1 r^2 + k2 r^4 + k3 r^6 the point is

        x g + 2 p1 x y + p2 (r^2 + 2 x^2)   and   y g + p1 (r^2 + 2 y^2) + 2 p2 x y.
    """
    k1, k2, p1, p2, k3 = k
    r2 = x * x + y * y
    gain = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return (
        x * gain + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * gain + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    )


def distort_jacobian(x: Any, y: Any, k: Coefficients) -> tuple[Any, Any, Any]:
    """Entries (xx, xy, yy) of the symmetric matrix d distort / d (x, y) at the ideal point (x, y):
    normalised coordinates, floats or arrays of any shape; `k` as in `distort`.
    """
    k1, k2, p1, p2, k3 = k
    r2 = x * x + y * y
    gain = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * k1 + r2 * (4.0 * k2 + r2 * 6.0 * k3)
    return (
        gain + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x,
        x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y,
        gain + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x,
    )


def undistort(xd: Any, yd: Any, k: Coefficients, steps: int = 5) -> tuple[Any, Any]:
    """The ideal point of the distorted point (xd, yd), both normalised coordinates: the inverse of
    `distort` by `steps` steps of Newton's method. 5 steps reach 1e-14 for lenses that do not fold.
    """
    if not any(k):
        return xd, yd
    x, y = xd, yd
    for _ in range(steps):
        ex, ey = distort(x, y, k)
        ex, ey = ex - xd, ey - yd
        xx, xy, yy = distort_jacobian(x, y, k)
        det = xx * yy - xy * xy
        x, y = x - (yy * ex - xy * ey) / det, y - (xx * ey - xy * ex) / det
    return x, y
