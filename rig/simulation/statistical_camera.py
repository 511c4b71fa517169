"""The camera reduced to numbers: rate, delay, noise, dropouts and the catalogue's camera effects.

Exposures happen at k/rate_hz, k = 1, 2, ...; an observation is usable `camera_delay` later.
"""

from math import nan

import numpy as np

from rig.compiled import compiled
from rig.plant import effect_equations as equations
from rig.plant.plant import SEEN_SX, SEEN_SY, SEEN_T, SEEN_X, SEEN_Y
from rig.table import R_BALL, R_EXPOSED, R_NEW, R_TIME, R_VARIANCE

QUEUE = 32
CAMERA = np.dtype(
    [
        ("frame", np.int64),  # exposures so far
        ("rate_hz", np.float64),
        ("head", np.int64),
        ("tail", np.int64),
        ("pending", np.float64, (QUEUE, 5)),  # x, y, exposed, usable, variance
    ]
)


def start(rate_hz: float) -> np.record:
    """Return the camera's record (dtype CAMERA) before its first exposure; rate_hz: frames a
    second.
    """
    camera = np.zeros(1, CAMERA)[0]
    camera["rate_hz"] = rate_hz
    return camera


@compiled
def next_exposure(camera):
    """Time of the next exposure's middle [s]."""
    return (camera.frame + 1) / camera.rate_hz


@compiled
def queue_observation(camera, x, y, exposed, usable, variance):
    """Queue an observation: position x, y [m], stamp `exposed` and time of use `usable` [s],
    variance of a coordinate [m2]. camera: record CAMERA, changed in place.
    """
    row = camera.pending[camera.tail % QUEUE]
    row[0], row[1], row[2], row[3], row[4] = x, y, exposed, usable, variance
    camera.tail += 1


@compiled
def look(camera, p, seen, draws):
    """Take the exposure in `seen` (7,), columns SEEN_*, if there is one, and queue its observation.

    p: record PLANT; draws (3,): two normal numbers for the noise, one uniform for the dropout. The
    stamp takes the rig file's delay for the true one; the effect `camera_delay` is its error.
    """
    if np.isnan(seen[SEEN_T]):
        return
    camera.frame += 1
    if draws[2] < p.camera_dropout:
        return
    x, y = equations.camera_map(
        seen[SEEN_X] + p.camera_height * seen[SEEN_SX],
        seen[SEEN_Y] + p.camera_height * seen[SEEN_SY],
        p.camera_scale_fraction[0],
        p.camera_yaw_angle_rad[0],
        p.lens_distortion_k1_1_m2[0],
    )
    x, y = x + p.camera_noise * draws[0], y + p.camera_noise * draws[1]
    usable = seen[SEEN_T] + p.camera_delay
    stamp = seen[SEEN_T] + p.camera_delay_extra_s[0]  # the rig file's delay is all the stamp knows
    queue_observation(camera, x, y, stamp, usable, p.camera_noise**2)


@compiled
def deliver(camera, reading):
    """Put the newest observation that is usable by the reading's time into it; older ones are
    dropped.

    reading (READING_SIZE,): R_NEW is 0 and the ball's columns are NaN where there is none.
    """
    reading[R_NEW] = 0.0
    reading[R_BALL] = reading[R_BALL + 1] = reading[R_EXPOSED] = reading[R_VARIANCE] = nan
    while camera.head < camera.tail:
        row = camera.pending[camera.head % QUEUE]
        if row[3] > reading[R_TIME] + 1e-9:
            return
        camera.head += 1
        reading[R_NEW] = 1.0
        reading[R_BALL], reading[R_BALL + 1] = row[0], row[1]
        reading[R_EXPOSED], reading[R_VARIANCE] = row[2], row[4]
