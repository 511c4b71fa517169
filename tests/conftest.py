"""What pytest has to know of these tests: which modules assert, what a run did not try, and when
a test is tried again.
"""

import os
import re
import signal
import sys
import time
from pathlib import Path

import pytest
from hypothesis import settings

if "tests.support" not in sys.modules:  # but for a plugin that lies in it (bare_machine)
    pytest.register_assert_rewrite("tests.support")

from tests.support import parts
from tests.support.standstill import RERUN_DELAY_S, RERUNS, Watch, link_was_lost

# A machine may be busy, or have to compile. CI draws the same examples each time, so that what it
# says is of the change alone; whoever runs the tests by hand draws new ones.
settings.register_profile("untimed", deadline=None, derandomize="CI" in os.environ)
settings.load_profile("untimed")
if parts.PARTS["EGL"].find():
    os.environ.setdefault("MUJOCO_GL", "egl")  # read when MuJoCo is imported: it draws no window
# Read when numpy is imported. Each of the processes that run tests has a core of its own.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# CI's machine may be half as fast as usual, and what it does not end in time it has not done: the
# slow tests begin until this moment [s since 1970], and the rest is counted as not tried.
UNTIL_S = float(os.environ.get("RIG_SLOW_TESTS_UNTIL", "inf"))
TIME_IS_UP = "not tried: the time for slow tests is up"


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """The parts that this machine lacks, what was not tried for that, and what brings them; and how
    many slow tests there was no time for."""
    reasons = [str(report.longrepr) for report in terminalreporter.stats.get("skipped", [])]
    late = sum(TIME_IS_UP in reason for reason in reasons)
    if late:
        terminalreporter.section(f"{late} slow tests were not tried: the time was up")
    found = [re.search(r"needs ([\w, -]+):", reason) for reason in reasons]
    lacking = {name for names in found if names for name in names[1].split(", ")}
    if lacking & set(parts.PARTS):
        terminalreporter.section("not tried on this machine")
        for line in parts.advice(lacking & set(parts.PARTS)):
            terminalreporter.write_line(line)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """A slow test may take five times as long as the others before it counts as hung; one that is
    `realtime` is tried again where the machine stood still (tests/support/standstill.py), once if
    it is slow: a try takes the time of many tests. Whole investigations of the gap come last:
    should the time run out, what keeps a table safe is tried.
    """
    for item in items:
        if item.get_closest_marker("realtime"):
            again = 1 if item.get_closest_marker("slow") else RERUNS
            item.add_marker(
                pytest.mark.flaky(again, reruns_delay=RERUN_DELAY_S, condition=_stood_still)
            )
        if item.get_closest_marker("slow") and not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(1500))
    items.sort(key=lambda item: bool(item.get_closest_marker("slow")) and "/gap/" in str(item.path))


_watches: list[Watch] = []  # of this process: none before the first test that is `realtime`


def _stood_still(error: BaseException | None) -> bool:
    return _watches[0].saw_a_halt() or link_was_lost(error)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """From here on the watch counts; a slow test for which the time is up is not tried."""
    if time.time() > UNTIL_S and item.get_closest_marker("slow"):
        pytest.skip(TIME_IS_UP)
    if item.get_closest_marker("realtime"):
        if not _watches:
            _watches.append(Watch())
        _watches[0].saw_a_halt()


def pytest_unconfigure() -> None:
    """End the watch."""
    for watch in _watches:
        watch.end()


@pytest.fixture(scope="module")
def chromium():
    """A real browser, for tests that import `tests.support.in_browser`."""
    from playwright.sync_api import sync_playwright

    from tests.support.in_browser.program import FLAGS
    from tests.support.parts import PARTS

    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=PARTS["chromium"].find(), args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture
def artefacts(tmp_path: Path) -> Path:
    """The folder for screenshots: RIG_ARTEFACTS, else one of the test's own."""
    folder = Path(os.environ.get("RIG_ARTEFACTS", tmp_path / "shots"))
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@pytest.fixture
def heeded():
    """The signals as of a program in a terminal: in the background some are ignored."""
    names = ("SIGINT", "SIGTERM", "SIGHUP")
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    before = {one: signal.signal(one, signal.default_int_handler) for one in numbers}
    yield
    for one, handler in before.items():
        signal.signal(one, handler)
