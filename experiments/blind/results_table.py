"""The blind trials' table: goal beside what was reached, for the terminal and for the page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

from experiments.blind.trial_score import TrialScore


@dataclass(frozen=True)
class Row:
    """A line of the table.

    what: the quantity; goal: its goal in words ("": none); reached: the value in words ("-": no
    data); met: whether the value meets the goal (None: no goal, or no data).
    """

    what: str
    goal: str
    reached: str
    met: bool | None


def rows(results: Mapping[str, Any], *, right_goal: float = 0.99) -> list[Row]:
    """The table's lines from the numbers of `score_summary.summary`.

    right_goal: least share of right names with one hidden effect, which differs between engines.
    Lines on the next experiment follow only if results holds "next".
    """
    kinds, sizes, proof = results["kinds"], results["sizes"], results["proof"]
    nothing = results["nothing"]
    lines = [
        _kind(kinds, "single", "right name, one hidden effect", right_goal),
        *_beside(results),
        _kind(kinds, "pair", "exactly both of two hidden effects", 0.90),
        _kind(kinds, "shape", "right family and nothing extra, other inner shape", 0.95),
        *_alarms(nothing),
        _kind(kinds, "stranger", "unknown effects called unknown, no name", 0.95),
        _quantile("held-out gap closed, median", proof["closed"], "median", 0.98, above=True),
        _quantile("held-out gap closed, worst tenth", proof["closed"], "p10", 0.90, above=True),
        _quantile("error 1 s ahead over its floor", proof["ahead"], "median", 1.1, percent=False),
        _quantile("parameters, median error", sizes["error"], "median", 0.02),
        _quantile("parameters, 90 % of errors below", sizes["error"], "p90", None),
        _coverage(sizes["covered"]),
        _calibration(results["calibration"]),
        _share("confident name that is wrong", results["confident wrong"], most=0.003),
        _kind(kinds, "untestable", "what no log shows is reported untestable", 1.0),
        _share("right axes of what was named", results["axes"]),
    ]
    if "next" in results:
        lines.append(
            _share("next experiment separates the pair", results["next"]["separated"], least=0.9)
        )
    for variant, group in results["realistic"].items():
        lines.append(_share(f"realistic rig, {variant}: exactly right", group["right"]))
        lines.append(
            _share(f"realistic rig, {variant}: hidden effects found", group["hidden found"])
        )
    for variant, group in results["camera"].items():
        lines.append(_share(f"through the camera, {variant}", group["right"]))
    return lines


def _beside(results: Mapping[str, Any]) -> list[Row]:
    """The same by protocol, and how it failed."""
    lines = [
        _share(f"- with {name}", group["right"]) for name, group in results["protocols"].items()
    ]
    single = results["kinds"].get("single")
    if single:
        lines += [
            _share(f"- {what}", single[what])
            for what in ("detected", "right of named", "undecided", "wrong name")
        ]
    return lines


def _alarms(nothing: Mapping[str, Any]) -> list[Row]:
    lines = []
    for variant, group in nothing.items():
        most = 0.01 if variant == "plain" else None if variant == "all" else 0.03
        for what in ("named", "unknown", "undecided"):
            goal = None if what == "undecided" else most
            lines.append(_share(f"nothing missing, {variant}: {what}", group[what], most=goal))
    return lines


def _kind(kinds: Mapping[str, Any], kind: str, what: str, least: float) -> Row:
    return _share(what, kinds[kind]["right"] if kind in kinds else None, least=least)


def share_text(found: Mapping[str, Any]) -> str:
    """A share with its interval, "97.5 % (95.1 to 98.7; 195/200)"; "-" of nothing."""
    if not found["n"]:
        return "-"
    value, low, high = (100 * found[key] for key in ("value", "low", "high"))
    return f"{value:.1f} % ({low:.1f} to {high:.1f}; {found['k']}/{found['n']})"


def _share(
    what: str,
    found: Mapping[str, Any] | None,
    *,
    least: float | None = None,
    most: float | None = None,
) -> Row:
    """A share with its interval: "97.5 % (95.1 to 98.7; 195/200)"."""
    limit = least if least is not None else most
    goal = "" if limit is None else f"{'at least' if most is None else 'at most'} {100 * limit:g} %"
    if not found or not found["n"]:
        return Row(what, goal, "-", None)
    text = share_text(found)
    met = None
    if limit is not None:
        met = found["value"] >= limit if most is None else found["value"] <= limit
    return Row(what, goal, text, met)


def _quantile(
    what: str,
    found: Mapping[str, Any],
    key: str,
    limit: float | None,
    *,
    above: bool = False,
    percent: bool = True,
) -> Row:
    unit = " %" if percent else ""
    times = 100 if percent else 1
    goal = "" if limit is None else f"{'at least' if above else 'at most'} {times * limit:g}{unit}"
    value = found[key]
    if not found["n"] or not isfinite(value):
        return Row(what, goal, "-", None)
    met = None if limit is None else (value >= limit if above else value <= limit)
    return Row(what, goal, f"{times * value:.3g}{unit} (n = {found['n']})", met)


def _coverage(found: Mapping[str, Any]) -> Row:
    row = _share("95 % intervals that hold the truth", found)
    met = 0.92 <= found["value"] <= 0.98 if found["n"] else None
    return Row(row.what, "92 to 98 %", row.reached, met)


def _calibration(found: Mapping[str, Any]) -> Row:
    what, goal = "probabilities: expected calibration error", "at most 0.05"
    if not found["n"]:
        return Row(what, goal, "-", None)
    return Row(what, goal, f"{found['error']:.3f} (n = {found['n']})", found["error"] <= 0.05)


WORDS = {True: "yes", False: "no", None: ""}


def markdown(lines: list[Row]) -> str:
    """The lines as a Markdown table with the columns quantity, goal, reached and met."""
    head = ["| | goal | reached | met |", "|---|---|---|---|"]
    body = [f"| {r.what} | {r.goal} | {r.reached} | {WORDS[r.met]} |" for r in lines]
    return "\n".join([*head, *body]) + "\n"


def effects_markdown(results: Mapping[str, Any]) -> str:
    """A Markdown table of the trials with one hidden effect, catalogued or not, a line per effect.

    results: numbers of `score_summary.summary`. Cells are counts k/n: right, wrong name, undecided,
    called unknown, not seen.
    """
    head = "| hidden | right | wrong name | undecided | called unknown | not seen |"
    body = [head, "|---|---|---|---|---|---|"]
    for name, group in (results["effects"] | results["strangers"]).items():
        cells = [group[key] for key in ("right", "wrong name", "undecided", "unknown")]
        missed = group["verdicts"].get("nothing-missing", 0)
        texts = [f"{cell['k']}/{cell['n']}" for cell in cells]
        body.append(f"| {name} | {' | '.join(texts)} | {missed}/{cells[0]['n']} |")
    return "\n".join(body) + "\n"


def failures_markdown(scores: Sequence[TrialScore]) -> str:
    """A Markdown table of every trial that was not answered rightly, without those of kind "weak".

    Columns: trial, kind, what was hidden, its factor over the smallest amplitude, protocol,
    verdict, and the names in the answer with their probabilities.
    """
    body = ["| trial | kind | hidden | times the smallest | recorded with | verdict | said |"]
    body += ["|---|---|---|---|---|---|---|"]
    for m in scores:
        if m.right or m.trial.kind == "weak":
            continue
        stated = ", ".join(
            f"{name} ({p:.2f})" for name, (p, _) in zip(m.answered, m.stated, strict=True)
        )
        cells = [m.trial.name, m.trial.kind, m.trial.variant, f"{m.trial.factor:.2f}"]
        body.append(f"| {' | '.join([*cells, m.trial.battery, m.verdict, stated])} |")
    return "\n".join(body) + "\n"


def show(lines: list[Row], title: str) -> None:
    """Print the lines as a table with this title to the terminal, at least 110 characters wide."""
    from rich.console import Console
    from rich.table import Table

    table = Table("", "goal", "reached", "met", title=title)
    for r in lines:
        table.add_row(r.what, r.goal, r.reached, WORDS[r.met])
    console = Console()
    Console(width=max(console.width, 110)).print(table)
