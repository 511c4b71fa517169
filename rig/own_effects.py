"""An effect of a lab's own: a Python file with one equation, named in the rig file.

The file holds `EFFECT`, an `Effect` as those of the catalogue, and the function `equation(u, v,
t_s, KEY, ...)`, whose arguments after the time bear the names of the effect's keys. On the servo's
side u, v are the servo's angle [rad] and rate [rad/s] and the answer is volts added at the motor;
on the ball's side its place [m] and speed [m/s] on the axis and the answer is an acceleration
[m/s2]. At the first parameter's null value the answer is 0.

A rig carries the file's text, so that another process finds the effect without the file. The text
is executed: it comes from a rig file that the operator names, never from a recording.
"""

import inspect
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import product
from math import isfinite
from pathlib import Path
from typing import Any

import numba

from rig.effects import BY_NAME, PER_AXIS, SHARED, VOLTS, Effect, Parameter
from rig.foreign_call import ForeignCall, OvertimeError
from rig.foreign_trial import Begins, on_trial

SLOTS = 4  # effects of one's own in a rig; chosen: as many as the plant's record holds
KEYS = 4  # numbers of one such effect; chosen as well
LARGEST_BYTES = 1 << 20  # of a file; chosen: an equation and its tables take far less
LONGEST_S = 20.0  # to execute the file, and to try its equation; chosen: as a controller's start
COMPILED_S = 120.0  # to compile it; chosen: ten times what a long equation takes when busy
GRACE_S = 1.0  # beyond it, until a trial that does not end itself is ended; chosen
SIDES = {"servo": "(angle_rad, speed_rad_s, t_s", "ball": "(position_m, speed_m_s, t_s"}
# States in which an equation is tried before it is used: to the stop, or to the rim, and faster
# than either ever moves.
TRIED = {
    "servo": ((-0.6, -0.1, 0.0, 0.1, 0.6), (-10.0, 0.0, 10.0), (0.0, 100.0)),
    "ball": ((-0.2, -0.05, 0.0, 0.05, 0.2), (-2.0, 0.0, 2.0), (0.0, 100.0)),
}


@dataclass(frozen=True)
class OwnEffect:
    """An effect of a lab's own, as a rig carries it: its file, and the file's text.

    It is executed where `effect` or `address` is first asked for, in every process anew.
    """

    file: str
    text: str

    @property
    def effect(self) -> Effect:
        """The entry beside those of the catalogue. ValueError (one line): see `read_effect`."""
        return _executed(self.file, self.text)[0]

    @property
    def address(self) -> int:
        """Where the compiled equation lies in this process; it means nothing in another one."""
        return _compiled(self.file, self.text).address


def read_effect(file: Path) -> OwnEffect:
    """Return the effect of a Python file, executed, compiled and tried.

    ValueError (one line that names the file): it is missing or cannot be executed, EFFECT or
    equation is missing or contradicts the other, or the equation cannot be compiled, raises, does
    not return, gives no finite number, or something else than 0 at the first parameter's null
    value. Its first use is a trial in a copy of this process, which it may hang, leave or crash
    (`foreign_trial`); time and memory of what Python executes are bounded here, too.
    """
    if file.exists() and not file.is_file():
        raise ValueError(f"effect file {file} is no file")
    if file.exists() and file.stat().st_size > LARGEST_BYTES:
        raise ValueError(f"effect file {file} is larger than {LARGEST_BYTES} bytes")
    try:
        own = OwnEffect(str(file), file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise ValueError(f"effect file {file} cannot be read: {why}") from None
    _tried(own)
    _executed(own.file, own.text)
    return own


@cache
def _tried(own: OwnEffect) -> None:
    """Try an effect once in a copy of this process. ValueError (one line): it is no good."""
    _wake_compiler()
    try:
        on_trial(partial(_try, own))
    except ValueError as error:
        if str(error).startswith("effect file "):
            raise
        raise _bad(own.file, str(error)) from None


@cache
def _wake_compiler() -> None:
    """Compile something here, so that no copy of this process has to load the compiler anew."""
    numba.cfunc(numba.float64(numba.float64))(_same)


def _same(x: float) -> float:
    return x


def catalogue_of(own: Iterable[OwnEffect]) -> dict[str, Effect]:
    """Return every effect of the catalogue and of one's own, by name.

    ValueError (one line): more than SLOTS of one's own, or two of one name.
    """
    found, own = dict(BY_NAME), tuple(own)
    if len(own) > SLOTS:
        raise ValueError(f"{len(own)} effects of one's own: a rig takes at most {SLOTS}")
    for one in own:
        if one.effect.name in found:
            raise ValueError(f"effect file {one.file}: '{one.effect.name}' is there already")
        found[one.effect.name] = one.effect
    return found


@cache
def _executed(file: str, text: str) -> tuple[Effect, Callable[..., float]]:
    """EFFECT and equation of a file's text, held against each other."""
    names: dict[str, Any] = {"__name__": "own_effect", "__file__": file}
    try:
        with ForeignCall(LONGEST_S):
            exec(compile(text, file, "exec"), names)
    except OvertimeError as error:
        raise _bad(file, f"it {error}") from None
    except (Exception, SystemExit) as error:
        raise _bad(file, f"{type(error).__name__}: {_line(error)}") from None
    effect, equation = names.get("EFFECT"), names.get("equation")
    if not isinstance(effect, Effect):
        raise _bad(file, "it has no EFFECT = Effect(...) (from rig import Effect, Parameter)")
    if not inspect.isfunction(equation):
        raise _bad(file, "it has no function equation")
    if wrong := _wrong_entry(effect):
        raise _bad(file, wrong)
    keys = [parameter.key for parameter in effect.parameters]
    arguments = list(inspect.signature(equation).parameters)
    if arguments[3:] != keys or len(arguments) < 3:
        wanted = f"equation{SIDES[effect.side]}, {', '.join(keys)})"
        raise _bad(file, f"equation takes ({', '.join(arguments)}); its keys ask for {wanted}")
    servos = VOLTS if effect.side == "servo" else effect.servos
    return replace(effect, servos=servos), equation


def _bad(file: str, why: str) -> ValueError:
    return ValueError(f"effect file {file}: {why}")


def _line(error: object) -> str:
    """What an error says, in one line of at most 300 characters."""
    return " ".join(str(error).split())[:300]


def _wrong_entry(effect: Effect) -> str:
    """What is wrong with an entry, in words; "" where nothing is."""
    name, parameters = effect.name, effect.parameters
    if not isinstance(name, str) or not re.fullmatch("[a-z][a-z0-9_]*", name) or name == "own":
        return f"name = {name!r}: write it in small letters, digits and _, and not 'own'"
    if name in BY_NAME:
        return f"'{name}' is a name of the catalogue (rig effects); choose another"
    if effect.side not in SIDES:
        return f"side = {effect.side!r}: must be 'servo' (volts) or 'ball' (m/s2)"
    if tuple(effect.axes) not in (PER_AXIS, SHARED):
        return f"axes = {effect.axes!r}: must be ('x', 'y'), or ('xy',) for one value of both"
    if not isinstance(effect.sentence, str) or not effect.sentence.strip():
        return "sentence: say in one what it is"
    if not isinstance(parameters, tuple) or not 1 <= len(parameters) <= KEYS:
        return f"parameters: must be a tuple of 1 to {KEYS} Parameter(...)"
    if wrong := next(filter(None, map(_wrong_parameter, parameters)), ""):
        return wrong
    if len({parameter.key for parameter in parameters}) < len(parameters):
        return "parameters: two have the same key"
    most = max(abs(parameters[0].low), abs(parameters[0].high))
    if not 0 < effect.tolerance < most:
        return (
            f"tolerance = {effect.tolerance}: must lie above 0 and below the range of "
            f"{parameters[0].key}; it is the size that a healthy rig may have"
        )
    return ""


def _wrong_parameter(one: Parameter) -> str:
    if not isinstance(one, Parameter) or not str(one.key).isidentifier():
        return f"parameters: {one!r} is no Parameter(key, null, unit, low, high)"
    numbers = (one.null, one.low, one.high)
    if not all(isinstance(n, int | float) and isfinite(n) for n in numbers):
        return f"{one.key}: null, low and high must be finite numbers"
    if not one.low < one.high or not one.low <= one.null <= one.high:
        return f"{one.key}: needs low <= null <= high and low < high, has {numbers}"
    return ""


@cache
def _compiled(file: str, text: str) -> Any:
    """The equation as a C function of u, v, t and KEYS numbers, kept for the process's life."""
    effect, equation = _executed(file, text)
    names = [f"p{i}" for i in range(KEYS)]
    given = ", ".join(["u", "v", "t", *names[: len(effect.parameters)]])
    made: dict[str, Any] = {"equation": numba.njit(error_model="numpy", nogil=True)(equation)}
    exec(f"def called(u, v, t, {', '.join(names)}):\n return float(equation({given}))", made)
    try:
        return numba.cfunc(numba.float64(*[numba.float64] * (3 + KEYS)))(made["called"])
    except Exception as error:
        said = _line(str(error).partition("File ")[0].rpartition("frontend)")[2])
        raise _bad(
            file,
            f"equation cannot be compiled by numba: {said}; it may call functions of math and "
            "numpy, and those of the file that are marked @numba.njit",
        ) from None


def _try(own: OwnEffect, begins: Begins) -> None:
    """Ask the equation for its answer all over its range. ValueError: it is no good."""
    begins("executed, it", LONGEST_S + GRACE_S)
    effect, equation = _executed(own.file, own.text)
    begins("equation, being compiled,", COMPILED_S)
    function, parameters = _compiled(own.file, own.text).ctypes, effect.parameters
    ends = [sorted({p.low, p.null, (p.low + p.high) / 2, p.high}) for p in parameters]
    where = ""
    begins("compiled, equation", LONGEST_S + GRACE_S)
    try:
        with ForeignCall(LONGEST_S):
            for state in product(*TRIED[effect.side]):
                for values in product(*ends):
                    where = f"equation{(*state, *values)}"
                    _try_once(own.file, equation, function, state, values, parameters)
    except OvertimeError as error:
        raise _bad(own.file, f"{where} {error} with those before it") from None


def _try_once(
    file: str,
    equation: Callable[..., float],
    function: Callable[..., float],
    state: Sequence[float],
    values: Sequence[float],
    parameters: Sequence[Parameter],
) -> None:
    where = f"equation{(*state, *values)}"
    try:
        equation(*state, *values)
    except ZeroDivisionError:
        pass  # compiled, it gives an infinite number
    except (Exception, SystemExit) as error:
        raise _bad(file, f"{where} raises {type(error).__name__}: {_line(error)}") from None
    answer = function(*state, *values, *[0.0] * (KEYS - len(values)))
    if not isfinite(answer):
        raise _bad(file, f"{where} gives {answer}: it must give a finite number in its whole range")
    if values[0] == parameters[0].null and answer != 0.0:
        first = parameters[0]
        raise _bad(
            file,
            f"{where} gives {answer:g}: at {first.key} = {first.null:g}, its null value, it "
            "must give 0",
        )
