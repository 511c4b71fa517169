"""Where servos that take an angle stand, as far as it follows from what they were told.

The plant's own equations (`rig.plant.position_servo`), once a tick, with the numbers that a
controller believes. It stands for the encoder of a table that has none.
"""

import numpy as np

from rig.compiled import compiled
from rig.plant.position_servo import (
    SERVOS,
    SERVOS_STATE,
    aim,
    arrived,
    move_servos,
    servo_laws,
    servos_at_level,
    table_angles,
)

KEPT = 256  # ticks of commands: at 500 Hz half a second of dead time and period
SERVO_MODEL = np.dtype(
    [
        ("servos", np.float64, (SERVOS_STATE,)),
        ("told", np.float64, (KEPT, 2)),
        ("wanted", np.float64, (SERVOS,)),
        ("angles", np.float64, (2,)),
        ("ticks", np.int64),
    ]
)


def start(p: np.record) -> np.record:
    """Return the model's state (dtype SERVO_MODEL) of servos at level; p: record PLANT."""
    state = np.zeros(1, SERVO_MODEL)[0]
    state["servos"] = servos_at_level(p)
    return state


@compiled
def follow(m, p, told, now, tick_s):
    """Move the model on over the tick that ends now; m is changed in place.

    told (2,): angles that stood since the last tick [rad]; now [s]; tick_s: period [s]. `m.angles`
    (2,) [rad] are the axes' angles now.
    """
    if m.ticks == 0:
        m.ticks = 1
        return
    for i in range(KEPT - 1, 0, -1):
        m.told[i, 0], m.told[i, 1] = m.told[i - 1, 0], m.told[i - 1, 1]
    m.told[0, 0], m.told[0, 1] = told[0], told[1]
    begin = now - tick_s
    middle = begin + 0.5 * tick_s
    x = arrived(p, 0, m.told, begin, middle, tick_s)
    y = arrived(p, 1, m.told, begin, middle, tick_s)
    aim(p, x, y, m.wanted)
    move_servos(p, servo_laws(p, tick_s), m.wanted, tick_s, m.servos)
    table_angles(p, m.servos, m.angles)
