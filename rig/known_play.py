"""What calibration found of the play, as the controllers take it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class KnownPlay:
    """Play as calibrated (`rig calibrate play`), full width at the servo; 0: the observers find it.

    factor: what a controller takes for the play, in parts of what it knows of it; 1 but where the
    harm of a wrong estimate is studied.
    """

    gear_x_rad: float = 0.0
    gear_y_rad: float = 0.0
    joint_x_rad: float = 0.0
    joint_y_rad: float = 0.0
    factor: float = 1.0
