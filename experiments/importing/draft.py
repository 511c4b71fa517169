"""A map while it is being found: what is settled, why, and what is in doubt."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from experiments.importing.import_map import ImportMap, Stated, validated
from experiments.importing.names import Hint
from experiments.importing.recording import Stream
from experiments.importing.units import family


@dataclass(frozen=True)
class Doubt:
    """One thing that the recording does not say. place: `ball_x_m`, `ball` or `time`; key: of the
    map; why: in words; options: what it may be, the likeliest first, none where it is a number."""

    place: str
    key: str
    why: str
    options: tuple[str, ...] = ()

    @property
    def option(self) -> str:
        """How it is stated on the command line."""
        values = " or ".join(self.options) if self.options else "NUMBER"
        return f"--set {self.place}.{self.key}={values}"


@dataclass(eq=False)
class Draft:
    """The map so far. signals: column of the log -> keys of its SignalMap; reasons: by line of the
    report (`time`, `ball`, `angle`, `drive`, `rest`); seconds: the unrolled time (n,)."""

    stream: Stream
    hints: Mapping[str, Hint]
    said: Stated
    time: dict[str, Any] = field(default_factory=dict)
    signals: dict[str, dict[str, Any]] = field(default_factory=dict)
    reasons: dict[str, list[str]] = field(default_factory=dict)
    doubts: list[Doubt] = field(default_factory=list)
    seconds: np.ndarray = field(default_factory=lambda: np.empty(0))

    def settle(self, name: str, **keys: Any) -> None:
        """Give a signal keys; what was stated wins."""
        self.signals.setdefault(name, {}).update(keys)
        self.signals[name].update(self.said.get(name, {}))

    def is_said(self, name: str, key: str) -> bool:
        """Whether the user stated this key."""
        return key in self.said.get(name, {})

    def doubt(self, names: list[str], key: str, why: str, *options: str) -> None:
        """Ask for a key of the signals `names` (of one family, or one), unless all is said or
        it is asked already."""
        names = [name for name in names if not self.is_said(name, key)]
        if not names:
            return
        place = names[0] if len(names) == 1 else family(names[0])
        if all((one.place, one.key) != (place, key) for one in self.doubts):
            self.doubts.append(Doubt(place, key, why, options))

    def because(self, line: str, reason: str) -> None:
        """Keep a reason for a line of the report."""
        self.reasons.setdefault(line, []).append(reason)

    def values(self, column: str) -> np.ndarray:
        """Numbers (n,) of a column of the file. ValueError: it has no such column."""
        if column not in self.stream.columns:
            there = list(self.stream.columns)
            more = f" and {len(there) - 12} more" if len(there) > 12 else ""
            raise ValueError(f"no column {column!r}; there are {', '.join(there[:12])}{more}")
        return self.stream.columns[column]


@dataclass(frozen=True)
class Proposal:
    """What the file seems to be. draft: plain data of the map; doubts: what must be stated first;
    reasons: in words, by line of the report; left: columns that nothing is made of."""

    draft: Mapping[str, Any]
    doubts: tuple[Doubt, ...]
    reasons: Mapping[str, tuple[str, ...]]
    left: tuple[str, ...]

    def map(self, sources: tuple[str, ...] = ()) -> ImportMap:
        """The map. ValueError (one line): something is in doubt; names the option to state it."""
        if self.doubts:
            first, *rest = self.doubts
            more = f" ({len(rest)} more: {'; '.join(d.option for d in rest)})" if rest else ""
            raise ValueError(f"{first.why}: state it with {first.option}{more}")
        return validated({**self.draft, "sources": sources})
