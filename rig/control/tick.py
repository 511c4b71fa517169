"""What runs at every control tick, real table or simulated: observers, phase, controller;
and the row of the log that it gives.

One compiled function of (state, settings, reading): the loop calls it tick by tick, the batch
kernel inlines it, and both give the same bits. It commands volts; `limits.limit` decides what is
applied.
"""

from math import nan

import numpy as np

from rig.compiled import compiled
from rig.control import controllers
from rig.control.compensators.choice import MPC
from rig.control.optimal import lqg, mpc
from rig.estimation import backlash_observer, observers, servo_model
from rig.estimation.backlash_observer import gear_backlash, joint_backlash
from rig.log import INDEX
from rig.parameters import Rig
from rig.plant import plant_record
from rig.safety.limits import SLEW_V_S, braking
from rig.table import R_BALL, R_EXPOSED, R_MOTOR, R_NEW, R_THETA, R_TIME

PLACE, HOLD, RUN, BLIND = range(4)  # PLACE: the ball is still to come; BLIND: it is not seen
RELEASE_M = 0.003  # a held ball that moved this far has been let go
BLIND_S = 0.1

CONTROLLER_STATE = np.dtype(
    [
        ("phase", np.int64),
        ("estimate", observers.ESTIMATE),
        ("backlash", backlash_observer.BACKLASH_STATE),
        ("control", controllers.CONTROL),
        ("servo", servo_model.SERVO_MODEL),
        ("held_at", np.float64, (2,)),
        ("seen", np.int64),
    ]
)
CONTROLLER_SETTINGS = np.dtype(
    [
        ("estimate", observers.ESTIMATE_SETTINGS),
        ("backlash", backlash_observer.BACKLASH_SETTINGS),
        ("control", controllers.CONTROL_SETTINGS),
        ("servo_only", np.int64),  # the target is the servos' angle [rad]; no ball is needed
        ("takes_angle", np.int64),  # what is commanded is an angle [rad]
        ("has_angle", np.int64),  # angles are measured
        ("plant", plant_record.PLANT),  # as believed, for the model of servos without a measurement
        ("voltage_limit", np.float64),
        ("angle_limit", np.float64),
        ("slew", np.float64),  # V a tick
        ("delay", np.float64),  # with the next two: `limits.Braking`
        ("time_constant", np.float64),
        ("top_speed", np.float64),
    ]
)


def settings(rig: Rig, compensator: int, *, servo_only: bool = False) -> np.record:
    """Return all settings (dtype CONTROLLER_SETTINGS) from what a controller may know of the rig.

    compensator: a number of `controllers.COMPENSATORS`; servo_only: targets are servo angles [rad]
    and no ball is needed. ValueError: the compensator commands volts, the servos take an angle.
    """
    controllers.check_compensator(rig, compensator)
    q = np.zeros(1, CONTROLLER_SETTINGS)[0]
    q["takes_angle"], q["has_angle"] = int(rig.servo.takes_angle), int(rig.servo.has_angle)
    q["plant"] = plant_record.pack(rig)
    q["estimate"] = observers.settings(rig)
    q["backlash"] = backlash_observer.settings(rig)
    q["control"] = controllers.settings(rig, compensator)
    q["servo_only"] = int(servo_only)
    q["voltage_limit"] = rig.servo.voltage_limit_V
    q["angle_limit"] = rig.servo.angle_limit_rad
    q["slew"] = SLEW_V_S / rig.control_rate_hz
    stops = braking(rig.servo, 1 / rig.control_rate_hz, rig.gains.torque_filter_s)
    q["delay"], q["time_constant"], q["top_speed"] = stops
    return q


def start(q: np.record, *, held: bool) -> np.record:
    """Return a controller state (dtype CONTROLLER_STATE) at zero for the settings q.

    held: the run begins in HOLD and waits for the ball's release, else in RUN.
    """
    state = np.zeros(1, CONTROLLER_STATE)[0]
    state["phase"] = HOLD if held else RUN
    state["estimate"] = observers.start()
    state["backlash"] = backlash_observer.start(q["backlash"])
    state["control"] = controllers.start()
    state["servo"] = servo_model.start(q["plant"])
    return state


@compiled
def _watch_release(state, reading):
    """HOLD -> RUN when the ball has left the place in which it was held."""
    if reading[R_NEW] == 0.0:
        return
    if state.seen < 3:
        state.held_at[0], state.held_at[1] = reading[R_BALL], reading[R_BALL + 1]
        state.seen += 1
    dx, dy = reading[R_BALL] - state.held_at[0], reading[R_BALL + 1] - state.held_at[1]
    if dx * dx + dy * dy > RELEASE_M * RELEASE_M:
        state.phase = RUN
        state.control.integral[0] = state.control.integral[1] = 0.0


@compiled
def control_tick(state, q, reading, target, applied, commanded):
    """Run one tick of observers, phase and controller; commanded volts go into `commanded` (2,).

    state, q: of `start` and `settings`, state changed in place; reading (READING_SIZE,); target
    (2,) [m], in a run on the servos alone [rad]; applied (2,): volts applied since the last tick.
    Where the servos take an angle, commanded and applied are angles [rad]; the angles that nobody
    measures are written into the reading as the model of the servos has them.
    """
    if q.takes_angle:
        servo_model.follow(state.servo, q.plant, applied, reading[R_TIME], q.control.tick_s)
        for a in range(2):
            if not q.has_angle:
                reading[R_THETA + a] = state.servo.angles[a]
        observers.observe_ball(state.estimate, q.estimate, reading)
        observers.observe_angles(state.estimate, q.estimate, reading)
    else:
        observers.observe(state.estimate, q.estimate, reading, applied)
    if state.phase == PLACE:
        controllers.level(q.control, state.estimate, reading, commanded)
        return
    if state.phase == HOLD:
        _watch_release(state, reading)
        state.control.integral[0] = state.control.integral[1] = 0.0
        lqg.forget(state.control.lqg)
        if q.control.compensator == MPC:
            mpc.forget(state.control.mpc)
    else:
        backlash_observer.observe_backlash(state.backlash, q.backlash, reading)
        blind = observers.seconds_blind(state.estimate, reading) > BLIND_S
        state.phase = BLIND if blind and not q.servo_only else RUN
    if q.servo_only:
        controllers.follow(state.control, q.control, state.estimate, reading, target, commanded)
    elif state.phase == BLIND or state.estimate.frames == 0:
        controllers.level(q.control, state.estimate, reading, commanded)
    else:
        controllers.control(
            state.control,
            q.control,
            state.estimate,
            state.backlash,
            q.backlash,
            reading,
            target,
            commanded,
        )


# Columns of the log that a tick fills; of a pair the first.
_T, _V, _THETA, _BALL = (INDEX[n] for n in ("t_s", "voltage_x_V", "theta_x_rad", "ball_x_m"))
_MOTOR, _TARGET, _PUSH = (INDEX[n] for n in ("motor_speed_x_rad_s", "target_x_m", "push"))
_EXPOSED, _COMMANDED = INDEX["ball_exposed_s"], INDEX["wanted_voltage_x_V"]
_TOLD = INDEX["command_x_rad"]
_DESIRED, _TORQUE = INDEX["desired_theta_x_rad"], INDEX["estimated_torque_x_Nm"]
_GEAR, _GEAR_STD = (INDEX[f"estimated_gear_play{s}_x_rad"] for s in ("", "_std"))
_JOINT, _JOINT_STD = (INDEX[f"estimated_joint_play{s}_x_rad"] for s in ("", "_std"))
_XX, _XY, _YY, _PHASE = (
    INDEX[n] for n in ("ball_cov_xx_m2", "ball_cov_xy_m2", "ball_cov_yy_m2", "phase")
)


@compiled
def fill_row(row, state, q, reading, covariance, target, push, commanded, applied):
    """Write the tick into `row` (len(COLUMNS),), in the order of `COLUMNS`.

    state, q, reading, target, commanded, applied: of `control_tick` and the limiter; covariance
    (3,) = xx, xy, yy of the observation [m2]; push: not 0 while the ball is pushed.
    """
    new = reading[R_NEW] != 0.0
    row[_T], row[_PUSH] = reading[R_TIME], push
    row[_PHASE] = min(float(state.phase), 2.0)  # a blind run is a run
    row[_EXPOSED] = reading[R_EXPOSED] if new else nan
    row[_XX] = covariance[0] if new else nan
    row[_XY] = covariance[1] if new else nan
    row[_YY] = covariance[2] if new else nan
    for a in range(2):
        row[_V + a] = nan if q.takes_angle else applied[a]
        row[_COMMANDED + a] = nan if q.takes_angle else commanded[a]
        row[_TOLD + a] = applied[a] if q.takes_angle else nan
        row[_THETA + a] = reading[R_THETA + a] if q.has_angle else nan
        row[_MOTOR + a] = reading[R_MOTOR + a]
        row[_BALL + a] = reading[R_BALL + a] if new else nan
        row[_TARGET + a], row[_DESIRED + a] = target[a], state.control.wanted_theta[a]
        row[_TORQUE + a] = nan if q.takes_angle else state.estimate.torque[a]
        row[_GEAR + a], row[_GEAR_STD + a] = gear_backlash(state.backlash, q.backlash, a)
        row[_JOINT + a], row[_JOINT_STD + a] = joint_backlash(state.backlash, q.backlash, a)
