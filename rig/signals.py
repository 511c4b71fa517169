"""What a control tick brings, as one flat row that the compiled functions share."""

from math import nan

import numpy as np

# Reading: tick time [s], encoder angles [rad], motor speeds at the load shaft [rad/s] (NaN without
# a tachometer), 1.0 when a new observation came, ball centre [m], its exposure time [s], variance
# of each coordinate [m2].
R_TIME, R_THETA, R_MOTOR, R_NEW, R_BALL, R_EXPOSED, R_VARIANCE = 0, 1, 3, 5, 6, 8, 9
READING_SIZE = 10


def blank_reading() -> np.ndarray:
    row = np.full(READING_SIZE, nan)
    row[R_NEW] = 0.0
    return row
