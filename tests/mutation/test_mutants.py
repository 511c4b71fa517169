"""Every mutant of the safety code dies, or stands here with the proof that it is no other code."""

from functools import partial

import pytest

from rig.parameters import Servo
from tests.experiments.dashboard.server import (
    test_controls,
    test_messages,
    test_security,
    test_shell_answers,
)
from tests.experiments.records import test_recording
from tests.mutation import suites
from tests.mutation.mutate import survivors
from tests.rig.hardware.network import test_client_watchdog as test_served
from tests.rig.hardware.network import test_remote_wire
from tests.rig.safety import test_levelling
from tests.rig.safety import test_monitor as test_guard
from tests.support import ROOT, limiter_laws


def identity(function):
    return function


EXCUSED = {
    line
    for line in (ROOT / "tests/mutation/equivalent.txt")
    .read_text(encoding="utf-8")
    .splitlines()[1:]
    if line and not line.startswith("#")
}


def unexplained(alive: list[str]) -> list[str]:
    """Those that live without an excuse; and excuses of the same file that nobody needs."""
    file = alive[0].partition(":")[0] if alive else ""
    needless = {one for one in EXCUSED if one.startswith(f"{file}: ")} - set(alive)
    return [name for name in alive if name not in EXCUSED] + sorted(needless)


def test_every_mutant_of_the_limiter_dies():
    path = ROOT / "rig/safety/limits.py"

    def check(module) -> None:
        limiter_laws.laws(module.limit, module.Braking(*limiter_laws.STOPS))
        limiter_laws.angle_laws(module.limit_angle)
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


def dies(path: str, tests, names=(), only=()) -> tuple[int, list[str]]:
    """Mutants of a file under tests of a module: how many, and who lives unexplained.

    names: of the tests, none for all; only: the classes and functions that are changed.
    """
    names = names or [name for name in vars(tests) if name.startswith("test_")]
    check = partial(suites.run_tests, tests, names=suites.quickest_first(tests, names))
    count, alive = survivors(ROOT / path, check, only)
    return count, unexplained(alive)


@pytest.mark.slow
def test_every_mutant_of_the_watchdog_over_a_served_table_dies():
    count, alive = dies("rig/hardware/network/client_watchdog.py", test_served)
    assert count > 60
    assert not alive, "\n".join(alive)


@pytest.mark.slow
def test_every_mutant_of_the_seal_dies():
    count, alive = dies("rig/hardware/network/remote_wire.py", test_remote_wire)
    assert count > 60
    assert not alive, "\n".join(alive)


@pytest.mark.slow
def test_every_mutant_of_levelling_dies():
    count, alive = dies("rig/safety/levelling.py", test_levelling)
    assert count > 30
    assert not alive, "\n".join(alive)


# Tests of the gate that ask for patches, pages of viser's or thousands of examples.
NOT_OF_THE_GATE = (
    "test_a_token_is_kept_for_its_owner_alone",
    "test_no_text_opens_the_gate_and_none_breaks_it",
    "test_nobody_listens_to_the_whole_network_unasked",
    "test_the_page_runs_the_scripts_of_visers_page_and_of_its_bar_and_no_others",
)


@pytest.mark.slow
def test_every_mutant_of_the_gate_dies():
    tests = vars(test_security)
    names = [one for one in tests if one.startswith("test_") and one not in NOT_OF_THE_GATE]
    count, alive = dies("experiments/dashboard/server/security.py", test_security, names)
    assert count > 90
    assert not alive, "\n".join(alive)


@pytest.mark.slow
def test_every_mutant_of_the_control_lock_dies():
    names = [one for one in vars(test_controls) if one.startswith("test_") and "control" in one]
    path, only = "experiments/dashboard/server/controls.py", ("ControlLock",)
    count, alive = dies(path, test_controls, names, only)
    assert count > 30
    assert not alive, "\n".join(alive)


@pytest.mark.slow
def test_every_mutant_of_recover_dies():
    tests = vars(test_recording)
    names = [one for one in tests if one.startswith(("test_recover", "test_a_system"))]
    only = ("recover", "being_recorded", "_keep_damaged", "_is_locked", "_lock")
    count, alive = dies("experiments/records/recording.py", test_recording, names, only)
    assert count > 40
    assert not alive, "\n".join(alive)


@pytest.mark.slow
def test_every_mutant_of_the_filter_of_messages_dies():
    count, alive = dies("experiments/dashboard/server/messages.py", test_messages)
    assert count > 25
    assert not alive, "\n".join(alive)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")  # of mutants
def test_every_mutant_of_the_controls_dies():
    """Who may press and set what, in which order, and what STOP refuses."""
    path = "experiments/dashboard/server/controls.py"
    count, alive = dies(path, test_controls, (), ("ControlPanelQueue", "InputRules", "Controls"))
    assert count > 40
    assert not alive, "\n".join(alive)


@pytest.mark.slow
def test_every_mutant_of_the_shell_dies():
    count, alive = dies("experiments/dashboard/server/shell.py", test_shell_answers)
    assert count > 10
    assert not alive, "\n".join(alive)
