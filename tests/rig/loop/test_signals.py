"""Signals that end a program: none is lost, whatever swallows what it raises."""

import signal
import time
import weakref

import pytest

from rig.loop.commands import CommandSlot
from rig.loop.signals import AGAIN_S, LEAVING_S, leave_if_told, leave_on_signals, stop_on_signals

pytestmark = pytest.mark.usefixtures("heeded")


class Thing:
    pass


def swallowed(number: int) -> None:
    """Have the signal come in a weak reference's callback, which lets nothing out."""
    thing = Thing()
    watch = weakref.ref(thing, lambda _: signal.raise_signal(number))
    del thing
    assert watch() is None


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("report", [leave_if_told, lambda: None])
def test_ctrl_c_that_something_swallowed_is_heard_where_work_reports_or_fails(report):
    """llvmlite drops what is raised while it compiles, and fails a little later."""
    done = []

    def program() -> None:
        with leave_on_signals(done.append):
            swallowed(signal.SIGINT)
            report()
            done.append("more work")
            raise RuntimeError("no compiled object yet")

    with pytest.raises(KeyboardInterrupt):
        program()
    assert done == ([] if report is leave_if_told else ["more work"])


def test_a_signal_that_comes_back_as_another_error_ends_the_program_as_that_signal():
    """What runs code of others catches all that leaves it, and names it as theirs."""

    def program() -> None:
        with leave_on_signals(lambda words: None):
            try:
                signal.raise_signal(signal.SIGTERM)
            except SystemExit as error:
                raise ValueError(f"open: {error!r}") from error

    with pytest.raises(SystemExit) as left:
        program()
    assert left.value.code == 128 + signal.SIGTERM


def test_a_signal_that_stopped_a_run_is_said_once():
    """The handler of a run's stop told nobody: `rig run` ended without a word."""
    said = []

    def program() -> None:
        with leave_on_signals(said.append), stop_on_signals(CommandSlot()):
            signal.raise_signal(signal.SIGTERM)

    with pytest.raises(SystemExit):
        program()
    assert said == ["ended by SIGTERM; what was recorded so far is kept"]


def test_a_failure_stays_one_where_no_signal_came():
    leave_if_told()
    with pytest.raises(RuntimeError, match="its own"), leave_on_signals(print):
        raise RuntimeError("its own")


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_swallowed_signal_begins_no_run_and_ends_the_program(number):
    slot, said, begun, after = CommandSlot(), [], [], []

    def program() -> None:
        with leave_on_signals(said.append):
            swallowed(number)
            with stop_on_signals(slot):
                begun.extend(slot.take())
            after.append("another run")

    with pytest.raises(SystemExit) as left:
        program()
    assert left.value.code == 128 + number
    assert [stop.outcome for stop in begun] == ["interrupted"]
    assert said == [f"ended by {number.name}; what was recorded so far is kept"]
    assert not after


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_swallowed_signal_is_raised_again_in_the_midst_of_work(number):
    """Where work of 20 s went on that reports nothing, it was heard at its end."""
    said, begun_s = [], time.monotonic()

    def program() -> None:
        with leave_on_signals(said.append):
            swallowed(number)
            while time.monotonic() < begun_s + 10.0:
                time.sleep(0.01)

    with pytest.raises((KeyboardInterrupt, SystemExit)):
        program()
    assert time.monotonic() - begun_s < 5.0
    assert len(said) == (number != signal.SIGINT)
    leave_if_told()  # nothing is left of it


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_what_is_raised_again_disturbs_no_levelling():
    """It was heard meanwhile, and the program is being left already."""
    levelled = []

    def program() -> None:
        with leave_on_signals(lambda text: None):
            swallowed(signal.SIGTERM)
            try:
                leave_if_told()
            finally:
                time.sleep(4 * AGAIN_S)
                levelled.append(True)

    with pytest.raises(SystemExit):
        program()
    assert levelled


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_swallowed_signal_is_the_exit_code_though_all_went_well():
    def program(*numbers: int) -> None:
        with leave_on_signals(lambda text: None):
            for number in numbers:
                swallowed(number)

    with pytest.raises(SystemExit) as left:
        program(signal.SIGTERM)
    assert left.value.code == 143
    program()  # forgotten


@pytest.mark.parametrize("error", [BrokenPipeError, ImportError, RuntimeError])
def test_a_signal_of_which_nothing_can_be_said_ends_the_program_all_the_same(error):
    def say(_: str) -> None:
        raise error

    with pytest.raises(SystemExit) as left, leave_on_signals(say):
        signal.raise_signal(signal.SIGHUP)
    assert left.value.code == 129


@pytest.mark.parametrize("further", [signal.SIGTERM, signal.SIGINT])
def test_further_signals_disturb_no_levelling_and_work_again_later(monkeypatch, further):
    now_s, said, levelled = [100.0], [], []

    def program() -> None:
        with leave_on_signals(said.append):
            try:
                signal.raise_signal(signal.SIGHUP)
            finally:
                now_s[0] += LEAVING_S - 0.1
                signal.raise_signal(further)
                levelled.append(True)
                now_s[0] += 0.2
                signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(time, "monotonic", lambda: now_s[0])
    with pytest.raises(SystemExit) as left:
        program()
    assert left.value.code == 143
    assert len(said) == 2
    assert levelled
