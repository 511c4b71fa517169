"""What runs at every control tick, real table or simulated: observers, phase, controller.

One compiled function of (state, settings, reading): the loop calls it tick by tick, the batch
kernel inlines it, and both give the same bits. It wishes volts; `limits.limit` decides.
"""

import numpy as np

from rig import controllers, observers, play_observer
from rig.compiled import compiled
from rig.limits import SLEW_V_S
from rig.parameters import Rig
from rig.signals import R_BALL, R_NEW

PLACE, HOLD, RUN, BLIND = range(4)  # PLACE: the ball is still to come; BLIND: it is not seen
RELEASE_M = 0.003  # a held ball that moved this far has been let go
BLIND_S = 0.1

PILOT = np.dtype(
    [
        ("phase", np.int64),
        ("belief", observers.BELIEF),
        ("play", play_observer.PLAY_STATE),
        ("control", controllers.CONTROL),
        ("held_at", np.float64, (2,)),
        ("seen", np.int64),
    ]
)
PILOT_SETTINGS = np.dtype(
    [
        ("belief", observers.BELIEF_SETTINGS),
        ("play", play_observer.PLAY_SETTINGS),
        ("control", controllers.CONTROL_SETTINGS),
        ("servo_only", np.int64),  # the target is the servos' angle [rad]; no ball is needed
        ("voltage_limit", np.float64),
        ("angle_limit", np.float64),
        ("slew", np.float64),  # V a tick
    ]
)


def settings(rig: Rig, arm: int, *, servo_only: bool = False) -> np.record:
    """All settings from what a controller may know of the rig; `arm` as in `controllers`."""
    q = np.zeros(1, PILOT_SETTINGS)[0]
    q["belief"] = observers.settings(rig)
    q["play"] = play_observer.settings(rig)
    q["control"] = controllers.settings(rig, arm)
    q["servo_only"] = int(servo_only)
    q["voltage_limit"] = rig.servo.voltage_limit_V
    q["angle_limit"] = rig.servo.angle_limit_rad
    q["slew"] = SLEW_V_S / rig.control_rate_hz
    return q


def start(q: np.record, *, held: bool) -> np.record:
    """A fresh pilot: everything at zero, waiting for the release where the ball is held."""
    pilot = np.zeros(1, PILOT)[0]
    pilot["phase"] = HOLD if held else RUN
    pilot["belief"] = observers.start()
    pilot["play"] = play_observer.start(q["play"])
    pilot["control"] = controllers.start()
    return pilot


@compiled
def _watch_release(pilot, reading):
    """HOLD -> RUN when the ball has left the place in which it was held."""
    if reading[R_NEW] == 0.0:
        return
    if pilot.seen < 3:
        pilot.held_at[0], pilot.held_at[1] = reading[R_BALL], reading[R_BALL + 1]
        pilot.seen += 1
    dx, dy = reading[R_BALL] - pilot.held_at[0], reading[R_BALL + 1] - pilot.held_at[1]
    if dx * dx + dy * dy > RELEASE_M * RELEASE_M:
        pilot.phase = RUN
        pilot.control.integral[0] = pilot.control.integral[1] = 0.0


@compiled
def pilot_tick(pilot, q, reading, target, applied, wish):
    """One tick: reading (READING_SIZE,), target (2,) [m] and the volts applied since the last tick
    (2,) in; wished volts (2,) out."""
    observers.observe(pilot.belief, q.belief, reading, applied)
    if pilot.phase == PLACE:
        controllers.level(q.control, pilot.belief, reading, wish)
        return
    if pilot.phase == HOLD:
        _watch_release(pilot, reading)
        pilot.control.integral[0] = pilot.control.integral[1] = 0.0
    else:
        play_observer.observe_play(pilot.play, q.play, reading)
        blind = observers.seconds_blind(pilot.belief, reading) > BLIND_S
        pilot.phase = BLIND if blind and not q.servo_only else RUN
    if q.servo_only:
        controllers.follow(pilot.control, q.control, pilot.belief, reading, target, wish)
    elif pilot.phase == BLIND or pilot.belief.frames == 0:
        controllers.level(q.control, pilot.belief, reading, wish)
    else:
        controllers.control(
            pilot.control, q.control, pilot.belief, pilot.play, q.play, reading, target, wish
        )
