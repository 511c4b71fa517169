"""`rig gap` on worlds that share no code with it: verdict, names, sizes, and how often it is wrong.

The command line is the only contact: each log is written as CSV beside its rig file, `rig gap` is
run on it, and its JSON is held against what is really there. With --own the rig files name the two
shipped effects of a lab's own, by which two worlds without a name have one.
"""

import argparse
import csv
import json
import subprocess
import sys
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[3]))

from tests.support.worlds import WORLDS
from tests.support.worlds.score import OUTCOMES, ahead, names, outcome, sizes

OWN = Path(__file__).parents[3] / "experiments" / "rigs" / "own_effects"
OWN_NAMES = {
    "pendulum": {"hanging_arm": {"x": {"weight_V": 0.5, "angle_rad": 0.0}}},
    "cable": {"pulling_cable": {"x": {"stiffness_V_rad": 3.0, "slack_rad": 0.1}}},
}
HEADS = ("world", "seed", "outcome", "truth", "verdict", "names", "sizes", "1 s ahead", "seconds")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder of logs and answers")
    parser.add_argument("--seeds", type=int, default=1, help="logs a world")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", choices=sorted(WORLDS), metavar="NAME")
    parser.add_argument("--own", action="store_true", help="with hanging_arm and pulling_cable")
    parser.add_argument("--jobs", type=int, default=2, help="commands at once")
    parser.add_argument("--timeout", type=float, default=900.0, help="seconds a log")
    return parser.parse_args()


def with_own(name: str, rig: str, truth: dict) -> tuple[str, dict]:
    """Rig file and truth of a world whose rig file names the shipped effects of a lab's own."""
    files = sorted(str(file) for file in OWN.glob("*.py"))
    if name in OWN_NAMES:
        truth = truth | {"kind": "effect", "required": OWN_NAMES[name]}
    return f"{rig}[effects]\nown = {json.dumps(files)}\n", truth


def write_csv(path: Path, columns: dict[str, np.ndarray]) -> None:
    """The log as the contract has it; blank cells where no frame arrived."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        for row in zip(*(column.tolist() for column in columns.values()), strict=True):
            writer.writerow("" if value != value else format(value, ".9g") for value in row)


def answer_of(folder: Path, timeout_s: float) -> tuple[dict | None, str]:
    """What `rig gap` says of `folder`, or None and its last line where it failed."""
    command = [str(Path(sys.executable).parent / "rig"), "gap", str(folder / "log.csv")]
    command += ["--rig", str(folder / "rig.toml"), "--json", str(folder / "answer.json")]
    command += ["--out", str(folder / "out"), "--jobs", "1"]
    (folder / "answer.json").unlink(missing_ok=True)
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=timeout_s)
    except subprocess.TimeoutExpired:
        return None, f"no answer in {timeout_s:.0f} s"
    (folder / "printed.txt").write_text(done.stdout + done.stderr, "utf-8")
    if done.returncode != 0:
        return None, (done.stderr.strip() or "no words").splitlines()[-1]
    return json.loads((folder / "answer.json").read_text("utf-8")), ""


def row_of(name: str, seed: int, out: Path, timeout_s: float, *, own: bool) -> tuple[str, ...]:
    """Make one log, ask, compare: the cells of its row."""
    folder = out / f"{name}-{seed}"
    folder.mkdir(parents=True, exist_ok=True)
    columns, rig, truth = WORLDS[name](seed)
    if own:
        rig, truth = with_own(name, rig, truth)
    write_csv(folder / "log.csv", columns)
    (folder / "rig.toml").write_text(rig, "utf-8")
    (folder / "truth.json").write_text(json.dumps(truth, indent=1), "utf-8")
    start = time.perf_counter()
    answer, words = answer_of(folder, timeout_s)
    seconds = f"{time.perf_counter() - start:.0f}"
    really = " + ".join(truth["required"]).replace("|", " or ") or truth["kind"]
    told = (answer["verdict"], names(answer)) if answer else ("failed", words)
    far = ahead(answer) if answer else "-"
    return (
        name,
        str(seed),
        outcome(answer, truth),
        really,
        *told,
        sizes(answer, truth),
        far,
        seconds,
    )


def summary(rows: list[tuple[str, ...]]) -> str:
    """right / confident and wrong / honest / missed / failed, of all."""
    count = Counter(row[2] for row in rows)
    words = {"wrong": "confident and wrong"}
    told = " / ".join(f"{count[o]} {words.get(o, o)}" for o in OUTCOMES)
    return f"{told}, of {len(rows)}"


def main() -> None:
    args = arguments()
    seeds = range(args.first_seed, args.first_seed + args.seeds)
    tasks = [(name, seed) for name in args.only or WORLDS for seed in seeds]
    print(f"| {' | '.join(HEADS)} |\n|{'---|' * len(HEADS)}", flush=True)
    rows = []
    with ThreadPoolExecutor(args.jobs) as pool:

        def ask(task: tuple[str, int]) -> tuple[str, ...]:
            return row_of(*task, args.out, args.timeout, own=args.own)

        for row in pool.map(ask, tasks):
            print(f"| {' | '.join(row)} |", flush=True)
            rows.append(row)
    print(f"\n{summary(rows)}")


if __name__ == "__main__":
    main()
