"""Does a test notice when the firmware's safety is changed? Mutants of its files, one by one.

    python tests/benchmarks/hardware/firmware_mutants.py [FIRST [LAST]]

FIRST and LAST (numbers from 0, LAST not included) choose a piece of the whole. Each mutant changes
one operator or number in the functions that decide about volts or pulses; it dies when a test of
`test_board.py` or `test_pulse_board.py` fails, or when it hangs or crashes. Prints those that live;
exit code 1 where there are any that are not known to change nothing.
"""

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import partial
from itertools import product
from math import inf
from pathlib import Path
from types import ModuleType

from tests.rig.hardware.board import test_board, test_pulse_board
from tests.support import ROOT
from tests.support.boards import host as board_host

FIRMWARE = ROOT / "rig/firmware"
# By file: the functions that decide, the tests that should notice.
FILES = {
    "protocol.c": (("take_config", "take_arm", "take_command", "watch"), test_board),
    "volts.c": (
        ("kind_config", "kind_command", "measure_speed", "most_mV", "guarded_mV", "has_moved",
         "stalled", "guard", "keep_catching", "wish_mV", "apply"),
        test_board,
    ),
    "pulses.c": (
        ("pulse_of", "in_range", "take_servo", "kind_config", "kind_tick"),
        test_pulse_board,
    ),
}  # fmt: skip
SWAPS = {
    "<=": "<", ">=": ">", "==": "!=", "!=": "==", "&&": "||", "||": "&&", " < ": " <= ",
    " > ": " >= ", " + ": " - ", " - ": " + ", " & ": " | ", " ? ": " ? !!", "++": "--", "|=": "&=",
}  # fmt: skip
TOKENS = re.compile(
    r"<=|>=|==|!=|&&|\|\||\+\+|\|=| [<>+\-&?] |\b\d+\b|\b[A-Z]+_MS\b|\b[A-Z_]+_MV\b"
)
LONGEST_S = 60
# Changes that change nothing that anybody could see, each with its reason.
EQUIVALENT = {
    # Nothing turned is no half us either way; a urad is none; true is true.
    "return servo->level + (turned + (turned[< -> <=]0 ? -25000 : 25000)) / 50000;",
    "return servo->level + (turned + (turned < [0 -> 1] ? -25000 : 25000)) / 50000;",
    "b->at_urad[i] = [0 -> 1];",
    "return [1 -> 2];",
    "if (b->limit_mV[> -> >=]LIMIT_MV) b->limit_mV = LIMIT_MV;",  # equal stays equal
    "if (b->angle_limit[> -> >=]most) b->angle_limit = most;",  # the same
    # What is at a bound is that bound; 8192/tau is never 2049, and with 8193 the same below 2.7 s.
    "if (b->lag_share[> -> >=]2048) b->lag_share = 2048;",
    "if (b->lag_share > [2048 -> 2049]) b->lag_share = 2048;",
    "if (b->lag_share > 2048) b->lag_share = [2048 -> 2049];",  # a part in 2048, lost in rounding
    "if (b->lag_share[< -> <=]1) b->lag_share = 1;",
    "if (b->lag_share < [1 -> 2]) b->lag_share = 1;",
    "b->lag_share = (int16_t)([8192 -> 8193] / b->time_constant_ms);",
    "if (b->moved[< -> <=]MOVED_COUNTS) b->moved = MOVED_COUNTS;",
    # Of a limit of 1 mV at most.
    "b->free_gain = least(256L * 256 / LAG_PARTS * b->top_speed / larger(b->limit_mV, [1 -> 2]), 1000000L);",  # noqa: E501
    # Each arm in every second tick, whichever is first.
    "uint8_t is_still = (b->past_at & 1) [== -> !=] e && still(b, e); /* in turn: a tick is short */",  # noqa: E501
    # The short cut leaves room by far: its way to rest is the whole law's times 3 or more.
    "stop = (int32_t)((uint32_t)w * b->time_constant_ms / [256 -> 257]); /* or less: no slow division */",  # noqa: E501
    "if (room - [1 -> 2] - stop >= b->taper) return b->limit_mV;",
    "if (room - 1 - stop [>= -> >] b->taper) return b->limit_mV;",
    # At the taper's ends the proportion is the whole limit.
    "if (room [>= -> >] b->taper) return b->limit_mV;",
    "if (room [<= -> <] -b->taper) return -(int32_t)b->limit_mV;",
    "return wish[> -> >=]-most ? wish : -most;",  # the same
    # The shift of a number that only has to be hard to guess, and what keeps it from being 0.
    "s->token = next_token(s->token ^ s->clock_us ^ ((uint32_t)s->nonce << [16 -> 17])) | 1;",
    "s->token = next_token(s->token ^ s->clock_us ^ ((uint32_t)s->nonce << 16)) | [1 -> 2];",
    "s->since_telemetry_ms = [0 -> 1];",  # the first telemetry a millisecond sooner
    # A millisecond of braking more.
    "b->catch_ms = [0 -> 1];",
    "b->catch_ms = [0 -> 1]; /* its braking failed, or the encoder jumps: gently then */",
    # A sign only has to differ from the other's, and from zero.
    "int8_t sign = (int8_t)(v >= STALL_MV[? -> ? !!]1 : v <= -STALL_MV ? -1 : 0);",
    "int8_t sign = (int8_t)(v >= STALL_MV ? [1 -> 2] : v <= -STALL_MV ? -1 : 0);",
    "int8_t sign = (int8_t)(v >= STALL_MV ? 1 : v <= -STALL_MV ? -[1 -> 2] : 0);",
}


def bodies(file: str, text: str) -> Iterator[tuple[int, int]]:
    """Where the functions that decide begin and end."""
    for name in FILES[file][0]:
        found = re.search(rf"^(?:static )?\w+ {name}\(", text, re.M)
        assert found, name
        yield text.index("{", found.start()), text.index("\n}", found.start())


def mutants(file: str, text: str) -> Iterator[tuple[str, int, str, str]]:
    """(file, line, what it was, the whole mutated text)."""
    for begin, end in bodies(file, text):
        for token in TOKENS.finditer(text, begin, end):
            line_begin = text.rfind("\n", 0, token.start()) + 1
            line = text[line_begin : text.index("\n", token.start())]
            if (
                is_idle(line, token.start() - line_begin)
                or "payload" in line
                or "get16(p" in line
                or "get32(p" in line
            ):
                continue
            was = token.group()
            now = SWAPS.get(was) or (str(int(was) + 1) if was.isdigit() else f"({was} + 2)")
            changed = text[: token.start()] + now + text[token.end() :]
            at = token.start() - line_begin
            shown = f"{line[:at]}[{was.strip()} -> {now.strip()}]{line[at + len(was) :]}".strip()
            yield file, text.count("\n", 0, token.start()) + 1, shown, changed


def is_idle(line: str, at: int) -> bool:
    """A comment, a loop's head, a flag that only has to be true: changes there say nothing."""
    comment = line.find("/*")
    return (
        "for (" in line
        or line.lstrip().startswith("* ")
        or 0 <= comment < at
        or (line[:at].endswith(" = ") and line[at] == "1")
    )


def cases(tests: ModuleType) -> Iterator:
    """The tests of a board, as calls: of test_board those before the wiring's."""
    last = inf
    if tests is test_board:
        last = tests.test_wiring_goes_there_and_back.hypothesis.inner_test.__code__.co_firstlineno
    for name, function in vars(tests).items():
        if not name.startswith("test_") or function.__code__.co_filename != tests.__file__:
            continue
        if function.__code__.co_firstlineno > last:
            continue
        marks = [m for m in getattr(function, "pytestmark", []) if m.name == "parametrize"]
        ways = [
            [(value,) if isinstance(mark.args[0], str) else value for value in mark.args[1]]
            for mark in marks
        ]
        for way in product(*ways):  # marks nearest to the function come first, as its arguments do
            names = [n for mark in marks for n in _names(mark.args[0])]
            yield partial(function, **dict(zip(names, sum(way, ()), strict=True)))


def _names(given) -> list[str]:
    return [given] if isinstance(given, str) else list(given)


def dies(source: str, text: str) -> bool:
    """Runs the tests on a mutant in a process of its own."""
    child = os.fork()
    if child == 0:
        signal.alarm(LONGEST_S)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        try:
            with tempfile.TemporaryDirectory() as folder:
                for file in FIRMWARE.glob("*.[ch]"):
                    (Path(folder) / file.name).write_bytes(file.read_bytes())
                (Path(folder) / source).write_text(text)
                board_host.FIRMWARE = Path(folder)
                board_host.library.cache_clear()
                board_host._BUILT = tempfile.TemporaryDirectory()
                for kind in ("volts", "pulses"):
                    board_host.library(kind)
            for case in cases(FILES[source][1]):
                case()
        except subprocess.CalledProcessError:
            os._exit(2)  # does not compile: no mutant
        except BaseException:
            os._exit(1)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) != 0


def piece_of(words: list[str], count: int) -> tuple[int, int]:
    first, last = [*map(int, words), *(0, count)[len(words) :]]
    return first, last


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("piece", type=int, nargs="*", help="FIRST [LAST]")
    asked = parser.parse_args().piece
    begin, texts = time.monotonic(), {file: (FIRMWARE / file).read_text() for file in FILES}
    for tests in (test_board, test_pulse_board):
        for case in cases(tests):  # here, so that every child finds the plant compiled
            case()
    for file, text in texts.items():
        assert not dies(file, text), "the unchanged firmware must pass"
    every = [mutant for file, text in texts.items() for mutant in mutants(file, text)]
    known = {shown for _, _, shown, _ in every}
    assert known >= EQUIVALENT, f"no mutants any more: {EQUIVALENT - known}"
    piece, alive = every[slice(*piece_of(asked, len(every)))], []
    for file, line, shown, changed in piece:
        if not dies(file, changed) and shown not in EQUIVALENT:
            alive.append((file, line, shown))
            print(f"alive: {file}, line {line}: {shown}", flush=True)
    idle = sum(shown in EQUIVALENT for _, _, shown, _ in piece)
    print(f"{len(piece)} of {len(every)} mutants, {idle} known to change nothing, ", end="")
    print(f"{len(alive)} alive; ", end="")
    print(f"{time.monotonic() - begin:.0f} s")
    return int(bool(alive))


if __name__ == "__main__":
    sys.exit(main())
