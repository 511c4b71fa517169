"""The page of a comparison: words, map, intervals, the telling case, the table."""

from math import degrees
from pathlib import Path

from experiments.compare.case import Case, telling_case
from experiments.compare.figures import (
    case_figure,
    convergence_figure,
    crossing_figure,
    effect_figure,
    map_figure,
)
from experiments.compare.glossary import glossary
from experiments.compare.grid import Grid
from experiments.compare.statistics import EVEN, HARMS, HELPS, OPEN
from experiments.compare.words import (
    conditions,
    count,
    fault_words,
    paper_words,
    plain_cells,
    too_few_words,
)
from experiments.reports.figures import SOURCES
from experiments.reports.report import (
    Picture,
    Pictures,
    Section,
    Table,
    number,
    recompute_section,
    write_page,
)
from rig.parameters import Rig


def write_report(results: dict, rig: Rig, grid: Grid, out: Path, command: str) -> Path:
    """Write the figures and report.html of a comparison in `out`; return the page's path.

    results: as of `run_comparison`; command: that made them. The telling case is simulated again.
    OSError: `out` cannot be written.
    """
    closer = _closer(telling_case(results, rig, grid), out)
    overview = [
        Picture(
            map_figure(results, out),
            "Each compensator against none in every cell: mean gain in the ball's RMS distance; "
            "bold where sure after Holm's correction, italic where not.",
        ),
        Picture(
            effect_figure(results, out),
            "The same with 95 % intervals for the cells of the table's own friction; the band is "
            "the relevant size fixed beforehand.",
        ),
    ]
    return write_page(
        out / "report.html",
        title=results["title"],
        source=SOURCES["simulated"],
        answer=results["words"][0],
        summary=[*too_few_words(results), *paper_words(results)],
        sections=[
            Section(
                "Which compensator helps, and when",
                [
                    _by_condition(results),
                    _by_play(results),
                    *fault_words(results),
                    Pictures(overview, wide=True),
                ],
            ),
            Section(
                "What is compared",
                [
                    Table(
                        ["condition", "definition"], glossary(results["cells"][0]["arms"]), words=2
                    )
                ],
            ),
            Section("A telling case", [Pictures(closer, wide=True)]),
            Section("Every cell", [_table(results)]),
            recompute_section("", command),
        ],
    )


def _closer(case: Case, out: Path) -> list[Picture]:
    """Figures of a telling case, saved in `out`."""
    return [
        Picture(case_figure(case, out), f"One telling case: {case.title.replace(' | ', ' · ')}."),
        Picture(
            crossing_figure(case, out),
            "The crossing of the play itself: reference, servo and plate around one reversal "
            "(the plate is the simulator's truth).",
        ),
        Picture(
            convergence_figure(case, out),
            "The two ends of the play as the controllers estimate them; dashed: the truth.",
        ),
    ]


def _by_condition(results: dict) -> Table:
    """In how many cells each compensator helps and harms, against none and at equal activity."""
    cells, rows = plain_cells(results), []
    for condition in conditions(cells):
        plain, equal = (
            count(condition, cells, t) for t in ("against_without", "at_equal_activity")
        )
        found = (plain[HELPS], plain[HARMS], plain[EVEN], plain[OPEN], equal[HELPS], equal[HARMS])
        rows.append([condition, *map(str, found)])
    head = ("compensator", "helps", "harms", EVEN, "undecided", "helps at equal servo activity")
    caption = f"Cells, of {len(cells)}: against no compensator, and against the best of the others."
    return Table((*head, "harms at equal servo activity"), rows, caption, words=1)


def _by_play(results: dict) -> Table:
    """In how many cells of each play every compensator helps against none."""
    cells = plain_cells(results)
    names, rows = conditions(cells), []
    for play in dict.fromkeys(cell["play"] for cell in cells):
        those = [cell for cell in cells if cell["play"] == play]
        helped = [count(name, those, "against_without")[HELPS] for name in names]
        rows.append([play, str(len(those)), *map(str, helped)])
    return Table(("play", "cells", *names), rows, "In how many of its cells it helps.", words=1)


def _table(results: dict) -> Table:
    """A row a cell and condition: means, gain over no compensator, verdicts."""
    head = ["cell", "condition", "mean [cm]", "servo activity [deg]", "gain [cm] [95 %]"]
    head += ["p (Holm)", "verdict", "at equal activity"]
    rows = []
    for cell in results["cells"]:
        for condition, found in cell["arms"].items():
            m, test = found["means"], found.get("against_without")
            equal = found.get("at_equal_activity")
            row = [
                cell["key"].replace(" | ", " · "),
                condition,
                number(m[results["measure"]]),
                number(degrees(m["servo_activity"]), 2),
            ]
            gain = p = verdict = at_equal = ""
            if test:
                gain = f"{test['effect']:+.3f} [{test['low']:+.3f}, {test['high']:+.3f}]"
                p, verdict = f"{test['p_holm']:.2g}", test["verdict"]
            if equal:
                at_equal = f"{equal['effect']:+.3f} vs {equal['rival']}: {equal['verdict']}"
            rows.append([*row, gain, p, verdict, at_equal])
    return Table(head, rows, words=2, folded=True)
