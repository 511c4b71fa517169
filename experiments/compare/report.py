"""The page of a comparison: words, map, intervals, the telling case, the table."""

from pathlib import Path

from experiments.compare.case import telling_case
from experiments.compare.figures import (
    case_figure,
    convergence_figure,
    crossing_figure,
    effect_figure,
    map_figure,
)
from experiments.compare.glossary import glossary
from experiments.compare.grid import Grid
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


def write_report(results: dict, rig: Rig, grid: Grid, out: Path) -> Path:
    """Write the figures and report.html of a comparison in `out`; return the page's path.

    results: as of `run_comparison`. The telling case is simulated again. OSError: `out` cannot be
    written.
    """
    case = telling_case(results, rig, grid)
    overview = [
        Picture(
            map_figure(results, out),
            "Each compensator against none in every cell: mean gain in the ball's RMS distance; "
            "bold where sure after Holm's correction, grey where not.",
        ),
        Picture(
            effect_figure(results, out),
            "The same with 95 % intervals for the cells of the table's own friction; the band is "
            "the relevant size fixed beforehand.",
        ),
    ]
    closer = [
        Picture(case_figure(case, out), f"One telling case: {case.title}."),
        Picture(
            crossing_figure(case, out),
            "The crossing of the backlash itself: reference, servo and plate around one reversal "
            "(the plate is the simulator's truth).",
        ),
        Picture(
            convergence_figure(case, out),
            "The two ends of the backlash as the adaptive inverses estimate them; dashed: the "
            "truth.",
        ),
    ]
    return write_page(
        out / "report.html",
        title=results["title"],
        source="simulated",
        summary=results["words"][:1],
        sections=[
            Section(
                "Which compensator helps, and when",
                [*results["words"][1:], Pictures(overview, wide=True)],
            ),
            Section(
                "What is compared",
                [
                    Table(
                        ["condition", "definition"], glossary(results["cells"][0]["arms"]), words=2
                    )
                ],
            ),
            Section("A telling case", [Pictures(closer)]),
            Section("Every cell", [_table(results)]),
            recompute_section("", "rig compare"),
        ],
    )


def _table(results: dict) -> Table:
    """A row a cell and condition: means, gain over no compensator, verdicts."""
    head = ["cell", "condition", "mean [cm]", "servo activity [rad]", "gain [cm] [95 %]"]
    head += ["p (Holm)", "verdict", "at equal activity"]
    rows = []
    for cell in results["cells"]:
        for condition, found in cell["arms"].items():
            m, test = found["means"], found.get("against_without")
            equal = found.get("at_equal_activity")
            row = [
                cell["key"],
                condition,
                number(m[results["measure"]]),
                number(m["servo_activity"], 4),
            ]
            gain = p = verdict = at_equal = ""
            if test:
                gain = f"{test['effect']:+.3f} [{test['low']:+.3f}, {test['high']:+.3f}]"
                p, verdict = f"{test['p_holm']:.2g}", test["verdict"]
            if equal:
                at_equal = f"{equal['effect']:+.3f} vs {equal['rival']}: {equal['verdict']}"
            rows.append([*row, gain, p, verdict, at_equal])
    return Table(head, rows, words=2, folded=True)
