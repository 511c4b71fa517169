"""The camera reduced to numbers: rate, delay, noise, dropouts and the catalogue's camera effects.

Exposures happen at k/rate_hz, k = 1, 2, ...; an observation is usable `camera_delay` later.
"""

from math import nan

import numpy as np

from rig import effect_equations as equations
from rig.compiled import compiled
from rig.plant import SEEN_SX, SEEN_SY, SEEN_T, SEEN_X, SEEN_Y
from rig.signals import R_BALL, R_EXPOSED, R_NEW, R_TIME, R_VARIANCE

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
    camera = np.zeros(1, CAMERA)[0]
    camera["rate_hz"] = rate_hz
    return camera


@compiled
def next_exposure(camera):
    """Time of the next mid exposure [s]."""
    return (camera.frame + 1) / camera.rate_hz


@compiled
def queue_observation(camera, x, y, exposed, usable, variance):
    row = camera.pending[camera.tail % QUEUE]
    row[0], row[1], row[2], row[3], row[4] = x, y, exposed, usable, variance
    camera.tail += 1


@compiled
def look(camera, p, seen, draws):
    """Take the exposure in `seen`, if there is one: draws = two normal, one uniform number (3,)."""
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
    """Put the newest observation that is usable by the reading's time into it; older ones go."""
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
