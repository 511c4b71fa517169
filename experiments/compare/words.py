"""What a comparison says, in plain words: per arm, the best per cell, the paper's cell, faults."""

from collections import Counter
from collections.abc import Mapping

import numpy as np

from experiments.compare_statistics import HARMS, HELPS, OPEN


def words(results: Mapping) -> list[str]:
    """Sentences, most important first."""
    cells = results["cells"]
    plain = [cell for cell in cells if not cell["fault"]]
    return [
        *_winners(plain, results["measure"]),
        *_by_place(plain),
        *[_of_arm(arm, plain) for arm in _arms(plain)],
        *_paper(results, plain),
        *_faults(results, cells),
    ]


def _arms(cells) -> list[str]:
    return [arm for arm, found in cells[0]["arms"].items() if "against_without" in found]


def best(cell: Mapping, measure: str) -> str:
    """The arm (or "without") of the smallest mean in a cell, the rivals for show left out."""
    tried = {
        arm: found["means"] for arm, found in cell["arms"].items() if not arm.startswith("retuned")
    }
    values = {arm: m[measure] for arm, m in tried.items()}
    finite = {arm: v for arm, v in values.items() if np.isfinite(v)}
    return min(finite, key=lambda arm: finite[arm]) if finite else "without"


def _winners(cells, measure) -> list[str]:
    first = Counter(best(cell, measure) for cell in cells).most_common()
    named = ", ".join(f"{arm} {count}" for arm, count in first)
    return [f"The smallest mean error in {len(cells)} cells: {named}."]


def _by_place(cells) -> list[str]:
    """Which cure for which play, over the frictions and protocols."""
    lines = []
    for play in dict.fromkeys(cell["play"] for cell in cells):
        those = [cell for cell in cells if cell["play"] == play]
        count = Counter(
            arm for cell in those for arm in _arms(cells)
            if cell["arms"][arm]["against_without"]["verdict"] == HELPS
        )  # fmt: skip
        helped = ", ".join(f"{arm} in {n} of {len(those)}" for arm, n in count.most_common(4))
        lines.append(f"Play «{play}»: {helped or 'nothing'} helps against no cure.")
    return lines


def _count(arm: str, cells, test: str) -> Counter:
    return Counter(cell["arms"][arm][test]["verdict"] for cell in cells)


def _of_arm(arm: str, cells) -> str:
    plain, equal = (_count(arm, cells, t) for t in ("against_without", "at_equal_activity"))
    harmed = [
        cell["key"] for cell in cells if cell["arms"][arm]["against_without"]["verdict"] == HARMS
    ]
    where = f" (harm: {'; '.join(harmed[:3])}{' ...' if len(harmed) > 3 else ''})" if harmed else ""
    return (
        f"{arm}: against no cure it helps in {plain[HELPS]} cells, harms in {plain[HARMS]}, "
        f"{plain[OPEN]} undecided, of {len(cells)}{where}; at equal servo activity it helps in "
        f"{equal[HELPS]} and harms in {equal[HARMS]}."
    )


def _paper(results, cells) -> list[str]:
    paper = results["grid"]["paper"]
    if "with" not in _arms(cells):
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
                arm for arm in _arms(cells)
                if cell["arms"][arm]["against_without"]["verdict"] == HELPS
            ]  # fmt: skip
            harmed = [
                arm for arm in _arms(cells)
                if cell["arms"][arm]["against_without"]["verdict"] == HARMS
            ]  # fmt: skip
            parts.append(
                f"«{cell['play']}» still helped by {', '.join(helped) or 'nothing'}"
                f"{'; harmed by ' + ', '.join(harmed) if harmed else ''}"
            )
        lines.append(f"With {fault}: {'. '.join(parts)}.")
    return lines
