"""What a controller that is not built in sees at a tick, as one row of numbers.

The loop hands it to a user's controller (`user_controller.Now`), the stepwise simulator to whoever
steers it: the same compiled function of what sensors and observers say, so the same bits. Nothing
of it is the plant's state.
"""

from rig.compiled import compiled
from rig.estimation.backlash_observer import gear_backlash, joint_backlash
from rig.estimation.observers import ball_now
from rig.table import R_MOTOR, R_THETA, R_TIME

PAIRS = (  # after the time, x and y of each, in this order
    "ball_m",
    "velocity_m_s",
    "target_m",
    "theta_rad",
    "rate_rad_s",
    "motor_rad_s",
    "torque_nm",
    "gear_play_rad",
    "joint_play_rad",
    "volts_V",
)
COLUMN = {name: 1 + 2 * i for i, name in enumerate(PAIRS)}  # of a pair the first
SEEN_SIZE = 1 + 2 * len(PAIRS)


@compiled
def fill_seen(row, state, q, reading, target, applied):
    """Write the tick into `row` (SEEN_SIZE,): t_s, then PAIRS.

    state, q: of `control.tick` after the tick's `control_tick`; reading (READING_SIZE,), columns
    R_*; target (2,) [m]; applied (2,): volts, or angles, applied since the last tick.
    """
    row[0] = reading[R_TIME]
    for a in range(2):
        row[1 + a] = ball_now(state.estimate, reading[R_TIME], a)
        row[3 + a] = state.estimate.velocity[a]
        row[5 + a] = target[a]
        row[7 + a] = reading[R_THETA + a]
        row[9 + a] = state.estimate.rate[a]
        row[11 + a] = reading[R_MOTOR + a]
        row[13 + a] = state.estimate.torque[a]
        row[15 + a] = gear_backlash(state.backlash, q.backlash, a)[0]
        row[17 + a] = joint_backlash(state.backlash, q.backlash, a)[0]
        row[19 + a] = applied[a]
