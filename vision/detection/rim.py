"""Does the rim show that colour is stored more coarsely than brightness, as by JPEG and video?"""

from __future__ import annotations

import numpy as np

from vision.detection.pixels import LUMA

BESIDE_PX = 6.0  # how far to both sides the mean profile across the rim reaches
BIN_PX = 0.5
# By how much colour widens the rim beside brightness, in quadrature: 2 px and more in JPEG, up to
# 1.5 px in other images of two generated worlds.
SMEAR_PX = 1.75


def colour_is_smeared(image: np.ndarray, u_px: float, v_px: float, radius_px: float) -> bool:
    """Whether colour differences blur the edge of the disc by `SMEAR_PX` more than brightness does,
    as in images (h, w, 3) uint8 that went through chroma subsampling (4:2:0 and the like). Place
    and radius in px."""
    reach = radius_px + BESIDE_PX + 1.0
    x0, y0 = max(0, int(u_px - reach)), max(0, int(v_px - reach))
    window = image[y0 : max(0, int(v_px + reach)) + 1, x0 : max(0, int(u_px + reach)) + 1]
    y, x = np.indices(window.shape[:2])
    off = np.hypot(x + x0 - u_px, y + y0 - v_px) - radius_px
    near = np.abs(off) < BESIDE_PX
    bins = ((off[near] + BESIDE_PX) / BIN_PX).astype(int)
    counts = np.bincount(bins)
    across = np.stack([np.bincount(bins, window[near][:, c]) for c in range(3)], 1)[counts > 0]
    if len(across) < 6:
        return False
    across /= counts[counts > 0, None]
    luma = across @ LUMA
    colour = across - luma[:, None]
    wider_px2 = _width_px(colour @ (colour[0] - colour[-1])) ** 2 - _width_px(luma) ** 2
    return wider_px2 > SMEAR_PX**2


def _width_px(profile: np.ndarray) -> float:
    """Over how many px a profile (n,) of bins goes from a quarter to three quarters of its way."""
    n = len(profile) // 6
    start, end = profile[:n].mean(), profile[-n:].mean()
    way = np.maximum.accumulate((profile - start) / (end - start + 1e-9))
    low, high = np.interp((0.25, 0.75), way, np.arange(len(way)))
    return BIN_PX * float(high - low)
