"""How noisy are the pixels of an image?"""

from __future__ import annotations

import math

import cv2
import numpy as np


def noise_level(image: np.ndarray) -> float:
    """Standard deviation of the pixel noise of an image (h, w, 3) uint8, in grey levels, from its
    green channel.

    J. Immerkaer, "Fast noise variance estimation", CVIU 64 (1996): the mean response of a
    difference of two Laplacians, blind to constant, linear and quadratic shading.
    """
    taps = np.array([1.0, -2.0, 1.0])
    response = cv2.sepFilter2D(image[:, :, 1], cv2.CV_16S, taps, taps)
    return cv2.norm(response, cv2.NORM_L1) / response.size * math.sqrt(math.pi / 2) / 6
