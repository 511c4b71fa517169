"""Every mutant of the safety code dies, or stands here with the proof that it is no other code."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import ModuleType

import pytest

from rig.parameters import Servo
from tests.experiments.dashboard.server import (
    test_controls,
    test_messages,
    test_security,
    test_shell_answers,
)
from tests.experiments.dashboard.session import test_session_states
from tests.experiments.records import test_recording
from tests.mutation import suites
from tests.mutation.mutate import survivors
from tests.rig.hardware.network import test_client_watchdog as test_served
from tests.rig.hardware.network import test_remote_wire, test_seat
from tests.rig.safety import test_follow_watch, test_late_watch, test_levelling, test_motion_watch
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
        assert module.CATCH_TAUS == 5
        assert module.free_rate(2.0, 3.0, 1.5, 0.25) == 0.25 * 2.0 + 0.75 * 4.5
        limiter_laws.late_laws(module)
        stops = module.braking(Servo(gain_rad_s_V=1.5, time_constant_s=0.1), 0.002, 0.017)
        assert stops == pytest.approx(limiter_laws.STOPS)
        assert module.braking(Servo(), 0.002) == pytest.approx((0.003, 0.025, 9.18))

    count, alive = survivors(path, check, compiled=identity, inlined=identity)
    assert count > 50
    assert not unexplained(alive), "\n".join(unexplained(alive))


@dataclass(frozen=True)
class Guarded:
    """A file whose mutants have to die under the tests of a module.

    least: so many mutants there are at least; wanted: which of the tests, by name; only: the
    classes and functions that are changed, none for all.
    """

    path: str
    tests: ModuleType
    least: int
    wanted: Callable[[str], bool] = lambda name: True
    only: tuple[str, ...] = ()


# Tests of the gate that ask for patches, pages of viser's or thousands of examples.
NOT_OF_THE_GATE = (
    "test_a_token_is_kept_for_its_owner_alone",
    "test_a_token_that_is_no_file_is_refused_in_a_line_with_its_cure",
    "test_no_text_opens_the_gate_and_none_breaks_it",
    "test_nobody_listens_to_the_whole_network_unasked",
    "test_the_page_runs_the_scripts_of_visers_page_and_of_its_bar_and_no_others",
)
SERVER, NETWORK = "experiments/dashboard/server", "rig/hardware/network"
FILES = {
    "monitor": Guarded(
        "rig/safety/monitor.py",
        test_guard,
        150,
        lambda name: "healthy" not in name and "never_raises" not in name,
    ),
    "levelling": Guarded("rig/safety/levelling.py", test_levelling, 30),
    "motion": Guarded(
        "rig/safety/motion_watch.py",
        test_motion_watch,
        40,
        lambda name: "healthy" not in name,  # a search
    ),
    "following": Guarded(
        "rig/safety/follow_watch.py",
        test_follow_watch,
        15,
        lambda name: "healthy" not in name,  # a search
    ),
    "late": Guarded("rig/safety/late_watch.py", test_late_watch, 50),
    "watchdog": Guarded(
        f"{NETWORK}/client_watchdog.py",
        test_served,
        60,
        lambda name: "whatever_a_user_does" not in name,  # a search
    ),
    "seal": Guarded(f"{NETWORK}/remote_wire.py", test_remote_wire, 60),
    "greetings": Guarded(f"{NETWORK}/greetings.py", test_seat, 30),
    "seat": Guarded(f"{NETWORK}/serve.py", test_seat, 60, only=("Server",)),
    "session": Guarded(
        "experiments/dashboard/session/session.py",
        test_session_states,
        60,
        lambda name: "races" not in name,  # it leaves to chance what it tries
        ("Session",),
    ),
    "gate": Guarded(
        f"{SERVER}/security.py", test_security, 90, lambda name: name not in NOT_OF_THE_GATE
    ),
    "lock": Guarded(f"{SERVER}/lock.py", test_controls, 30, lambda name: "control" in name),
    "controls": Guarded(
        f"{SERVER}/controls.py",
        test_controls,
        40,
        only=("ControlPanelQueue", "InputRules", "Controls"),
    ),
    "messages": Guarded(f"{SERVER}/messages.py", test_messages, 25),
    "shell": Guarded(f"{SERVER}/shell.py", test_shell_answers, 10),
    "recover": Guarded(
        "experiments/records/recording.py",
        test_recording,
        40,
        lambda name: name.startswith(("test_recover", "test_a_system")),
        ("recover", "being_recorded", "_keep_damaged", "_is_locked", "lock"),
    ),
}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")  # of mutants
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("file", FILES.values(), ids=FILES)
def test_every_mutant_dies(file: Guarded):
    names = [one for one in vars(file.tests) if one.startswith("test_") and file.wanted(one)]
    check = partial(suites.run_tests, file.tests, names=suites.quickest_first(file.tests, names))
    count, alive = survivors(ROOT / file.path, check, file.only)
    assert count > file.least
    assert not unexplained(alive), "\n".join(unexplained(alive))
