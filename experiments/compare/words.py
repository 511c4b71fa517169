"""The result of a comparison in sentences: by condition, by cell, the paper's cell, faults."""

from collections import Counter
from collections.abc import Mapping
from math import ceil, log2

import numpy as np

from experiments.compare.statistics import HARMS, HELPS, OPEN, SURE

NONE = "none"


def words(results: Mapping) -> list[str]:
    """Sentences on the results of `run_comparison`, most important first."""
    plain = plain_cells(results)
    return [
        *_winners(plain, results["measure"]),
        *too_few_words(results),
        *_by_place(plain),
        *[_of_condition(condition, plain) for condition in conditions(plain)],
        *paper_words(results),
        *fault_words(results),
    ]


def too_few_words(results: Mapping) -> list[str]:
    """As `few_seeds_words`, of results; nothing of those without their seeds."""
    kinds = ("against_without", "at_equal_activity")
    arms = [arm for cell in results["cells"] for arm in cell["arms"].values()]
    return few_seeds_words(sum(kind in arm for arm in arms for kind in kinds), results.get("seeds"))


def few_seeds_words(tests: int, seeds: int | None) -> list[str]:
    """Where the seeds are so few that no test can be certain: that, and how many it takes.

    The smallest exact p of n pairs is 2/2^n (both signs); Holm multiplies it by the number m of
    tests. So m 2/2^n <= SURE needs n >= log2(2 m/SURE). Nothing of an unknown number of seeds.
    """
    if seeds is None or tests * 2.0 ** (1 - seeds) <= SURE:
        return []
    return [
        f"With {seeds} seeds a cell no difference can be certain among {tests} tests: p is "
        f"{2.0 ** (1 - seeds):.2g} at least. It takes {ceil(log2(2 * tests / SURE))} seeds "
        "(option --seeds)."
    ]


def plain_cells(results: Mapping) -> list[dict]:
    """The cells without a fault."""
    return [cell for cell in results["cells"] if not cell["fault"]]


def conditions(cells) -> list[str]:
    """The conditions that are tested against none, in the cells' order."""
    return [
        condition for condition, found in cells[0]["arms"].items() if "against_without" in found
    ]


def best(cell: Mapping, measure: str) -> str:
    """Condition with the smallest mean of a measure in a cell; retuned PIDs are left out.

    "none" where no condition has a mean.
    """
    tried = {
        condition: found["means"]
        for condition, found in cell["arms"].items()
        if not condition.startswith("retuned")
    }
    values = {condition: m[measure] for condition, m in tried.items()}
    finite = {condition: v for condition, v in values.items() if np.isfinite(v)}
    return min(finite, key=lambda condition: finite[condition]) if finite else NONE


def _winners(cells, measure) -> list[str]:
    first = Counter(best(cell, measure) for cell in cells)
    lost = first.pop(NONE, 0)
    named = ", ".join(f"{condition} in {count}" for condition, count in first.most_common())
    lines = [f"The smallest mean error, of {len(cells)} cells: {named}."] if first else []
    if lost:
        where = f"In {lost} of {len(cells)} cells"
        lines.append(f"{where} no condition has one: too few runs completed.")
    return lines


def _by_place(cells) -> list[str]:
    """Which compensator helps against which backlash, over the frictions and protocols."""
    lines = []
    for play in dict.fromkeys(cell["play"] for cell in cells):
        those = [cell for cell in cells if cell["play"] == play]
        found = Counter(
            condition
            for cell in those
            for condition in conditions(cells)
            if cell["arms"][condition]["against_without"]["verdict"] == HELPS
        )
        helped = ", ".join(
            f"{condition} in {n} of {len(those)}" for condition, n in found.most_common(4)
        )
        lines.append(f"Play «{play}»: {helped or 'nothing'} helps against no compensator.")
    return lines


def count(condition: str, cells, test: str) -> Counter:
    """How often each verdict was given on a condition; test: against_without, at_equal_activity."""
    return Counter(cell["arms"][condition][test]["verdict"] for cell in cells)


def _of_condition(condition: str, cells) -> str:
    plain, equal = (count(condition, cells, t) for t in ("against_without", "at_equal_activity"))
    harmed = [
        cell["key"]
        for cell in cells
        if cell["arms"][condition]["against_without"]["verdict"] == HARMS
    ]
    where = f" (harm: {'; '.join(harmed[:3])}{' ...' if len(harmed) > 3 else ''})" if harmed else ""
    return (
        f"{condition}: against no compensator it helps in {plain[HELPS]} cells, "
        f"harms in {plain[HARMS]}, {plain[OPEN]} undecided, of {len(cells)}{where}; "
        f"at equal servo activity it helps in {equal[HELPS]} and harms in {equal[HARMS]}."
    )


def paper_words(results: Mapping) -> list[str]:
    """What the cells say of the paper's claim; nothing where its model was not tried."""
    paper, cells = results["grid"]["paper"], plain_cells(results)
    if "with" not in conditions(cells):
        return []
    agree = [c for c in cells if c["arms"]["with"]["against_without"]["verdict"] == HELPS]
    against = [c for c in cells if c["arms"]["with"]["against_without"]["verdict"] == HARMS]
    own = next((c for c in cells if all(c[k] == paper[k] for k in paper)), None)
    lines = []
    if own is not None:
        t, key = own["arms"]["with"]["against_without"], own["key"].replace(" | ", " · ")
        lines.append(
            f"The paper's claim is one cell of this map ({key}): there its model "
            f"{t['verdict'] if t['verdict'] != OPEN else 'is undecided'}, {t['effect']:+.3f} "
            f"[{t['low']:+.3f}, {t['high']:+.3f}] {t['unit']}."
        )
    every = Counter(c["play"] for c in cells)
    where = Counter(c["play"] for c in agree)
    names = ", ".join(f"«{play}» {n} of {every[play]}" for play, n in where.items())
    lines.append(
        f"{len(agree)} of {len(cells)} cells agree with the paper (its model helps beyond the "
        f"relevant size){': ' + names if agree else ''}. {len(against)} contradict it."
    )
    return lines


def fault_words(results: Mapping) -> list[str]:
    """What still helps, and what harms, under each fault of the grid: a sentence each."""
    lines, cells = [], results["cells"]
    for fault in results["grid"]["robustness"]["faults"]:
        those = [cell for cell in cells if cell["fault"] == fault]
        parts = []
        for cell in those:
            helped = [
                condition
                for condition in conditions(cells)
                if cell["arms"][condition]["against_without"]["verdict"] == HELPS
            ]
            harmed = [
                condition
                for condition in conditions(cells)
                if cell["arms"][condition]["against_without"]["verdict"] == HARMS
            ]
            parts.append(
                f"«{cell['play']}» still helped by {', '.join(helped) or 'nothing'}"
                f"{'; harmed by ' + ', '.join(harmed) if harmed else ''}"
            )
        lines.append(f"With {fault}: {'. '.join(parts)}.")
    return lines
