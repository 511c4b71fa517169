"""Files of anybody: read within bounds, checked by a strict pydantic model, with one line about
what is wrong in one; and written whole or not at all.
"""

import json
import os
import re
import secrets
import stat
import tomllib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from itertools import count
from math import inf
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, BinaryIO, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ValidationError

LONGEST = 1 << 24  # bytes; chosen: a hundred times the longest answer or record of a run
BLOCK = 512  # bytes, in which a system counts what is on the disk
HOLE_SHARE = 0.02  # chosen: what compresses to less holds no measurement
STEP = 1 << 16  # bytes by which a file that grows is read; chosen: 200 rows of a run
LONGEST_TOML = 1 << 20  # bytes; chosen: a hundred times a long rig file
# Ends of names and their units, which are told with a limit; the first that fits, so the longest.
_UNITS = {
    "rad_s_V": "rad/s/V",
    "rad_m_s": "rad/m/s",
    "rad_s2": "rad/s2",
    "rad_s": "rad/s",
    "nm_s": "N m s",
    "m_s2": "m/s2",
    "m_s": "m/s",
    "1_s": "1/s",
    "nm": "N m",
    "hz": "Hz",
    "rad": "rad",
    "kg": "kg",
    "m": "m",
    "s": "s",
    "V": "V",
}
_LIMITS = ("less_than", "less_than_equal", "greater_than", "greater_than_equal")
# A pipe that nobody writes to would be waited for, before one could see that it is a pipe.
READS = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)


class StrictModel(BaseModel):
    """Base model of a file's records: unknown keys, infinite and undefined numbers are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def first_error_line(
    error: ValidationError, model: type[BaseModel] | None = None, *, within: str = ""
) -> str:
    """Return one line about the first fault in a file; unknown keys come before all other faults.

        unknown key 'start.z'; known: x_m, y_m
        key 'title' is missing; known: title, duration_s
        duration_s = -3: Input should be greater than 0.1
        side_m = 275: Input should be less than or equal to 5 m

    error: of pydantic's validation; model: of the whole file, by which the known keys are listed;
    within: name of the section that was validated, where it was not the whole file.
    """
    fault = min(error.errors(), key=lambda one: one["type"] != "extra_forbidden")
    where = ".".join(str(part) for part in (*([within] if within else []), *fault["loc"]))
    names = _known_keys(model, fault["loc"][:-1])
    if fault["type"] == "extra_forbidden":
        known = f"; {known_names(str(fault['loc'][-1]), names)}" if names else ""
        return f"unknown key '{where}'{known}"
    if fault["type"] == "missing":
        known = f"; known: {', '.join(names)}" if names else ""
        return f"key '{where}' is missing{known}"
    cause = fault.get("ctx", {}).get("error")
    if isinstance(cause, ValueError):  # of a check of ours, which names the key itself
        return str(cause)
    given = fault["input"]
    if isinstance(given, str | int | float):
        unit = next((u for end, u in _UNITS.items() if where.endswith(f"_{end}")), "")
        unit = unit if fault["type"] in _LIMITS else ""
        return f"{where} = {given!r}: {fault['msg']} {unit}".rstrip()
    return f"{where}: {fault['msg']}" if where else str(fault["msg"])


def known_names(name: object, known: Iterable[str]) -> str:
    """Words on a `name` that is none of the `known` ones: those, and which of them it may be.

    known: gear_ratio, friction_V; did you mean 'gear_ratio'?
    """
    names = list(known)
    near = get_close_matches(str(name), names, n=1)
    asked = f"; did you mean '{near[0]}'?" if near else ""
    return f"known: {', '.join(names)}{asked}"


def _known_keys(kind: Any, place: tuple[int | str, ...]) -> list[str]:
    """Keys of the model at a place of a nested one; none where its types do not tell."""
    for part in place:
        fields = getattr(kind, "model_fields", None)
        if fields is not None:
            kind = fields[part].annotation if part in fields else None
        else:  # list[kind], dict[str, kind]
            kind = (get_args(kind) or (None,))[-1]
        if get_origin(kind) in (Union, UnionType):
            kind = next(one for one in get_args(kind) if one is not NoneType)
    return list(getattr(kind, "model_fields", {}))


def printable(text: object) -> str:
    """Return a text from elsewhere (a file, its name, an error) as one line of printable
    characters, with "?" for others: it can steer no terminal, and stands in any file as it is.
    """
    return "".join(c if c.isprintable() else "?" for c in " ".join(str(text).split()))


def as_unicode(text: object) -> str:
    """The text with "?" for what is no Unicode (half a surrogate pair, as in names of files that
    are no UTF-8): no page could show it, and no reader takes a record that holds it.
    """
    return str(text).encode("utf-8", "replace").decode()


_TURNING = re.compile("[\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]")


def upright(text: str) -> str:
    """Return a text with "?" for characters that are not seen and turn those beside them, so that
    on a page a name from elsewhere reads as what it is (Unicode's bidirectional formats).
    """
    return _TURNING.sub("?", text)


LARGEST = 2**63  # of whole numbers in a TOML file, as TOML itself bounds them
MOST_DIGITS = 300  # of a whole number in a JSON file, so that a float can hold it
# (Lines + dots) x dots of one line: `tomllib` keeps a.b.c.d with all its beginnings, and takes a
# key below [a.b.c.d] apart anew. Chosen: below a second and 100 MB; rig files have some thousands.
MOST_PARTS = 10**7


def read_toml(text: str) -> dict[str, Any]:
    """Return the data of a TOML document. ValueError (one line): it is none, or beyond measure."""
    lines = text.split("\n")
    if (len(lines) + text.count(".")) * max(line.count(".") for line in lines) > MOST_PARTS:
        raise ValueError("not a TOML file (its dotted keys are too many and too long)")
    try:
        data = tomllib.loads(text)
        _check_sizes(data)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"not a TOML file ({error})") from None
    except RecursionError:
        raise ValueError("not a TOML file (its brackets or dotted keys are too deep)") from None
    except _BeyondError:
        raise ValueError("not a TOML file (a whole number is beyond 64 bits)") from None
    except ValueError:  # of Python's own limit of digits
        raise ValueError("not a TOML file (a number has too many digits)") from None
    return data


def read_json(text: str) -> Any:
    """Return the data of a JSON document. ValueError (one line): it is none, its brackets are too
    deep, a whole number in it has too many digits, or it holds text that is no Unicode (half a
    surrogate pair), which nobody could show.
    """
    try:
        data = json.loads(text, parse_int=_whole_number)
        json.dumps(data, ensure_ascii=False).encode()
    except RecursionError:
        raise ValueError("not a JSON file (its brackets are too deep)") from None
    except UnicodeEncodeError:
        raise ValueError("not a JSON file (a text in it is no Unicode)") from None
    except ValueError as error:
        raise ValueError(f"not a JSON file ({error})") from None
    return data


def _whole_number(digits: str) -> int:
    if len(digits) > MOST_DIGITS:
        raise ValueError("a number has too many digits")
    return int(digits)


class _BeyondError(ValueError):
    """A whole number is larger than a TOML file may hold."""


def _check_sizes(value: Any) -> None:
    if isinstance(value, int):
        if abs(value) >= LARGEST:
            raise _BeyondError
        return
    for item in value.values() if isinstance(value, dict) else value:
        if isinstance(item, dict | list | int):
            _check_sizes(item)


def file_bytes(path: Path, longest: int | None = LONGEST) -> bytes:
    """Return the content of a file, of at most `longest` bytes (None: of any length).

    What is looked at is what is then read, so that nobody exchanges it in between. ValueError (one
    line, without the path): a folder, a pipe or a device, longer, or mostly a hole. OSError: it
    cannot be read.
    """
    handle = os.open(path, READS)
    try:
        about = os.fstat(handle)
        if not stat.S_ISREG(about.st_mode):
            raise ValueError("no file, but a folder, a pipe or a device")
        if longest is not None and about.st_size > longest:
            raise ValueError(f"longer than {longest} bytes")
        on_disk = BLOCK * getattr(about, "st_blocks", inf)  # not everywhere told
        if about.st_size > LONGEST and on_disk < HOLE_SHARE * about.st_size:
            raise ValueError(f"of its {about.st_size} bytes {on_disk} are on the disk: a hole")
        with os.fdopen(handle, "rb", closefd=False) as file:
            data = file.read() if longest is None else _read(file, about.st_size, longest + 1)
    finally:
        os.close(handle)
    if longest is not None and len(data) > longest:  # it grew, or is one of the system's own
        raise ValueError(f"longer than {longest} bytes")
    return data


def _read(file: BinaryIO, size: int, most: int) -> bytes:
    """Read a file of `size` bytes, or more where it grew, to `most` bytes.

    Memory is taken for as many as are asked for, whether they are there or not.
    """
    parts, ask = [], size + 1
    while most > 0 and (part := file.read(min(ask, most))):
        parts.append(part)
        most -= len(part)
        ask = STEP
    return b"".join(parts)


def file_text(path: Path, longest: int = LONGEST) -> str:
    """Return the text (UTF-8) of a file; errors as of `file_bytes`. ValueError: no UTF-8, too."""
    try:
        return file_bytes(path, longest).decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        raise ValueError(f"no text in UTF-8 ({error.reason} at byte {error.start})") from None


def why_no_file(path: Path) -> str:
    """Why nothing can be read there, in words: it is missing, or a folder, a pipe or a device."""
    return "is no ordinary file" if path.exists() else "not found"


def toml_of(path: Path) -> dict[str, Any]:
    """Return the data of a TOML file, with an editor's byte order mark or without; errors as of
    `file_text` and `read_toml`."""
    return read_toml(file_text(path, LONGEST_TOML).removeprefix("\ufeff"))


def json_of(path: Path, longest: int = LONGEST) -> Any:
    """Return the data of a JSON file, with an editor's byte order mark or without; errors as of
    `file_text` and `read_json`."""
    return read_json(file_text(path, longest).removeprefix("\ufeff"))


def write_whole(
    path: Path, content: bytes, *, sync: bool = False, room: Path | None = None
) -> None:
    """Write a new file beside `path` and put it in its place. Of two programs that do so at once
    the later one's stands, whole.

    sync: wait until the disk has it; room: a file beside it whose room was reserved, and is used up
    where it is there. OSError: the old file stays.
    """
    part, mode = part_of(path), "xb"
    if room is not None and not room.is_dir() and freed(room).exists():
        part, mode = room, "r+b"
    try:
        with naming(path):
            with part.open(mode) as file:
                file.write(content)
                file.truncate()
                if sync:
                    file.flush()
                    os.fsync(file.fileno())
            part.replace(path)
    except BaseException:
        with suppress(OSError):
            part.unlink()
        raise


def write_ours(path: Path, content: bytes, mark: bytes) -> None:
    """`write_whole` a file that bears `mark`. One of its name without it is somebody's, and is kept
    as NAME.1, NAME.2 ...; OSError: it cannot be written.
    """
    try:
        ours = mark in file_bytes(path)
    except FileNotFoundError:
        ours = True
    except ValueError:  # a pipe, or too long to be ours
        ours = False
    with naming(path):
        part = part_of(path)
        write_whole(part, content)
        if not ours:
            put_aside(path)
        part.replace(path)


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Have an OSError from within that names no file, or a part of `path`, name `path`: of a full
    disk the system names none, and which disk it is has to be known."""
    try:
        yield
    except OSError as error:
        if str(error.filename or path).startswith(str(path)):
            error.filename = str(path)
        raise


def part_of(path: Path) -> Path:
    """Return where a file is written before it takes the place of `path`: a name of its own, that
    no other file has.
    """
    return path.with_name(f"{path.name}.{secrets.token_hex(4)}.part")


def put_aside(path: Path) -> None:
    """Rename a file to NAME.1, or NAME.2 ... where that is taken: it may be somebody's."""
    numbered = (path.with_name(f"{path.name}.{i}") for i in count(1))
    path.rename(next(one for one in numbered if not os.path.lexists(one)))


def freed(path: Path) -> Path:
    """Return `path`, where a file can then be written.

    In somebody else's folder a link may lie there, which leads to any file, a second name of one,
    or a pipe: it is removed. OSError: a folder lies there, which is kept.
    """
    with suppress(FileNotFoundError):
        about = path.lstat()
        if not (stat.S_ISREG(about.st_mode) and about.st_nlink == 1):
            path.unlink()
    return path
