"""What a run is asked to do, tick by tick, and how long it may wait for it."""

from dataclasses import dataclass

import numpy as np

BLIND_LIMIT_S = 1.0  # a ball unseen for so long ends the run
RELEASE_LIMIT_S = 3.0  # in a simulation, a release not detected by then ends the run


@dataclass(frozen=True, eq=False)
class Course:
    """Targets, pushes and starting place of one run, tick by tick from its release on.

    targets_m (n, 2): where the ball should be in the plate's frame [m]; in a run on the servos
    alone (`servo_only`) the wanted servo angles [rad]. pushes_m_s2 (n, 2): acceleration with which
    the operator pushes the ball [m/s2]. start_m: where the ball is placed; hold_s: how long it is
    held there before it is let go (0: free from the start). operator: the steps that a person is
    asked for, of "place", "hold", "release", "push"; the ball counts as placed within tolerance_m
    of start_m.
    """

    targets_m: np.ndarray
    pushes_m_s2: np.ndarray
    start_m: tuple[float, float] = (0.0, 0.0)
    hold_s: float = 0.0
    servo_only: bool = False
    tolerance_m: float = 0.015
    operator: tuple[str, ...] = ()
