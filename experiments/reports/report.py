"""One self-contained HTML page: figures embedded, numbers with their intervals."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from math import isfinite
from pathlib import Path

from jinja2 import Environment


@dataclass(frozen=True)
class Shown:
    """A figure of a page: its PNG file and what a reader should see in it."""

    path: Path
    caption: str

    @property
    def png(self) -> str:
        return base64.b64encode(self.path.read_bytes()).decode()


@dataclass(frozen=True)
class Section:
    title: str
    lines: Sequence[str] = ()
    figures: Sequence[Shown] = ()
    head: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = field(default_factory=list)


def write_page(
    path: Path,
    *,
    title: str,
    source: str,
    summary: Sequence[str],
    sections: Sequence[Section],
    recompute: str,
    claims: Sequence[dict] = (),
) -> Path:
    """Render the page to `path`."""
    template = files("experiments") / "templates" / "page.html"
    page = Environment(autoescape=True).from_string(template.read_text(encoding="utf-8"))
    text = page.render(
        title=title,
        source=source,
        summary=summary,
        sections=sections,
        recompute=recompute,
        claims=claims,
    )
    path.write_text(text, encoding="utf-8")
    return path


RUN_HEAD = (
    "run",
    "run folder",
    "outcome",
    "T [s]",
    "centroid (x, y) [cm]",
    "distance [cm]",
    "settling [s]",
    "settled distance [cm]",
    "settled spread [cm] [95 %]",
    "limit cycle x, y [cm]",
    "period x, y [s]",
    "settled servo about 0 [rad]",
    "settled servo - desired [rad]",
    "pushes",
)


def run_row(name: str, numbers: dict) -> list[str]:
    """One run as a row of the table under RUN_HEAD."""
    settled, cycle = numbers["settled"], numbers["limit_cycle"]
    spread = numbers["settled"].get("spread_interval_cm")
    interval = f" [{number(spread[0], 2)}, {number(spread[1], 2)}]" if spread else ""
    return [
        name,
        numbers["folder"],
        numbers["outcome"],
        f"{numbers['duration_s']:.1f}",
        ", ".join(f"{v:+.3f}" for v in numbers["centroid_cm"]),
        number(numbers["distance_cm"]),
        number(numbers["settling_s"], 1) if settled["has_settled"] else "never (last half used)",
        number(settled["distance_cm"]),
        number(settled["spread_cm"]) + interval,
        ", ".join(number(cycle[a]["amplitude_cm"], 2) for a in "xy"),
        ", ".join(number(cycle[a]["period_s"], 2) for a in "xy"),
        ", ".join(number(v, 4) for v in settled["servo_rms_rad"]),
        ", ".join(number(v, 4) for v in settled["servo_tracking_rad"]),
        "-" if numbers["pushes"] is None else str(numbers["pushes"]),
    ]


def number(value: float, digits: int = 3) -> str:
    """A number for people; a dash where there is none."""
    return f"{value:.{digits}f}" if value is not None and isfinite(value) else "-"
