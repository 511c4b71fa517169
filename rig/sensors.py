"""Encoder and tachometer: what the drives let a controller see."""

from math import floor, nan

from rig.compiled import compiled
from rig.plant import ARM, MOTOR_RATE
from rig.signals import R_MOTOR, R_THETA


@compiled
def read_drives(s, p, draws, reading):
    """Encoder angles [rad] to the nearest count, motor speeds [rad/s] with noise from draws (2,).

    The tachometer sits on the motor's shaft, the encoder behind the gears, on the arm's.
    """
    for a in range(2):
        reading[R_THETA + a] = floor(s[ARM, a] / p.encoder_step + 0.5) * p.encoder_step
        speed = s[MOTOR_RATE, a] * (1.0 + p.tachometer_scale) + p.tachometer_noise * draws[a]
        reading[R_MOTOR + a] = speed if p.tachometer > 0.0 else nan
