"""One control tick as one row of the log: written by the same compiled function everywhere."""

from math import nan

from rig.compiled import compiled
from rig.log import INDEX
from rig.play_observer import gear_play, joint_play
from rig.signals import R_BALL, R_EXPOSED, R_MOTOR, R_NEW, R_THETA, R_TIME

_T, _V, _THETA, _BALL = (INDEX[n] for n in ("t_s", "voltage_x_V", "theta_x_rad", "ball_x_m"))
_MOTOR, _TARGET, _PUSH = (INDEX[n] for n in ("motor_speed_x_rad_s", "target_x_m", "push"))
_EXPOSED, _WISH = INDEX["ball_exposed_s"], INDEX["wanted_voltage_x_V"]
_DESIRED, _TORQUE = INDEX["desired_theta_x_rad"], INDEX["estimated_torque_x_Nm"]
_GEAR, _GEAR_STD = (INDEX[f"estimated_gear_play{s}_x_rad"] for s in ("", "_std"))
_JOINT, _JOINT_STD = (INDEX[f"estimated_joint_play{s}_x_rad"] for s in ("", "_std"))
_XX, _XY, _YY, _PHASE = (
    INDEX[n] for n in ("ball_cov_xx_m2", "ball_cov_xy_m2", "ball_cov_yy_m2", "phase")
)


@compiled
def fill_row(row, pilot, q, reading, covariance, target, push, wish, applied):
    """Write the tick into `row` (len(COLUMNS),); covariance (3,) = xx, xy, yy [m2]."""
    new = reading[R_NEW] != 0.0
    row[_T], row[_PUSH] = reading[R_TIME], push
    row[_PHASE] = min(float(pilot.phase), 2.0)  # a blind run is a run
    row[_EXPOSED] = reading[R_EXPOSED] if new else nan
    row[_XX] = covariance[0] if new else nan
    row[_XY] = covariance[1] if new else nan
    row[_YY] = covariance[2] if new else nan
    for a in range(2):
        row[_V + a], row[_WISH + a] = applied[a], wish[a]
        row[_THETA + a], row[_MOTOR + a] = reading[R_THETA + a], reading[R_MOTOR + a]
        row[_BALL + a] = reading[R_BALL + a] if new else nan
        row[_TARGET + a], row[_DESIRED + a] = target[a], pilot.control.wanted_theta[a]
        row[_TORQUE + a] = pilot.belief.torque[a]
        row[_GEAR + a], row[_GEAR_STD + a] = gear_play(pilot.play, q.play, a)
        row[_JOINT + a], row[_JOINT_STD + a] = joint_play(pilot.play, q.play, a)
