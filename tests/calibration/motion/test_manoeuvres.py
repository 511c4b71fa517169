"""An arm that its motor strikes at full speed, after the play of its gears, stays off its stops."""

from dataclasses import replace

import numpy as np

from calibration.motion.manoeuvres import go_to, perform
from rig.parameters import Rig
from rig.simulation.simulator import SimulatedTable


def struck(period_s: float, waits: tuple[int, ...]):
    """Full volts towards the limit from the far side of the play, after `waits` ticks back."""
    for wait in waits:
        yield from go_to(0.4, period_s, 0.0)
        for volts, ticks in ((-0.8, wait), (6.0, 150), (-2.0, 150)):
            for _ in range(ticks):
                yield volts, 1


def test_the_limit_counts_with_the_motors_speed_in_the_play():
    play = {"gear_backlash": {axis: {"play_rad": 0.09} for axis in "xy"}}
    rig = replace(Rig(), effects=play, servo=replace(Rig().servo, time_constant_s=0.04, stop_rad=3))
    table = SimulatedTable(rig, np.random.default_rng(1), start_m=(1.0, 1.0))
    moves = [struck(table.period_s, waits) for waits in ((60, 70, 80, 90), (65, 75, 85, 95))]
    with table:
        trace = perform(table, (moves[0], moves[1]))
    assert np.abs(trace.theta_rad).max() < 0.59  # 0.609 by the encoder's rate alone; the stop: 0.61
