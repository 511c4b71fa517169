"""Were runs made alike: by one protocol, on one table, with one set of gains?

Only such runs say what play compensation does: anything else that differs may be the cause.
"""

from collections.abc import Mapping, Sequence
from math import isclose
from typing import Any

from experiments.analysis.numbers import Recorded
from experiments.analysis.repeats import distinct, repeats_words
from rig.files import printable

REMEASURED = 0.1  # share by which a number of a measured table may move as it is calibrated; chosen
SHOWN = 3  # entries that a sentence names

Entries = Mapping[str, Any]  # "section.key" -> value, what a run was made with
Both = tuple[list[Recorded], list[Recorded]]  # without and with play compensation


def difference(one: Entries, other: Entries) -> list[str]:
    """Entries in which two runs differ: "linkage.kind (two-rods, three-arms)".

    What one of them, of another version of the program, does not say is not compared; an effect
    that it does not say among its effects is none.
    """
    measured = one.get("source") == "measured"
    effects = "effects" in one and "effects" in other
    both = [k for k in {**one, **other} if _told(k, one, other) or (effects and _is_effect(k))]
    return [
        f"{key} ({_shown(one.get(key))}, {_shown(other.get(key))})"
        for key in both
        if not _same(key, one.get(key), other.get(key), measured=measured)
    ]


def difference_words(one: Entries, other: Entries) -> str:
    """The first SHOWN entries of `difference`, for a sentence."""
    found = difference(one, other)
    more = f" and {len(found) - SHOWN} more" if len(found) > SHOWN else ""
    return printable(", ".join(found[:SHOWN]) + more)


def groups(made: Sequence[Entries]) -> list[int]:
    """For each run the number (from 0) of the group of runs that were made alike."""
    firsts: list[Entries] = []
    found = []
    for one in made:
        alike = (i for i, first in enumerate(firsts) if not difference(first, one))
        found.append(next(alike, len(firsts)))
        if found[-1] == len(firsts):
            firsts.append(one)
    return found


def both_methods(
    runs: Sequence[Recorded], methods: Sequence[str], made: Sequence[Entries]
) -> tuple[Both, list[str]]:
    """Different runs without and with play compensation, of those that were made as the first was,
    and sentences on the others. methods, made: of each run its controller and its entries."""
    how = [difference_words(made[0], one) for one in made]
    alike = [i for i, words in enumerate(how) if not words]
    without, with_ = ([runs[i] for i in alike if methods[i] == m] for m in ("without", "with"))
    both = distinct(without), distinct(with_)
    said = [repeats_words(len(alike) - sum(map(len, both)))]
    if n := len(runs) - len(alike):
        why = next(filter(None, how))
        said.append(f"Not compared, since made otherwise: {n} of {len(runs)} runs; {why}.")
    return both, list(filter(None, said))


def _told(key: str, one: Entries, other: Entries) -> bool:
    return key in one and key in other


def _is_effect(key: str) -> bool:
    return key.startswith("effects.")


def _same(key: str, one: Any, other: Any, *, measured: bool) -> bool:
    numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in (one, other))
    if numbers and measured and not key.startswith(("gains.", "protocol.")):
        return isclose(one, other, rel_tol=REMEASURED)
    return one == other


def _shown(value: Any) -> str:
    if value is None:
        return "none"
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return text if len(text) <= 20 else f"{text[:20]}..."
