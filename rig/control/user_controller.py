"""A lab's own controller in the loop: three methods, and a fault in it stops the rig.

    class MyController:
        def start(self, rig, period_s): ...     # once, before the first tick
        def control(self, now): return (volts_x, volts_y)     # at every tick while the ball rolls
        def end(self, outcome): ...             # once, after 0 V was sent, however the run ended

It replaces what `controllers.control` does and nothing else: holding, the blind phase, observers,
limits and recording stay the rig's. It runs in the loop alone, never in the batch kernel. What it
wishes passes `limits.limit`, which turns what is no number into 0 V.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from rig.observers import ball_now
from rig.parameters import Rig
from rig.play_observer import gear_play, joint_play
from rig.signals import R_MOTOR, R_THETA, R_TIME

METHODS = ("start", "control", "end")


@dataclass(frozen=True)
class Now:
    """What a controller sees at a tick; pairs are x, y, SI units.

    ball_m and velocity_m_s: filtered, carried on to t_s; target_m: where the ball should be;
    theta_rad: encoders; motor_rad_s: tachometers (NaN without); torque_nm: Eq. 9's T_e; plays: the
    observers' full widths; volts_V: what was applied since the last tick.
    """

    t_s: float
    ball_m: tuple[float, float]
    velocity_m_s: tuple[float, float]
    target_m: tuple[float, float]
    theta_rad: tuple[float, float]
    rate_rad_s: tuple[float, float]
    motor_rad_s: tuple[float, float]
    torque_nm: tuple[float, float]
    gear_play_rad: tuple[float, float]
    joint_play_rad: tuple[float, float]
    volts_V: tuple[float, float]


class OwnController(Protocol):
    """What a class must have to be named as `controller` in a protocol."""

    def start(self, rig: Rig, period_s: float) -> None: ...

    def control(self, now: Now) -> tuple[float, float]: ...

    def end(self, outcome: str) -> None: ...


class ControllerError(Exception):
    """A lab's own controller failed; the message says where and how."""


def _pair(values) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def now(pilot, q, reading: np.ndarray, target: np.ndarray, applied: np.ndarray) -> Now:
    """The pilot's belief as a `Now`; reading as in `signals`."""
    belief, play = pilot["belief"], pilot["play"]
    t = float(reading[R_TIME])
    return Now(
        t_s=t,
        ball_m=_pair([ball_now(belief, t, a) for a in range(2)]),
        velocity_m_s=_pair(belief["velocity"]),
        target_m=_pair(target),
        theta_rad=_pair(reading[R_THETA:]),
        rate_rad_s=_pair(belief["rate"]),
        motor_rad_s=_pair(reading[R_MOTOR:]),
        torque_nm=_pair(belief["torque"]),
        gear_play_rad=_pair([gear_play(play, q["play"], a)[0] for a in range(2)]),
        joint_play_rad=_pair([joint_play(play, q["play"], a)[0] for a in range(2)]),
        volts_V=_pair(applied),
    )


def _failed(controller: Any, method: str, error: Exception) -> ControllerError:
    where, trace = "", error.__traceback__
    while trace is not None:  # the innermost line that is not this file's
        if trace.tb_frame.f_code.co_filename != __file__:
            where = f", line {trace.tb_lineno}"
        trace = trace.tb_next
    return ControllerError(
        f"controller {type(controller).__name__}.{method} failed{where}: "
        f"{type(error).__name__}: {error}"
    )


def start(controller: OwnController, rig: Rig, period_s: float) -> None:
    """Before the first tick. ControllerError."""
    try:
        controller.start(rig, period_s)
    except Exception as error:  # whatever a lab's code raises must stop the rig, not crash it
        raise _failed(controller, "start", error) from error


def wish(controller: OwnController, seen: Now, out: np.ndarray) -> None:
    """Wished volts of a tick into `out` (2,); ControllerError where there are no two numbers."""
    try:
        volts = controller.control(seen)
        out[0], out[1] = (float(v) for v in volts)
    except Exception as error:  # as above
        out[:] = 0.0
        raise _failed(controller, "control", error) from error


def end(controller: OwnController, outcome: str) -> str:
    """After the run; what failed as a sentence, else nothing."""
    try:
        controller.end(outcome)
    except Exception as error:  # the run is over: what it recorded must not be lost
        return str(_failed(controller, "end", error))
    return ""
