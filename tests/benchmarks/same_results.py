"""Does a change of the code leave every result as it was, to the last bit?

In the old checkout and in the new one, each into its own folder:

    uv run rig reproduce --out OUT/reproduce --seed 1
    uv run rig compare --out OUT/compare
    uv run python tests/benchmarks/gap/blind.py --out OUT/blind --trials 100 --nothing 100 --seed 5

then `uv run python tests/benchmarks/same_results.py OLD NEW`. It compares the `results.json` of the
first two, every sample of every recorded run, and the answer to each of the 200 blind trials;
times that an analysis took, and run folders, whose names begin with one, are left out. Exit code 0:
no difference; 1: each is printed.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

TIMES = ("seconds", "seconds_median", "minutes", "folder")  # what an analysis took, when it was


def differences(old: Any, new: Any, place: str = "") -> Iterator[str]:
    """Where two JSON values differ; floats are compared by their bits (NaN equals NaN)."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted({*old, *new} - {*TIMES}):
            if key in old and key in new:
                yield from differences(old[key], new[key], f"{place}.{key}")
            else:
                yield f"{place}.{key}: only in the {'old' if key in old else 'new'} one"
    elif isinstance(old, list) and isinstance(new, list):
        if len(old) != len(new):
            yield f"{place}: {len(old)} entries, now {len(new)}"
        for i, (one, other) in enumerate(zip(old, new, strict=False)):
            yield from differences(one, other, f"{place}[{i}]")
    elif json.dumps(old) != json.dumps(new):
        yield f"{place}: {json.dumps(old)}, now {json.dumps(new)}"


def compared_json(old: Path, new: Path, pattern: str) -> Iterator[str]:
    """Differences of all files of a pattern under two folders, and files that only one has."""
    names = {path.relative_to(folder) for folder in (old, new) for path in folder.glob(pattern)}
    if not names:
        yield f"{pattern}: in neither folder"
    for name in sorted(names):
        there = [(folder / name).is_file() for folder in (old, new)]
        if not all(there):
            yield f"{name}: only in the {'old' if there[0] else 'new'} folder"
            continue
        values = [json.loads((folder / name).read_text(encoding="utf-8")) for folder in (old, new)]
        yield from (f"{name}{line}" for line in differences(*values))


def runs_of(folder: Path) -> dict[str, Path]:
    """Run folders by protocol, arm, seed and repetition, since their names begin with a time."""
    found = {}
    for path in sorted(folder.glob("reproduce/runs/*/run.json")):
        record = json.loads(path.read_text(encoding="utf-8"))
        key = f"{record['protocol']['name']} {record['arm']} {record['seed']}"
        found[f"{key} {sum(name.startswith(key) for name in found)}"] = path.parent
    return found


def compared_runs(old: Path, new: Path) -> Iterator[str]:
    """Differences between the samples of the same runs under two folders."""
    from experiments.records.recording import read_run

    ones, others = runs_of(old), runs_of(new)
    if ones.keys() != others.keys() or not ones:
        only = sorted(ones.keys() ^ others.keys())
        yield f"runs: {len(ones)}, now {len(others)}; only one has {only}"
    for key in sorted(ones.keys() & others.keys()):
        one, other = (read_run(runs[key]).log for runs in (ones, others))
        if not np.array_equal(one.rows, other.rows, equal_nan=True):
            yield f"run {key}: its samples differ"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    options = parser.parse_args()
    found = [
        line
        for pattern in (
            "reproduce/results.json",
            "compare/results.json",
            "blind/own/answers/*.json",
        )
        for line in compared_json(options.old, options.new, pattern)
    ] + list(compared_runs(options.old, options.new))
    print("\n".join(found) or "no difference")
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
