"""A board that knows what moves its arms: the law of motion_watch.py in whole numbers."""

from math import inf

import pytest

from rig.hardware.board import wire
from rig.hardware.board.wire import VERSION, Arm, ConfigRequest
from rig.safety.motion_watch import UNKNOWN, MotionLimits, MotionWatch, is_overdue, watch_motion
from tests.rig.hardware.board.test_board import LIMIT, Bench

KNOWS = (750, 500, 600, 400)  # mV up and down of both channels
PUSH = 65  # V ms


class Knowing(Bench):
    """A bench whose board was told what moves its arms."""

    def __init__(self, wired: int = 1, tau_ms: int = 50, **more) -> None:
        super().__init__(armed=False)
        self.request = ConfigRequest(
            *(VERSION, 8, 1, wired, 0, 0, 4096, LIMIT, 6000, tau_ms, 9180), *KNOWS, PUSH
        )
        self.configure()
        self.send(Arm(self.token, self.sequence))
        self.run(1)

    def still_ms(self, x: float, y: float = 0.0, counts=lambda k: (0, 0), most: int = 2000):
        """After how many ms of these volts it latches; None: never."""
        for k in range(most):
            self.counts = counts(k)
            self.command(x, y)
            self.run(1)
            if self.has(wire.LATCHED, wire.BY_STALL):
                return k
        return None


@pytest.mark.parametrize(
    ("x", "y", "over"), [(1.0, 0.0, 0.25), (-1.0, 0.0, 0.5), (0.0, 1.9, 1.3), (0.0, -0.6, 0.2)]
)
def test_a_still_arm_is_latched_as_the_loops_law_says(x: float, y: float, over: float):
    limits = MotionLimits(1.0, 0.05, 0.004, 1e-3 * PUSH, UNKNOWN)
    size, seen, expected = abs(x + y), MotionWatch(), 0
    while not is_overdue(seen, limits):
        seen = watch_motion(seen, limits, (size - over, inf), size, 0.0, 1e-3)
        expected += 1
    assert Knowing().still_ms(x, y) == pytest.approx(expected, abs=6)
    assert Bench().has(wire.ARMED)


@pytest.mark.parametrize(("wired", "x", "y"), [(3, 0.6, 0.0), (9, 0.0, 0.6), (5, 0.0, 0.5)])
def test_channels_that_are_turned_or_crossed_have_their_own_volts(wired: int, x: float, y: float):
    """Channel 0 down 0.5 V; crossed, motor 1 turns encoder 0: up 0.75 V; channel 1 down 0.4 V."""
    assert (Knowing(wired).still_ms(x, y) is None) == (wired == 9)


def test_weak_volts_a_motion_and_an_unhomed_board_are_no_stall():
    assert Knowing().still_ms(0.75, -0.4) is None
    assert Knowing().still_ms(1.0, counts=lambda k: (8 * (k // 100), 0)) is None
    assert Knowing().still_ms(1.0, counts=lambda k: (7 * (k // 3 % 2), 0)) is not None  # flickers
    assert Knowing(wired=0).still_ms(1.4) is None
    bench = Bench()  # nobody told it
    for _ in range(1000):
        bench.command(1.9)
        bench.run(1)
    assert bench.has(wire.ARMED)


def test_strong_volts_with_pauses_are_a_stall_whatever_the_board_was_told():
    """2 ms of 0 V in 300 began the stall anew, for ever."""
    bench, k = Bench(), 0
    while not bench.has(wire.LATCHED, wire.BY_STALL):
        bench.command(6.0 if k % 300 < 298 else 0.0)
        bench.run(1)
        k += 1
        assert k < 250


def test_the_arm_beside_a_still_one_is_braked_on():
    """Its own encoder is right: at 0 V it would fly on."""
    latched = Knowing().still_ms(1.2)
    assert latched is not None
    bench, volts = Knowing(), []
    for k in range(latched + 150):
        flown = k - latched + 60  # ms, at 8 rad/s, up to its stop
        bench.counts = (0, min(5 * max(flown, 0), 400))
        if k <= latched:
            bench.command(1.2, 6.0 if flown > 0 else 0.0)
        bench.run(1)
        volts.append(bench.board.volts())
    assert bench.has(wire.LATCHED, wire.BY_STALL)
    assert volts[latched - 1][0] == 1.2
    assert not any(x for x, _ in volts[latched + 1 :])
    assert min(y for _, y in volts[latched + 1 :]) < -3.0
