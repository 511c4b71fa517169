"""Pictures of a camera that exposes row after row, put together from whole ones of many moments."""

from collections.abc import Callable

import numpy as np

from vision.synthetic.synthetic import Renderer

Motion = Callable[[float], tuple]  # time [s] -> rotation (3, 3), ball (2,) or None, velocity (2,)


def rolling_picture(
    renderer: Renderer,
    motion: Motion,
    t_s: float,
    readout_s: float,
    *,
    band_px: int,
    rows: tuple[float, float] | None = None,
) -> np.ndarray:
    """The picture (h, w, 3) whose middle row is exposed at `t_s` and each band of rows when its
    middle is; `rows`: outside of them the picture is that of `t_s`."""
    image = _whole(renderer, motion, t_s)
    first, last = rows or (0, len(image))
    for top in range(0, len(image), band_px):
        if first <= top + band_px and top <= last:
            middle = (top + min(top + band_px, len(image))) / 2
            late_s = (middle / len(image) - 0.5) * readout_s
            image[top : top + band_px] = _whole(renderer, motion, t_s + late_s)[top : top + band_px]
    return image


def _whole(renderer: Renderer, motion: Motion, t_s: float) -> np.ndarray:
    rotation, ball, velocity = motion(t_s)
    return renderer.render(rotation, ball, velocity_m_s=velocity)
