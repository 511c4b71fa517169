"""What passes between the stages of `vision`: frame, track, observation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Frame:
    """One image and when the light hit the sensor.

    `image` is (h, w, 3) uint8 in BGR order, `t_s` the middle of its exposure [s] (see
    `sources.open_source` for the zero), `index` its place in the file or stream (skipped duplicates
    count, so indices may jump).
    """

    image: np.ndarray
    t_s: float
    index: int


@dataclass(frozen=True)
class Track:
    """The tracker's estimate of the ball in one frame, in pixels.

    `state` is "search", "track", "coast" or "lost". `u_px, v_px` is the centre of the silhouette
    ellipse in the raw image, `sigma_px` its standard deviation per axis, `radius_px` the mean
    radius. In "coast" all are predictions with grown sigma; in "search" and "lost" all are NaN: a
    ball that was not seen has no position.
    """

    state: str
    u_px: float = math.nan
    v_px: float = math.nan
    sigma_px: float = math.nan
    radius_px: float = math.nan


@dataclass(frozen=True, eq=False)
class Observation:
    """The ball's centre in the plate frame (foot of the normal on the plate), with its covariance.

    `xy_m` [m]; `cov_m2`: (xx, xy, yy) [m^2]; `exposed_s`: the mid-exposure time of its frame [s].
    """

    xy_m: tuple[float, float]
    cov_m2: tuple[float, float, float]
    exposed_s: float
