"""Commands on a disk that fills up: what each says, and that nothing that was there is harmed.

    mount -t tmpfs -o size=8m tmpfs FOLDER
    python tests/benchmarks/records/full_disk.py FOLDER

FOLDER, on a small disk of its own, is emptied before each try. Prints a table: per command and
bytes left its exit code and last line. Exit code 1 where a command ended with another code than 0
or 1, failed with more or less than one line, or failed and changed a file that was there.
"""

import argparse
import os
import shutil
import sys
import tempfile
from pathlib import Path

from experiments.records.recording import Recorder, read_run
from tests.support.command import told
from tests.support.other_labs.labs import LABS

LEFT = (0, 4096, 30_000, 100_000, 400_000)  # bytes; chosen: before, within and behind first files
LARGEST = 1 << 26  # bytes of a disk that is small
FILLER = "filler"
COMMANDS = {
    "run": "run servo-squares --arm with --repetitions 1 --out {disk}/out",
    "report": "report {run} --out {disk}/out",
    "recover": "recover {disk}/cut",
    "reject": "reject {disk}/run why",
    "export csv": "export {run} --out {disk}/older.csv",
    "export parquet": "export {run} --out {disk}/older.parquet",
    "export mat": "export {run} --out {disk}/older.mat",
    "import": "import {log} --yes --out {disk}/older.csv",
    "gap": "gap {run} --until locate --out {disk}/out",
    "watch": "watch {runs} --out {disk}/out",
    "sheet": "sheet play --student Ada --out {disk}/out",
    "calibration sheet": "calibrate sheet --out {disk}/out",
    "model": "export-model default --as mjcf --out {disk}/older.xml",
    "benchmark": "benchmark make --logs 1 --seed 1 --jobs 1 --out {disk}/out",
}
OLDER = ("older.csv", "older.parquet", "older.mat", "older.xml")


def prepared(folder: Path) -> dict[str, Path]:
    """A recorded run, one that was cut off, and another lab's log, in `folder`."""
    code, _, said = told(*COMMANDS["run"].format(disk=folder).split())
    assert code == 0, said
    run = next((folder / "out" / "runs").iterdir())
    recorded = read_run(run)
    start = {key: recorded.meta[key] for key in ("source", "protocol", "arm", "seed", "rig")}
    cut = Recorder(folder / "cut", start)
    for row in recorded.log.rows[:3000]:
        cut.append(row)
    os.close(cut._file)
    log, _ = LABS["german_hobby"](folder, seed=1)
    return {"run": run, "runs": run.parent, "cut": folder / "cut", "log": log}


def filled(disk: Path, made: dict[str, Path], left: int) -> dict[Path, bytes]:
    """Empty the disk, put a run, one that was cut off and older files there, fill all but `left`
    bytes; what is there."""
    for path in disk.iterdir():
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    for name in ("run", "cut"):
        shutil.copytree(made[name], disk / name)
    for name in OLDER:
        (disk / name).write_text("made before")
    about = os.statvfs(disk)
    (disk / FILLER).write_bytes(bytes(max(about.f_bavail * about.f_frsize - left, 0)))
    there = [path for path in disk.rglob("*") if path.is_file() and path.name != FILLER]
    return {path: path.read_bytes() for path in there}


def main() -> None:
    """Try every command at every size, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("disk", type=Path, metavar="FOLDER")
    parser.add_argument("--only", nargs="*", default=list(COMMANDS), help="Names of commands.")
    asked = parser.parse_args()
    about = os.statvfs(asked.disk)
    if about.f_blocks * about.f_frsize > LARGEST:
        sys.exit(f"{asked.disk} is on a disk of more than {LARGEST} bytes, which would be filled")
    tries = faults = 0
    print("| command | bytes left | exit code | last line | |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        made = prepared(Path(name))
        for command in asked.only:
            for left in LEFT:
                before = filled(asked.disk, made, left)
                words = COMMANDS[command].format(disk=asked.disk, **made).split()
                code, _, error = told(*words)
                if code > 128:  # a signal, which was meant for this program
                    sys.exit(code)
                said = [line for line in error.splitlines() if line.startswith("rig: ")]
                changed = [
                    p for p, data in before.items() if not p.exists() or p.read_bytes() != data
                ]
                bad = code not in (0, 1) or len(said) != code or "Traceback" in error
                bad = bad or (code == 1 and bool(changed))
                tries, faults = tries + 1, faults + bad
                last = said[-1].replace(str(asked.disk), "FOLDER") if said else ""
                print(
                    f"| {command} | {left} | {code} | {last} | {'FAULT' if bad else ''} |",
                    flush=True,
                )
    print(f"{tries} tries, {faults} faults")
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
