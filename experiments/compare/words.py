"""The result of a comparison in sentences: by condition, by cell, the paper's cell, faults."""

from collections import Counter
from collections.abc import Mapping

import numpy as np

from experiments.compare.statistics import HARMS, HELPS, OPEN


def words(results: Mapping) -> list[str]:
    """Sentences on the results of `run_comparison`, most important first."""
    cells = results["cells"]
    plain = [cell for cell in cells if not cell["fault"]]
    return [
        *_winners(plain, results["measure"]),
        *_by_place(plain),
        *[_of_condition(condition, plain) for condition in _conditions(plain)],
        *_paper(results, plain),
        *_faults(results, cells),
    ]


def _conditions(cells) -> list[str]:
    return [
        condition for condition, found in cells[0]["arms"].items() if "against_without" in found
    ]


def best(cell: Mapping, measure: str) -> str:
    """Condition with the smallest mean of a measure in a cell; retuned PIDs are left out.

    "without" where no condition has a mean.
    """
    tried = {
        condition: found["means"]
        for condition, found in cell["arms"].items()
        if not condition.startswith("retuned")
    }
    values = {condition: m[measure] for condition, m in tried.items()}
    finite = {condition: v for condition, v in values.items() if np.isfinite(v)}
    return min(finite, key=lambda condition: finite[condition]) if finite else "without"


def _winners(cells, measure) -> list[str]:
    first = Counter(best(cell, measure) for cell in cells).most_common()
    named = ", ".join(f"{condition} {count}" for condition, count in first)
    return [f"The smallest mean error in {len(cells)} cells: {named}."]


def _by_place(cells) -> list[str]:
    """Which compensator helps against which backlash, over the frictions and protocols."""
    lines = []
    for play in dict.fromkeys(cell["play"] for cell in cells):
        those = [cell for cell in cells if cell["play"] == play]
        count = Counter(
            condition
            for cell in those
            for condition in _conditions(cells)
            if cell["arms"][condition]["against_without"]["verdict"] == HELPS
        )
        helped = ", ".join(
            f"{condition} in {n} of {len(those)}" for condition, n in count.most_common(4)
        )
        lines.append(f"Play «{play}»: {helped or 'nothing'} helps against no compensator.")
    return lines


def _count(condition: str, cells, test: str) -> Counter:
    return Counter(cell["arms"][condition][test]["verdict"] for cell in cells)


def _of_condition(condition: str, cells) -> str:
    plain, equal = (_count(condition, cells, t) for t in ("against_without", "at_equal_activity"))
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


def _paper(results, cells) -> list[str]:
    paper = results["grid"]["paper"]
    if "with" not in _conditions(cells):
        return []
    agree = [c for c in cells if c["arms"]["with"]["against_without"]["verdict"] == HELPS]
    against = [c for c in cells if c["arms"]["with"]["against_without"]["verdict"] == HARMS]
    own = next((c for c in cells if all(c[k] == paper[k] for k in paper)), None)
    lines = []
    if own is not None:
        t = own["arms"]["with"]["against_without"]
        lines.append(
            f"The paper's claim is one cell of this map ({own['key']}): there its model "
            f"{t['verdict'] if t['verdict'] != OPEN else 'is undecided'}, {t['effect']:+.3f} "
            f"[{t['low']:+.3f}, {t['high']:+.3f}] {t['unit']}."
        )
    names = "; ".join(c["key"] for c in agree)
    lines.append(
        f"{len(agree)} of {len(cells)} cells agree with the paper (its model helps beyond the "
        f"relevant size){': ' + names if agree else ''}. {len(against)} contradict it."
    )
    return lines


def _faults(results, cells) -> list[str]:
    lines = []
    for fault in results["grid"]["robustness"]["faults"]:
        those = [cell for cell in cells if cell["fault"] == fault]
        parts = []
        for cell in those:
            helped = [
                condition
                for condition in _conditions(cells)
                if cell["arms"][condition]["against_without"]["verdict"] == HELPS
            ]
            harmed = [
                condition
                for condition in _conditions(cells)
                if cell["arms"][condition]["against_without"]["verdict"] == HARMS
            ]
            parts.append(
                f"«{cell['play']}» still helped by {', '.join(helped) or 'nothing'}"
                f"{'; harmed by ' + ', '.join(harmed) if harmed else ''}"
            )
        lines.append(f"With {fault}: {'. '.join(parts)}.")
    return lines
