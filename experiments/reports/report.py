"""Self-contained HTML pages: sections of text, code, pictures (embedded) and tables.

Every page is a Jinja template that extends `templates/base.html`; all share `style.css`.
"""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from math import degrees, isfinite, nan
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader

from experiments.analysis.metrics import NUMBERS_TOLD
from experiments.reports.program import PROGRAM, program_words
from experiments.reports.units import unbroken
from rig.files import upright, write_ours

DOTS_IN = 150  # of figures, per inch
SHEET_IN = 7.3  # between the margins of a sheet of A4
LARGE_IN = 6.0  # of figures; chosen: 9 points are 7 pixels of a phone's 360


@dataclass(frozen=True)
class Picture:
    """A picture of a page: its PNG file, and a caption that says what to see in it.

    png: the file's content in base64, as it was when the picture was made: another program that
    writes into the folder may replace it before the page is written. OSError: it cannot be read.
    """

    path: Path
    caption: str
    png: str = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "png", base64.b64encode(self.path.read_bytes()).decode())

    @property
    def large(self) -> bool:
        """Whether a phone's width would leave its letters too small."""
        return self.wide_in > LARGE_IN

    @property
    def whole_sheet(self) -> bool:
        """Whether a sheet's width makes its letters smaller: then it has all of the height, too."""
        return self.wide_in > SHEET_IN

    @property
    def wide_in(self) -> float:
        """Width [in] for which its letters were chosen."""
        header = base64.b64decode(self.png[:32])  # of a PNG, whose width stands in bytes 16 to 19
        return round(int.from_bytes(header[16:20], "big") / DOTS_IN, 2)


@dataclass(frozen=True)
class Pictures:
    """Pictures side by side where the page is wide enough; wide: one below the other, each as wide
    as the page; beside: a third one stands beside the two others, as high as both.
    """

    pictures: Sequence[Picture]
    wide: bool = False
    beside: bool = False


@dataclass(frozen=True)
class Code:
    """Text shown as code: what is typed or stands in a file."""

    code: str


@dataclass(frozen=True)
class Table:
    """A table of a page; the first `words` columns hold text, the others numbers.

    marks: style of a row by its index: "strong", "holds", "fails" or "undecided"; folded: shown
    when it is opened, and then sorted and filtered by who reads it (on paper as it is).
    """

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    words: int = 1
    marks: Mapping[int, str] = field(default_factory=dict)
    folded: bool = False

    @property
    def has_blanks(self) -> bool:
        """Whether a cell, or a part of one, is "-"."""
        return any(part == "-" for row in self.rows for cell in row for part in cell.split(", "))


Block = str | Code | Pictures | Table  # str: a paragraph


@dataclass(frozen=True)
class Section:
    """A titled part of a page.

    question: what the section answers, shown under its title; ran False: shown in grey, for work
    that was not done.
    """

    title: str
    blocks: Sequence[Block]
    question: str = ""
    ran: bool = True


def write_page(
    path: Path,
    *,
    title: str,
    summary: Sequence[str],
    sections: Sequence[Section],
    template: str = "base.html",
    **content: Any,
) -> Path:
    """Render a page to `path` and return the path.

    title: of the page; summary: sentences of the head; template: a file of `templates/`; content:
    the template's other variables; `source` is shown beside the title of base.html, `answer` below
    it, `made` replaces when and with what version the page was made, `numbered` = True numbers the
    sections. A page of that name that no command here has made is kept as NAME.1, NAME.2 ...
    OSError: the page cannot be written, or a picture of it cannot be read.
    """
    loader = PackageLoader("experiments.reports")
    pages = Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    pages.filters["unbroken"] = unbroken
    content = {"made": made_words()} | content
    sorts = any(isinstance(b, Table) and b.folded for one in sections for b in one.blocks)
    text = pages.get_template(template).render(
        title=title, summary=summary, sections=sections, sorts=sorts, **content
    )
    # Names of files need not be text.
    write_ours(path, upright(text).encode(errors="replace"), PROGRAM.encode())
    return path


def made_words(*more: str) -> str:
    """When a page is made, with what version, and what `more` there is to know of its numbers."""
    now = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    return ". ".join((f"Made on {now} by {program_words()}", *filter(None, more))) + "."


def recompute_section(how: str, command: str = "") -> Section:
    """A section of a page, *How to recompute*: in words, and the commands to type, a line each,
    which `uv run` finds in any folder of the checkout.
    """
    typed = "\n".join(f"uv run {line}" for line in command.splitlines())
    return Section("How to recompute", [*filter(None, (how,)), *([Code(typed)] if typed else [])])


SETTLED_PART = (
    "Settled: after settling; of a run that never settled, or whose target moves to its end, in "
    "its last half."
)
SETTLED = f"{SETTLED_PART} {NUMBERS_TOLD}"
# Runs without play compensation stand before those with it, in tables and figures alike.
ORDER = "without", "with"
RUN_HEAD = (
    "run",
    "run folder",
    "outcome",
    "length [s]",
    "centroid (x, y) [cm]",
    "centroid's distance [cm]",
    "settling [s]",
    "settled distance, RMS [cm]",
    "settled spread [cm] [95 %]",
    "limit cycle x, y [cm]",
    "period x, y [s]",
    "settled servo about 0, RMS x, y [deg]",
    "settled servo - desired, RMS x, y [deg]",
    "pushes",
)


def run_row(name: str, numbers: dict) -> list[str]:
    """Cells of one run's row in a table with the head RUN_HEAD; name: the first cell.

    numbers: as of `experiments.analysis.numbers.run_numbers`.
    """
    settled, cycle = numbers["settled"], numbers["limit_cycle"]
    moves = numbers["target_moves"]
    centroid = ", ".join(f"{v:+.3f}" for v in numbers["centroid_cm"])
    never = "the target moves" if moves else "never"
    settling = number(numbers["settling_s"], 1) if settled["has_settled"] else never
    return [
        name,
        numbers["folder"],
        numbers["outcome"],
        f"{numbers['duration_s']:.1f}",
        *(("-", "-") if moves else (centroid, number(numbers["distance_cm"]))),
        settling,
        number(settled["error_rms_cm"]),
        "-" if moves else _spread(settled),
        _amplitudes(cycle),
        ", ".join(number(cycle[a]["period_s"], 2) for a in "xy"),
        ", ".join(number(_degrees(v), 2) for v in settled["servo_rms_rad"]),
        ", ".join(number(_degrees(v), 2) for v in settled["servo_tracking_rad"]),
        "not recorded" if numbers["pushes"] is None else str(numbers["pushes"]),
    ]


def _degrees(value: float | None) -> float:
    return nan if value is None else degrees(value)


def _spread(settled: dict) -> str:
    """Spread [cm] of the settled part, and its interval where there is one."""
    ends = settled.get("spread_interval_cm")
    interval = f" [{number(ends[0], 2)}, {number(ends[1], 2)}]" if ends else ""
    return number(settled["spread_cm"]) + interval


def _amplitudes(cycle: dict) -> str:
    """Amplitudes [cm] of both axes' limit cycles; where neither is known, why once."""
    found = [number(cycle[a]["amplitude_cm"], 2) for a in "xy"]
    if any(words != "-" for words in found):
        return ", ".join(found)
    return max(cycle.values(), key=lambda one: one["cycles"])["reason"]


def number(value: float, digits: int = 3) -> str:
    """`value` with so many `digits` behind the point; "-" for None, NaN or infinity."""
    return f"{value:.{digits}f}" if value is not None and isfinite(value) else "-"
