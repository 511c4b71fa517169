"""Make a sealed set: logs and rig files for who answers, the truth apart, its hash, the rules.

DIR/rules.md                  format and rules
DIR/seal.json                 SHA-256 of the truth, number of logs
DIR/cases/case-0001/          log-1.parquet, rig.toml
DIR/sealed/truth.json         opened by the score alone; not handed out
"""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from pathlib import Path

import numpy as np

from experiments.benchmark.design import ENGINES, Case, cases_of, draw_case, engines_here
from experiments.benchmark.logs import engine_log
from experiments.blind import logs as own
from experiments.blind.seal import seal, sealed_hash
from experiments.blind.trial import BlindTrial
from experiments.progress import ProgressCall, silent
from experiments.records.run_folder import writable
from experiments.runs.protocol import read_protocol
from experiments.workers import results_of
from rig.files import naming, write_ours
from rig.log import CONTRACT, Log
from rig.rigfile import write_rig

CASES, RULES, LOG = "cases", "rules.md", "log-1.parquet"
# What is written, by a column's first word: 1 mV (a converter of 13 bits), 1 us, 1 um; of what is
# told 0.1 mm and 0.1 mrad. An angle that is read is an encoder's counts.
DECIMALS = {"t": 6, "voltage": 3, "ball": 6, "target": 4, "command": 4}
SHORTEST_S = 10.0  # a log whose ball fell off earlier is drawn anew
ATTEMPTS = 8
MADE_OF_STEPS = ("voltage_x_V", "voltage_y_V", "theta_x_rad", "theta_y_rad", "command_x_rad")
MADE_OF_STEPS += ("command_y_rad", "target_x_m", "target_y_m", "push")  # few values: dictionaries


@dataclass(frozen=True)
class MadeSet:
    """What was made: SHA-256 of the truth, number of logs, bytes of the cases, what is missing."""

    sha256: str
    logs: int
    size_bytes: int
    left_out: str


def make_set(
    out: Path,
    *,
    seed: int,
    logs: int,
    jobs: int | None = None,
    progress: ProgressCall = silent,
) -> MadeSet:
    """Make the set of a seed in `out`: equal seeds and numbers of logs give equal bytes.

    logs: how many; those of an engine that is not installed are left out, and the result says so.
    jobs: processes (None: one per core). ValueError: `out` holds a set already, no log is asked
    for. OSError: it cannot be written; nothing of the set is left then.
    """
    if logs < 1:
        raise ValueError(f"--logs {logs}: must be at least 1")
    if sealed_hash(out) is not None or (out / CASES).exists():
        raise ValueError(f"{out} holds a benchmark already: choose another folder")
    cases = cases_of(logs, seed)
    here = [case for case in cases if case.engine in engines_here()]
    writable(out)
    try:
        digest = _sealed(here, seed, out, jobs, progress)
    except BaseException:  # half a set would only stand in the way of the next
        shutil.rmtree(out / CASES, ignore_errors=True)
        raise
    size = sum(file.stat().st_size for file in (out / CASES).rglob("*") if file.is_file())
    return MadeSet(digest, len(here), size, _left_out(len(cases) - len(here)))


def _sealed(
    cases: list[Case], seed: int, out: Path, jobs: int | None, progress: ProgressCall
) -> str:
    """Make these cases, their rules and the seal in `out`; the hash of their truth."""
    trials: dict[str, BlindTrial] = {}
    progress("logs", 0, len(cases))
    calls = ((case, seed, out / CASES) for case in cases)
    for trial in results_of(make_case, calls, jobs=jobs):
        trials[trial.name] = trial
        progress("logs", len(trials), len(cases))
    rules = (files("experiments") / "benchmark" / RULES).read_text(encoding="utf-8")
    write_ours(out / RULES, rules.encode(), rules.encode().partition(b"\n")[0])
    return seal([trials[name] for name in sorted(trials)], out)


def _left_out(logs: int) -> str:
    if not logs:
        return ""
    missing = ", ".join(sorted(set(ENGINES) - set(engines_here())))
    return f"{logs} logs of the engine {missing} are left out: install the extra 'benchmark'"


def make_case(case: Case, seed: int, folder: Path) -> BlindTrial:
    """Write the log and the rig file of a case below `folder`; return the trial that was made.

    A log that ends before `SHORTEST_S` is drawn anew, `ATTEMPTS` times at most.
    """
    trial, log = _drawn(case, seed)
    place = folder / trial.name
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    write_rig(trial.nominal_rig, place / "rig.toml")
    write_log(log, place / LOG)
    return trial


def _drawn(case: Case, seed: int) -> tuple[BlindTrial, Log]:
    for attempt in range(ATTEMPTS):
        trial = draw_case(case, seed, attempt)
        log = _recorder(trial)(trial.protocols[0], trial.seeds[0])
        if log["t_s"][-1] - log["t_s"][0] >= SHORTEST_S:
            return trial, log
    raise RuntimeError(f"case {case.number}: the ball fell off in each of {ATTEMPTS} tables")


def _recorder(trial: BlindTrial) -> Callable[[str, int], Log]:
    if trial.engine == "own":
        return partial(own.make_log, trial)
    seconds = read_protocol(trial.protocols[0]).duration_s
    return partial(engine_log, trial, seconds=seconds)


def write_log(log: Log, path: Path) -> None:
    """Write the columns of the contract that hold anything as Parquet, rounded to `DECIMALS`.

    Nothing but names and numbers is written: a file's metadata tell nothing of its origin.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns = {name: rounded(name, log[name]) for name in CONTRACT if log.has(name)}
    steps = [name for name in columns if name in MADE_OF_STEPS]
    smooth = {name: "BYTE_STREAM_SPLIT" for name in columns if name not in steps}
    table = pa.table({n: pa.array(v, pa.float64(), from_pandas=True) for n, v in columns.items()})
    with naming(path):
        pq.write_table(
            table,
            path,
            compression="zstd",
            compression_level=15,
            use_dictionary=steps,  # pyright: ignore[reportArgumentType]
            column_encoding=smooth,
        )


def rounded(name: str, values: np.ndarray) -> np.ndarray:
    """The column's values to `DECIMALS`, or as they are."""
    decimals = DECIMALS.get(name.split("_")[0])
    return values if decimals is None else np.round(values, decimals)
