"""Times of a device's ticks on the host's clock."""

import numpy as np

from rig.hardware.observations import TickClock


def test_a_slow_fast_or_jumping_device_is_followed():
    rng = np.random.default_rng(3)
    for pace, lost_s in ((0.995, 0.0), (1.005, 0.0), (1.0, 0.1)):
        clock, worst_s, last_s = TickClock(), 0.0, -1.0
        for k in range(20_000):  # 40 s, the deliveries late by up to a few ms
            true_s = 0.002 * k
            lost = lost_s if true_s > 20.0 else 0.0  # its ticks were not counted for so long
            arrived_s = true_s + min(rng.exponential(3e-4), 0.005)
            t_s = clock.time(7.0 + pace * true_s - lost, arrived_s, 0.002)
            assert t_s > last_s
            last_s = t_s
            if not 20.0 < true_s < 20.6:
                worst_s = max(worst_s, abs(t_s + clock.zero_s - true_s))
        assert worst_s < 0.004


def test_what_waited_in_a_buffer_is_not_taken_for_new():
    """After a halt of half a second the host reads on where it was."""
    clock = TickClock()
    for k in range(500):
        clock.time(0.002 * k, 0.002 * k, 0.002)
    for k in range(500, 700):
        assert clock.time(0.002 * k, 1.5 + 1e-5 * k, 0.002) < 0.002 * k + 1e-4
