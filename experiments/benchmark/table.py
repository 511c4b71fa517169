"""The scores as tables: one entry by kind and engine, and several entries side by side."""

from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

from experiments.blind.results_table import share_text
from rig.files import printable

COUNTS = ("named", "nothing", "unknown", "undecided", "no answer")
HEAD = ("logs", "n", "right", *COUNTS, "wrong and sure")


def entry_names(folders: Sequence[Path]) -> list[str]:
    """What the entries of these folders are called: the folder's name, or the whole path where two
    have one name; printable, and no part of a table's frame.
    """
    paths = [printable(one.resolve()).replace("|", "?") for one in folders]
    names = [Path(one).name for one in paths]
    return [n if names.count(n) == 1 else p for n, p in zip(names, paths, strict=True)]


def lines_of(results: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """The cells of an entry's table, without its head (`HEAD`): all logs, by kind, by engine."""
    groups = {"all": results["all"], **results["kinds"], **results["engines"]}
    return [
        (
            name,
            str(group["right"]["n"]),
            share_text(group["right"]),
            *(str(group[word]["k"]) for word in COUNTS),
            share_text(group["wrong and sure"]),
        )
        for name, group in groups.items()
    ]


def numbers_of(results: Mapping[str, Any]) -> list[str]:
    """An entry's calibration, sizes, coverage and time, a sentence each."""
    said, error, seconds = results["calibration"], results["sizes"], results["seconds"]
    return [
        f"probabilities: expected calibration error {_number(said['error'], '.3f')}, Brier score "
        f"{_number(results['brier'], '.3f')} (n = {said['n']})",
        f"sizes of right names off by {_number(100 * error['median'], '.2g', ' %')} in the median, "
        f"{_number(100 * error['p90'], '.2g', ' %')} in the worst tenth (n = {error['n']})",
        f"95 % intervals that hold the truth: {share_text(results['covered'])}",
        f"seconds a log: {_number(seconds['median'], '.3g')} in the median, "
        f"{_number(seconds['p90'], '.3g')} in the slowest tenth (n = {seconds['n']})",
    ]


def markdown(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    rows = [head, ["---"] * len(head), *lines]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows) + "\n"


def side_by_side(entries: Mapping[str, Mapping[str, Any]]) -> str:
    """A Markdown table of several entries' results, by name: a column each."""
    kinds = dict.fromkeys(kind for one in entries.values() for kind in one["kinds"])
    lines = [("right, of all logs", *(share_text(r["all"]["right"]) for r in entries.values()))]
    lines += [
        (kind, *(_of(one["kinds"].get(kind), "right") for one in entries.values()))
        for kind in kinds
    ]
    engines = dict.fromkeys(name for one in entries.values() for name in one["engines"])
    lines += [
        (f"right, {name}", *(_of(one["engines"].get(name), "right") for one in entries.values()))
        for name in engines
    ]
    lines += [
        (word, *(_of(one["all"], word) for one in entries.values()))
        for word in ("wrong and sure", *COUNTS)
    ]
    more = {
        "calibration error": lambda r: _number(r["calibration"]["error"], ".2f"),
        "Brier score": lambda r: _number(r["brier"], ".2f"),
        "sizes, median error": lambda r: _number(100 * r["sizes"]["median"], ".2g", " %"),
        "intervals that hold the truth": lambda r: share_text(r["covered"]),
        "seconds a log, median": lambda r: _number(r["seconds"]["median"], ".2g"),
    }
    lines += [(what, *(get(r) for r in entries.values())) for what, get in more.items()]
    return markdown(["", *entries], lines)


def page_of(entries: Mapping[str, Mapping[str, Any]]) -> str:
    """Markdown of several entries' results, by name: side by side, then each by kind and engine."""
    parts = [side_by_side(entries)] if len(entries) > 1 else []
    for name, results in entries.items():
        numbers = "\n".join(f"- {line}" for line in numbers_of(results))
        parts.append(f"## {name}\n\n{markdown(HEAD, lines_of(results))}\n{numbers}\n")
    return "\n".join(parts)


def _of(group: Mapping[str, Any] | None, word: str) -> str:
    return share_text(group[word]) if group else "-"


def _number(value: float, form: str, unit: str = "") -> str:
    return f"{value:{form}}{unit}" if isfinite(value) else "-"


def show(title: str, results: Mapping[str, Any]) -> None:
    """Print an entry's table and numbers to the terminal, at least 160 characters wide."""
    from rich.console import Console
    from rich.table import Table

    table = Table(*HEAD, title=title)
    for line in lines_of(results):
        table.add_row(*line)
    width = max(Console().width, 160)
    Console(width=width, markup=False).print(table)
    for line in numbers_of(results):
        print(line)
