"""A user controller in the loop: a class of three methods in a file of the lab's.

A protocol names it, `controller = "mine.py:MyController"`; an error in it stops the rig.

    class MyController:
        def start(self, rig, period_s): ...     # once, before the table is armed
        def control(self, now): return (volts_x, volts_y)     # at every tick while the ball rolls
        def end(self, outcome): ...             # once, when the table is level, however it ended

Each method is bounded in time and memory, and what it prints goes to standard error
(`foreign_call`). A thread of its own ends with the program: join it in `end`. A Python program that
it starts finds no modules beside its own file (PYTHONSAFEPATH). The loop's process has no garbage
collector: cycles of objects that `control` makes stay in memory until the run ends.

It replaces what `controllers.control` does and nothing else: holding, the blind phase, observers,
limits and recording stay the rig's. It runs in the loop alone, never in the batch kernel. What it
commands passes `limits.limit`, which turns what is no number into 0 V.
"""

import importlib.util
import sys
from collections.abc import Callable, Iterator, Mapping, Set
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from rig import foreign_call
from rig.control.seen import PAIRS, SEEN_SIZE, fill_seen
from rig.foreign_call import WORDS_S, ForeignCall, OvertimeError, in_words
from rig.parameters import Rig

METHODS = ("start", "control", "end")
START_S, END_S = 20.0, 10.0  # chosen: loading a network takes seconds, on a slow machine more
CONTROL_S = 5.0  # where no real table waits; a tick of real time has its own bound


@dataclass(frozen=True)
class Now:
    """What a user controller sees at a tick; pairs are x, y, in SI units.

    ball_m, velocity_m_s: filtered, the position carried on to t_s; target_m: where the ball should
    be; theta_rad, rate_rad_s: encoder angles and their filtered rate; motor_rad_s: tachometers at
    the load shaft's scale (NaN without any); torque_nm: T_e of Eq. 9; gear_play_rad,
    joint_play_rad: estimated full widths; volts_V: applied since the last tick.
    """

    t_s: float
    ball_m: tuple[float, float]
    velocity_m_s: tuple[float, float]
    target_m: tuple[float, float]
    theta_rad: tuple[float, float]
    rate_rad_s: tuple[float, float]
    motor_rad_s: tuple[float, float]
    torque_nm: tuple[float, float]
    gear_play_rad: tuple[float, float]
    joint_play_rad: tuple[float, float]
    volts_V: tuple[float, float]


class UserController(Protocol):
    """What a class must have to be named as `controller` in a protocol."""

    def start(self, rig: Rig, period_s: float) -> None:
        """Prepare for a run; called once, before the table is armed. period_s: of the tick."""
        ...

    def control(self, now: Now) -> tuple[float, float]:
        """Return the volts (x, y) to command [V], or angles [rad] where the servos take an angle;
        called at every tick while the ball rolls.

        They pass `limits.limit` before they are applied. Whatever is raised, or is not two numbers,
        ends the run at 0 V.
        """
        ...

    def end(self, outcome: str) -> None:
        """Take note of how the run ended; called once, after the table is level at 0 V."""
        ...


class ControllerError(Exception):
    """A user controller failed; the message says in which method and line, and with what error."""


class WatchedController:
    """A user's controller, the calls of which are told: `called` gets "start", "control" or "end",
    and "" when it has returned or raised.
    """

    def __init__(self, controller: UserController, called: Callable[[str], None]) -> None:
        self.controller, self._called = controller, called

    def start(self, rig: Rig, period_s: float) -> None:
        """Call the controller's `start`."""
        with self.told("start"):
            self.controller.start(rig, period_s)

    def control(self, now: Now) -> tuple[float, float]:
        """Call the controller's `control`."""
        with self.told("control"):
            return self.controller.control(now)

    def end(self, outcome: str) -> None:
        """Call the controller's `end`."""
        with self.told("end"):
            self.controller.end(outcome)

    @contextmanager
    def told(self, method: str) -> Iterator[None]:
        """While inside, code of the controller's runs that belongs to this method."""
        self._called(method)
        try:
            yield
        finally:  # else what follows a failure, such as levelling, would be timed as its own
            self._called("")


def now(state, q, reading: np.ndarray, target: np.ndarray, applied: np.ndarray) -> Now:
    """Return what a user controller sees of the controller state.

    state, q: of `control.tick`; reading (READING_SIZE,), columns R_*; target (2,) [m]; applied
    (2,): volts applied since the last tick.
    """
    row = np.empty(SEEN_SIZE)
    fill_seen(row, state, q, reading, target, applied)
    t_s, *numbers = row.tolist()
    pairs = zip(numbers[::2], numbers[1::2], strict=True)
    return Now(t_s, **dict(zip(PAIRS, pairs, strict=True)))


def _failed(
    controller: Any, method: str, error: BaseException, seconds: float = WORDS_S
) -> ControllerError:
    """The error as the loop tells it; the words of a lab's own come within `seconds` or not."""
    told: Any = nullcontext()
    if isinstance(controller, WatchedController):
        controller, told = controller.controller, controller.told(method)
    name = f"controller {type(controller).__name__}.{method}"
    where, own = "", getattr(sys.modules.get(type(controller).__module__), "__file__", None)
    for frame in foreign_call.frames_of(error):  # the innermost line of the lab's own file
        if frame.filename == own:
            where = f", line {frame.lineno}"
    if isinstance(error, OvertimeError):
        return ControllerError(f"{name} {error}{where}")
    with told:
        words = in_words(error, seconds)
    return ControllerError(f"{name} failed{where}: {words}")


def start_controller(controller: UserController, rig: Rig, period_s: float) -> None:
    """Call the controller's `start`. ControllerError: it raised something or took too long."""
    try:
        with ForeignCall(START_S):
            controller.start(rig, period_s)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # whatever else a lab's code raises ends the run, not the rig
        raise _failed(controller, "start", error) from error


def command_volts(
    controller: UserController, seen: Now, out: np.ndarray, bounds: ForeignCall
) -> None:
    """Write the volts that the controller commands for the tick `seen` into `out` (2,).

    ControllerError: it raised something, broke the bounds or did not return two numbers; `out` is
    0 V then.
    """
    try:
        with bounds:
            out[0], out[1] = _two_numbers(controller.control(seen))
    except KeyboardInterrupt:
        out[:] = 0.0
        raise
    except BaseException as error:  # as above
        out[:] = 0.0
        words_s = min(bounds.seconds, WORDS_S)  # the table waits for its 0 V
        raise _failed(controller, "control", error, words_s) from error


def _two_numbers(volts: Any) -> tuple[float, float]:
    """Two numbers of a sequence, whose order is meant: no text, set or mapping. TypeError,
    ValueError: they are not."""
    if isinstance(volts, str | bytes | bytearray | Set | Mapping):
        raise TypeError(f"two numbers are wanted, not {type(volts).__name__}")
    x, y = volts
    if isinstance(x, str | bytes) or isinstance(y, str | bytes):
        raise TypeError("two numbers are wanted, not text")
    return float(x), float(y)


def end_controller(controller: UserController, outcome: str) -> str:
    """Call the controller's `end`; return what failed in it as a sentence, "" where nothing did."""
    try:
        with ForeignCall(END_S):
            controller.end(outcome)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # the run is over: what it recorded must not be lost
        return str(_failed(controller, "end", error))
    return ""


def load_controller(name: str) -> UserController:
    """Return a new controller of the class that `name`, FILE.py:ClassName, tells.

    ValueError (one line): there is no such file, it or its class cannot be loaded, or a method is
    missing.
    """
    file, _, made = name.rpartition(":")
    path = Path(file)
    if not path.is_file():
        raise ValueError(f"controller file {path} not found: give it relative to the protocol file")
    spec = importlib.util.spec_from_file_location(f"own_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise ValueError(f"controller file {path} is no Python file: it must end in .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses and pickles look there
    try:
        with ForeignCall(START_S):
            spec.loader.exec_module(module)
            controller = getattr(module, made)()
            missing = [one for one in METHODS if not callable(getattr(controller, one, None))]
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # whatever is wrong in a lab's file is bad input
        raise ValueError(f"controller {path}:{made}: {in_words(error)}") from error
    if missing:
        raise ValueError(
            f"controller {path}:{made} lacks {', '.join(missing)}: it needs {', '.join(METHODS)}"
        )
    return controller
