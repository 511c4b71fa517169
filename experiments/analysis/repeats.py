"""Runs that hold the same samples: one simulation made again, or a copy, is no second run."""

from collections.abc import Sequence
from hashlib import sha256

from experiments.analysis.numbers import Recorded


def distinct(runs: Sequence[Recorded]) -> list[Recorded]:
    """The first of every group of runs whose logs are equal sample for sample, in their order.

    A simulated table with the same protocol, controller, rig and seed makes the same log again:
    counted twice it would narrow every interval, and there is nothing new in it.
    """
    seen, kept = set(), []
    for run in runs:
        samples = sha256(run.log.rows.tobytes()).digest()
        if samples not in seen:
            seen.add(samples)
            kept.append(run)
    return kept


def repeats_words(repeats: int) -> str:
    """A sentence on the runs that `distinct` left out; "" for none."""
    if not repeats:
        return ""
    which = "One run is" if repeats == 1 else f"{repeats} runs are each"
    return (
        f"{which} the same simulation as another one (same protocol, controller, rig and seed, "
        "equal sample for sample) and not counted again."
    )
