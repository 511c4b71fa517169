"""The files of a ROS 2 bag's folder: which belong to it, and that they are of one recording."""

import re
from collections.abc import Sequence
from itertools import groupby
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

from experiments.importing.recording import BadFileError
from rig.files import printable

INDEX_FILE, LONGEST_INDEX = "metadata.yaml", 1 << 20  # characters; of some kB usually
# Of two files of a topic. Chosen: ROS 2 begins a bag's next file where the last one ends, but for
# messages that waited meanwhile.
OVERLAP_NS = 500_000_000
PACKED = ".zstd"


class Span(NamedTuple):
    """A topic's messages in one file: when the first and the last were written [ns]."""

    topic: str
    file: str
    first_ns: int
    last_ns: int


def extremes(stamps_ns: Sequence[int]) -> tuple[int, int]:
    """The first and the last of some stamps."""
    return min(stamps_ns), max(stamps_ns)


def is_bag(folder: Path) -> bool:
    """Whether a folder is a bag's, whole or not, readable here or not."""
    kinds = (INDEX_FILE, "*.mcap", f"*.mcap{PACKED}", "*.db3", f"*.db3{PACKED}")
    return any(any(folder.glob(kind)) for kind in kinds)


def bag_files(folder: Path) -> tuple[list[Path], list[str]]:
    """The MCAP files of a bag's folder, and notes on those that its metadata.yaml names and that
    are missing. BadFileError: there is none, or one that metadata.yaml does not name.
    """
    files = sorted(folder.glob("*.mcap"))
    if not files:
        raise BadFileError(
            "a bag is read as MCAP: ros2 bag convert makes one of .db3 files, zstd -d unpacks one"
        )
    named = _named(folder / INDEX_FILE)
    if named is None:
        return files, []
    there = {file.name for file in files}
    if others := sorted(there - {name.removesuffix(PACKED) for name in named}):
        raise BadFileError(f"{others[0]} is no file of this bag: {INDEX_FILE} does not name it")
    missing = [name for name in named if name.removesuffix(PACKED) not in there]
    return files, [f"{printable(name)} of the bag is missing" for name in missing]


def _named(path: Path) -> list[str] | None:
    """The files that a bag's metadata names; None where there is no such list."""
    if not path.is_file():
        return None
    with path.open(encoding="utf-8", errors="replace") as file:
        text = file.read(LONGEST_INDEX)
    found = re.search(r"^ *relative_file_paths:[ \t]*\n((?:[ \t]*-[^\n]*\n?)+)", text, re.MULTILINE)
    if found is None:
        return None
    lines = (line.strip().removeprefix("-").strip() for line in found[1].splitlines())
    return [line.strip("\"'").rsplit("/", 1)[-1] for line in lines]


def check_spans(spans: Sequence[Span]) -> None:
    """BadFileError: files hold messages of one topic at the same time, as those of several
    recordings do, and copies.
    """
    for _, own in groupby(sorted(spans), key=attrgetter("topic")):
        in_time = sorted(own, key=attrgetter("first_ns"))
        last = in_time[0]
        for span in in_time[1:]:
            common_ns = min(last.last_ns, span.last_ns) - span.first_ns
            if common_ns > min(OVERLAP_NS, (span.last_ns - span.first_ns) // 2):
                raise BadFileError(
                    f"{last.file} and {span.file} hold {span.topic} at the same time: copies, or "
                    "of two recordings; keep the files of one"
                )
            last = max(last, span, key=attrgetter("last_ns"))
