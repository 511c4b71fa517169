"""Servos that take an angle and do not read it back: their numbers from the plate's tilt in frames.

The markers give the sines of the plate's tilt (`calibration.motion.timing.TiltRecorder`), the
linkage's inverse the servo angles that hold it, and `calibration.motion.position_servo` fits those
as it fits angles that were read back. The frames' light is dated by the delay of the rig file,
which counts as known: an error of it is one of the dead time. Play between servo and plate holds
the plate back after a reversal as a servo's dead band does, by half its width: only their sum is
seen.
"""

from math import degrees

import numpy as np

from calibration.camera.sheet import CalibrationError
from calibration.motion.commanded_moves import Followed
from calibration.motion.timing import Wiggle
from calibration.records import PositionServoAxis, PositionServoRecord
from rig.linkage import THREE_ARMS
from rig.parameters import Rig
from rig.plant.plant_record import pack
from rig.plant.position_plant import felt_sines

MIN_FRAMES_PER_S = 20.0  # chosen: a servo's lag of 50 ms is a frame
# Of the linkage's inverse. Chosen: on the shipped tables its error is at most 4e-6 rad within the
# angle limits, 2e-4 rad up to the stops, a fortieth of a hobby servo's dead band.
GRID = 401


def followed_by_plate(filmed: Wiggle, rig: Rig) -> Followed:
    """What the servos were told and where the plate showed them.

    filmed: the angles that the servos were told, from each tick to the next, as its `theta_rad`,
    and the tilt in the frames; rig: the linkage and `camera.delay_s`. `CalibrationError`: under 20
    frames a second with markers.
    """
    t_s = filmed.t_s
    seen_s = filmed.stamp_s - rig.camera.delay_s
    inside = (seen_s >= t_s[0]) & (seen_s <= t_s[-1])
    gaps = np.diff(seen_s[inside])
    rate = 1.0 / np.median(gaps) if len(gaps) else 0.0  # a film leaves repeats of a still plate out
    if rate < MIN_FRAMES_PER_S:
        raise CalibrationError(
            f"the plate's markers were seen {rate:.1f} times a second during the run, "
            f"{MIN_FRAMES_PER_S:.0f} are needed: light, focus, the run's own film, a faster camera"
        )
    return Followed(t_s, filmed.theta_rad, seen_s[inside], servo_angles(filmed.sines[inside], rig))


def servo_angles(sines: np.ndarray, rig: Rig) -> np.ndarray:
    """Servo angles (m, 2) [rad] at which the rig's linkage tilts the plate by the sines (m, 2) [1];
    of three arms the tilt itself. NaN beyond the linkage's reach."""
    if rig.linkage.kind == THREE_ARMS:
        return np.arcsin(sines)
    p, reach = pack(rig), rig.servo.stop_rad
    grid = np.linspace(-reach, reach, GRID)
    both = np.array([felt_sines(p, angle, angle) for angle in grid])
    found = np.empty_like(sines)
    for a in range(2):
        kept = np.isfinite(both[:, a])
        rising = kept & (np.gradient(np.where(kept, both[:, a], 0.0)) > 0)
        found[:, a] = np.interp(sines[:, a], both[rising, a], grid[rising], np.nan, np.nan)
    return found


def seen_by_plate(found: PositionServoRecord) -> PositionServoRecord:
    """What `fit_position_servos` found in angles that the plate showed, as what it is: the dead
    band, which stands for half the play as well, is told and not kept."""
    return PositionServoRecord(x=_without_band(found.x), y=_without_band(found.y), source="plate")


def _without_band(axis: PositionServoAxis) -> PositionServoAxis:
    band = axis.dead_band_rad
    if band is None:
        return axis
    value, low, high = (degrees(v) for v in (band.value, band.low, band.high))
    why = (
        f"the plate shows it with half the width of the play before it, together {value:.2f} "
        f"({low:.2f} to {high:.2f}) degrees"
    )
    return axis.model_copy(
        update={"dead_band_rad": None, "not_seen": {**axis.not_seen, "dead_band_rad": why}}
    )
