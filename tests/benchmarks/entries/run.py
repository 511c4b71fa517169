"""Answer a sealed set with one of the entries: `run.py ENTRY SET --out ANSWERS`.

Entries are `whiteness`, `parametric`, `sparse` and `symbolic`; the last two need the group
`entries` (`uv run --group entries`).
"""

import argparse
import sys
from importlib import import_module
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[3]))

from experiments.benchmark.answers import answer_set
from experiments.cli.console import bars

ENTRIES = {
    "whiteness": "innovations of a Kalman filter, Ljung and Box",
    "parametric": "least squares of multi-step predictions, BIC",
    "sparse": "PySINDy on the discrepancy",
    "symbolic": "gplearn on the discrepancy",
}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("entry", choices=tuple(ENTRIES))
    parser.add_argument("set", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--first", type=int)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    entry = import_module(f"tests.benchmarks.entries.{options.entry}")
    with bars() as progress:
        failed = answer_set(
            options.set, options.out, answer=entry.answer_of, first=options.first,
            jobs=options.jobs, progress=progress,
        )  # fmt: skip
    print(f"{failed} failed; rig benchmark score {options.set} {options.out}")


if __name__ == "__main__":
    main()
