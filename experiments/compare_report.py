"""The page of a comparison: words, map, intervals, the telling case, the table."""

from pathlib import Path

from experiments.compare_case import telling_case
from experiments.compare_figures import (
    case_figure,
    convergence_figure,
    crossing_figure,
    effect_figure,
    map_figure,
)
from experiments.compare_grid import Grid
from experiments.report import Section, Shown, number, write_page
from rig.parameters import Rig


def write_report(results: dict, rig: Rig, grid: Grid, out: Path) -> Path:
    """Figures and report.html in `out`."""
    case = telling_case(results, rig, grid)
    shown = [
        Shown(map_figure(results, out), "Each arm against no cure in every cell: mean gain in the "
              "ball's RMS distance; bold where sure after Holm's correction, grey where not."),
        Shown(effect_figure(results, out), "The same with 95 % intervals for the cells of the "
              "table's own friction; the band is the relevant size fixed beforehand."),
    ]  # fmt: skip
    telling = [
        Shown(case_figure(case, out), f"One telling case: {case.title}."),
        Shown(crossing_figure(case, out), "The play crossing itself: reference, servo and plate "
              "around one reversal (the plate is the simulator's truth)."),
        Shown(convergence_figure(case, out), "What the adaptive inverses believe of the play's "
              "two ends; dashed: the truth."),
    ]  # fmt: skip
    return write_page(
        out / "report.html",
        title=results["title"],
        source="simulated",
        summary=results["words"][:1],
        sections=[
            Section("Which cure helps, and when", results["words"], shown),
            Section("A telling case", [], telling),
            Section("Every cell", [], [], *_table(results)),
        ],
        recompute="rig compare",
    )


def _table(results: dict) -> tuple[list[str], list[list[str]]]:
    unit = "cm"
    head = ["cell", "arm", f"mean [{unit}]", "servo activity [rad]", f"gain [{unit}] [95 %]",
            "p (Holm)", "verdict", "at equal activity"]  # fmt: skip
    rows = []
    for cell in results["cells"]:
        for arm, found in cell["arms"].items():
            m, test = found["means"], found.get("against_without")
            equal = found.get("at_equal_activity")
            row = [cell["key"], arm, number(m[results["measure"]]), number(m["servo_activity"], 4)]
            if test:
                row += [f"{test['effect']:+.3f} [{test['low']:+.3f}, {test['high']:+.3f}]",
                        f"{test['p_holm']:.2g}", test["verdict"]]  # fmt: skip
            else:
                row += ["", "", ""]
            row.append(f"{equal['effect']:+.3f} vs {equal['rival']}: {equal['verdict']}"
                       if equal else "")  # fmt: skip
            rows.append(row)
    return head, rows
