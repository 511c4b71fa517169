"""What every servo has a value of its own of: always fitted, and no effect.

Of a servo that takes an angle and reads it back: the lag M with which its motor takes up speed, and
the share of min(M, dead time) that the rig file tells as dead time and is lag (of M alone, shares
beyond the dead time would be one model, and no fit comes away from there). They change the shape of
the answer, not how late it is. Of one that takes a command once a period: when a period begins,
which no log tells; a command waits for it up to a period. Of one that takes volts: the share of the
ball's weight that turns its motor, which is none behind a worm gear. And of a log that does not
tell when a frame was exposed: how long frames waited for the row in which they stand.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from calibration.gap.model.record import Places
from rig.parameters import Rig

MOTOR_KEY, SHARE_KEY, LOAD_KEY = "motor_lag_s", "as_dead_time_1", "felt_weight_1"
BEGIN_KEY, WAIT_KEY = "period_begin_s", "frame_wait_s"
HIGHEST_LAG_S = 0.1  # of a motor; chosen, as of a heavy plate


Nuisance = tuple[str, str, float, float, tuple[float, float]]


def nuisances(rig: Rig, row_s: float) -> Iterator[Nuisance]:
    """Key, axis, nominal value, tolerance and range of each of a rig's; row_s: to how much frames
    are dated [s]. What is within its tolerance over the whole range has no prior; a moment within a
    period or a row has that of a uniform one, so that a delay beside it is told as uncertain."""
    if row_s > 0.0:
        yield WAIT_KEY, "xy", *_within(row_s)
    for axis in "xy":
        servo = rig.servo.on(axis)
        if not servo.takes_angle:
            yield LOAD_KEY, axis, 1.0, 1.0, (0.0, 1.0)
            continue
        if (period_s := servo.period_s) > 0.0:
            yield BEGIN_KEY, axis, *_within(period_s)
        if servo.has_angle:
            high_s = max(HIGHEST_LAG_S, servo.motor_lag_s)
            yield MOTOR_KEY, axis, servo.motor_lag_s, high_s, (0.0, high_s)
            yield SHARE_KEY, axis, 0.0, 1.0, (0.0, 1.0)


def _within(span_s: float) -> tuple[float, float, tuple[float, float]]:
    """Nominal value, tolerance and range of a moment of which no more is known than a span."""
    return 0.5 * span_s, 0.5 * span_s, (-span_s, 2.0 * span_s)


def write(numbers: memoryview[float], places: Places, a: int, given: Mapping[str, float]) -> None:
    """Write the nuisances `given` (key -> value) of axis `a` into a record's numbers."""
    if LOAD_KEY in given:
        numbers[places["felt_weight"][a]] *= given[LOAD_KEY]
    for key in (BEGIN_KEY, WAIT_KEY):
        if key in given:
            numbers[places[key][a]] = given[key]
    if MOTOR_KEY in given:
        lag, dead, motor = (places[k][a] for k in ("lag_s", "dead_time_s", MOTOR_KEY))
        numbers[motor] = given[MOTOR_KEY]
        moved_s = given.get(SHARE_KEY, 0.0) * min(given[MOTOR_KEY], numbers[dead])
        numbers[lag] += moved_s
        numbers[dead] -= moved_s
