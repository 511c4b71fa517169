"""Logs spoiled on purpose, all from one seed, and what `rig gap` says of them.

    uv run python tests/benchmarks/gap/log_faults.py --logs 5000 --seed 1 --jobs 2

Each is a log of a table that shares no code with the product, cut to a length of 1 row or more,
with one to three faults of FAULTS. Prints a table: per fault how many logs, how many were refused
in one line, and how many got an answer. Exit code 1 where anything but a ValueError was raised, or
where a refusal or a note speaks of arrays.
"""

import argparse
import multiprocessing
import re
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[3]))

from experiments.benchmark.engines.foreign.table import make_log, write_csv
from experiments.gap.gap import investigate

PROTOCOLS = ("steps", "hold", "squares")
INTERNAL = re.compile(r"array|concatenat|shape|index|operand|broadcast|dtype|object|None|axis 0")
Columns = dict[str, np.ndarray]
Fault = Callable[[Columns, np.random.Generator], None]


@cache
def base(protocol: str) -> Columns:
    return make_log(protocol, seed=1, duration_s=12.0)


def _channel(log: Columns, rng: np.random.Generator) -> str:
    return str(rng.choice([name for name in log if name != "t_s"]))


def _span(log: Columns, rng: np.random.Generator) -> slice:
    first, last = np.sort(rng.integers(0, len(log["t_s"]) + 1, 2))
    return slice(int(first), int(last))


def blank_channel(log: Columns, rng: np.random.Generator) -> None:
    log[_channel(log, rng)][:] = np.nan


def blank_span(log: Columns, rng: np.random.Generator) -> None:
    log[_channel(log, rng)][_span(log, rng)] = np.nan


def infinite_value(log: Columns, rng: np.random.Generator) -> None:
    log[_channel(log, rng)][rng.integers(len(log["t_s"]))] = rng.choice([np.inf, -np.inf, 1e300])


def rows_missing(log: Columns, rng: np.random.Generator) -> None:
    keep = np.ones(len(log["t_s"]), bool)
    keep[_span(log, rng)] = False
    for name in log:
        log[name] = log[name][keep]


def repeated_times(log: Columns, rng: np.random.Generator) -> None:
    span = _span(log, rng)
    if len(log["t_s"][span]):
        log["t_s"][span] = log["t_s"][span][0]


def time_backwards(log: Columns, rng: np.random.Generator) -> None:
    log["t_s"][_span(log, rng)] -= rng.choice([0.001, 1.0, 1e6])


def swapped_axes(log: Columns, rng: np.random.Generator) -> None:
    stem = rng.choice(["theta_{}_rad", "voltage_{}_V", "ball_{}_m"])
    x, y = stem.format("x"), stem.format("y")
    log.update({there: log[here] for here, there in ((x, y), (y, x)) if here in log})


def wrong_sign(log: Columns, rng: np.random.Generator) -> None:
    log[_channel(log, rng)] *= -1.0


def wrong_unit(log: Columns, rng: np.random.Generator) -> None:
    log[_channel(log, rng)] *= rng.choice([1000.0, 0.001, 57.29578, 0.0174533])


def stuck_channel(log: Columns, rng: np.random.Generator) -> None:
    name = _channel(log, rng)
    log[name][:] = rng.choice([0.0, 1.0, log[name][0]])


def channel_missing(log: Columns, rng: np.random.Generator) -> None:
    del log[_channel(log, rng)]


def one_frame(log: Columns, rng: np.random.Generator) -> None:
    seen = np.flatnonzero(np.isfinite(log.get("ball_x_m", np.full(1, np.nan))))
    for name in ("ball_x_m", "ball_y_m"):
        if name in log:
            log[name][seen[1:]] = np.nan


def several_runs(log: Columns, rng: np.random.Generator) -> None:
    log["run"] = np.sort(rng.integers(0, rng.integers(2, 9), len(log["t_s"]))).astype(float)


FAULTS: tuple[Fault, ...] = (
    *(blank_channel, blank_span, infinite_value, rows_missing, repeated_times, time_backwards),
    *(swapped_axes, wrong_sign, wrong_unit, stuck_channel, channel_missing, one_frame),
    several_runs,
)  # fmt: skip


@dataclass(frozen=True)
class Result:
    """One spoiled log: its number, its faults, "refused", "answered" or "raised", and what was
    said."""

    number: int
    faults: tuple[str, ...]
    outcome: str
    said: str

    @property
    def bad(self) -> bool:
        return self.outcome == "raised" or bool(INTERNAL.search(self.said)) or "\n" in self.said


def spoiled(number: int, seed: int) -> tuple[Columns, tuple[str, ...]]:
    """The log of this number (columns of equal length), and its faults."""
    rng = np.random.default_rng([seed, number])
    log = {name: values.copy() for name, values in base(str(rng.choice(PROTOCOLS))).items()}
    rows = len(log["t_s"])
    length = int(rng.choice([rows, rows, rng.integers(1, rows + 1), rng.integers(1, 12)]))
    log = {name: values[:length].copy() for name, values in log.items()}
    chosen = rng.choice(len(FAULTS), size=rng.integers(1, 4), replace=False)
    for i in chosen:
        if len(log["t_s"]) > 1:
            FAULTS[i](log, rng)
    return log, tuple(FAULTS[i].__name__ for i in chosen)


def ask(number: int, seed: int) -> Result:
    """What the workflow says of one spoiled log."""
    log, faults = spoiled(number, seed)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("error")
        path = Path(folder) / "log.csv"
        write_csv(path, log)
        try:
            found = investigate([path], quick=True, until="add")
        except (ValueError, FileNotFoundError) as error:
            return Result(number, faults, "refused", str(error))
        except Exception:
            return Result(number, faults, "raised", traceback.format_exc())
        return Result(number, faults, "answered", " ".join([found.sentence, *found.notes]))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--logs", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    count: Counter[tuple[str, str]] = Counter()
    bad = []
    with multiprocessing.get_context("fork").Pool(asked.jobs) as pool:
        answers = pool.imap(partial(ask, seed=asked.seed), range(asked.logs))
        for done, result in enumerate(answers, 1):
            count.update((fault, result.outcome) for fault in result.faults)
            bad += [result] if result.bad else []
            print(f"\r{done} of {asked.logs}, {len(bad)} bad", end="", file=sys.stderr)
    print("\n| fault | logs | refused | answered | raised |\n|---|---|---|---|---|")
    for fault in FAULTS:
        outcomes = [count[fault.__name__, word] for word in ("refused", "answered", "raised")]
        cells = [fault.__name__.replace("_", " "), sum(outcomes), *outcomes]
        print(f"| {' | '.join(map(str, cells))} |")
    for result in bad[:20]:
        print(f"log {result.number}: {', '.join(result.faults)}: {result.said}")
    sys.exit(bool(bad))


if __name__ == "__main__":
    main()
