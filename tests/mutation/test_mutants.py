"""Every mutant of the safety code dies, or stands here with the proof that it is no other code."""

from functools import partial

import pytest

from rig.parameters import Servo
from tests.mutation import suites
from tests.mutation.mutate import survivors
from tests.rig.hardware.network import test_client_watchdog as test_served
from tests.rig.safety import test_levelling
from tests.rig.safety import test_monitor as test_guard
from tests.support import ROOT, limiter_laws


def identity(function):
    return function


# A part of a mutant's name, and why it is the same code.
SAME = {
    "age_s=0.0,  [['0.0']: 0.0 -> -1]": "an age of -1 s is as fresh as one of 0 s",
    "(rate_rad_s - rate_rad_s)  [['(commanded_V": "NaN or 0 each: + and - are alike",
    "['allowed > 0.0']: Gt -> GtE": "0 V would be returned as 0 V",
    "['allowed < 0.0']: Lt -> LtE": "0 V would be returned as 0 V",
    "strict=True": "what is zipped are pairs by their types",
    "seen_s: float = -inf  [['-inf']: USub dropped]": "seen_s: read only where it is finite",
    "theta_rad: float = 0.0": "StallWatch(): of no meaning while its sign is 0",
    "since_s: float = 0.0": "StallWatch(): of no meaning while its sign is 0",
    "theta_rad: tuple[float, float] = (0.0, 0.0)": "not read before the first reading",
    "late_s: float = 0.0  [": "MonitorState(): check() always replaces it",
    "MonitorLimits(0.0, inf, inf, inf)  # of these only what a stall is  [['0.0']": "not used",
    "self._volts, self._pushes = [0.0, 0.0]": "+-1 V is no push either",
    "most, inf, inf, _AT_REST)  [['0.0']": "no angle, no slew is too much",
    "_AT_REST = Braking(": "of no meaning without an angle limit",
    "limit(commanded, a, w, 0.0, most, reach, inf, self._braking)  [['0.0']": "no slew",
    "self._volts = self._given = (0.0, 0.0)  [['0.0']": "served: arm() and volts() set them",
    "reading, self._given, balancing=False)  [['False']": "a served table is asked for no ball",
    "self._fresh_s = self._stopped_s = -inf": "arm() and configure() set them before that",
    "[['self._levelling = Levelling(voltage_limit_V)']: dropped]": "stop() sets it before that",
}


def unexplained(alive: list[str]) -> list[str]:
    return [name for name in alive if not any(known in name for known in SAME)]


def test_every_mutant_of_the_limiter_dies():
    path = ROOT / "rig/safety/limits.py"

    def check(module) -> None:
        limiter_laws.laws(module.limit, module.Braking(*limiter_laws.STOPS))
        assert (module.SLEW_V_S, module.STALE_S, module.TAPER_RAD) == (1500.0, 0.05, 0.04)
        stops = module.braking(Servo(gain_rad_s_V=1.5, time_constant_s=0.1), 0.002, 0.017)
        assert stops == pytest.approx(limiter_laws.STOPS)
        assert module.braking(Servo(), 0.002) == pytest.approx((0.003, 0.025, 9.18))

    count, alive = survivors(path, check, compiled=identity)
    assert count > 50
    assert not unexplained(alive), "\n".join(unexplained(alive))


GUARD_TESTS = [
    name
    for name in vars(test_guard)
    if name.startswith("test_") and "healthy" not in name and "never_raises" not in name
]


@pytest.mark.slow
def test_every_mutant_of_the_guard_dies():
    names = suites.quickest_first(test_guard, GUARD_TESTS)
    check = partial(suites.run_tests, test_guard, names=names)
    count, alive = survivors(ROOT / "rig/safety/monitor.py", check)
    assert count > 150
    assert not unexplained(alive), "\n".join(unexplained(alive))


def dies(path: str, tests) -> tuple[int, list[str]]:
    """Mutants of a file under all tests of a module: how many, and who lives unexplained."""
    names = [name for name in vars(tests) if name.startswith("test_")]
    check = partial(suites.run_tests, tests, names=suites.quickest_first(tests, names))
    count, alive = survivors(ROOT / path, check)
    return count, unexplained(alive)


@pytest.mark.slow
def test_every_mutant_of_the_watchdog_over_a_served_table_dies():
    count, alive = dies("rig/hardware/network/client_watchdog.py", test_served)
    assert count > 60
    assert not alive, "\n".join(alive)


@pytest.mark.slow
def test_every_mutant_of_levelling_dies():
    count, alive = dies("rig/safety/levelling.py", test_levelling)
    assert count > 30
    assert not alive, "\n".join(alive)
