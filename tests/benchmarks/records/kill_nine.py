"""Kill -9 at random moments of a recording beside a paced loop; and a disk that is full.

    python tests/benchmarks/records/kill_nine.py [--kills 50] [--seed 0]

Each time: everything up to 0.2 s before the kill is in the file, tick by tick; the `mcap`
package's own reader opens it as it lies there and after `rig recover`. As root it also records
onto a file system of 256 kB until that is full.
"""

import argparse
import os
import random
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

from experiments.records.recording import read_run
from tests.support.killed_program import kill_after, opened_by_mcap, start, whole


def kills(folder: Path, count: int, seed: int) -> None:
    moments = random.Random(seed)
    lost, begin = [], time.monotonic()
    for k in range(count):
        after_s = moments.uniform(0.0, 2.0)
        lost.append(kill_after(folder / str(k), after_s))
        print(
            f"{k + 1:3}/{count}: {time.monotonic() - begin:4.0f} s; killed {after_s:.3f} s after "
            f"the loop's begin, lost {1e3 * lost[-1]:.0f} ms",
            flush=True,
        )
    took_s = time.monotonic() - begin
    ms = 1e3 * np.array(lost)
    print(
        f"{count} kills in {took_s:.0f} s: lost {np.median(ms):.0f} ms of the end (median), "
        f"{ms.max():.0f} ms at most (limit 200); every file opened before and after recovery"
    )


def full_disk(folder: Path) -> None:
    """A tmpfs of 256 kB; the recording ends aborted and readable."""
    disk = folder / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(disk)]
    if os.name != "posix" or os.geteuid() != 0 or subprocess.run(mount).returncode != 0:
        print("full disk: left out, mounting a small file system needs root")
        return
    try:
        program, ticks = start(disk / "run", ticks=folder / "full.ticks")
        _, words = program.communicate(timeout=120)
        run = read_run(disk / "run")
        whole(run, opened_by_mcap(disk / "run"))
        assert "free disk space" in words
        assert run.meta["outcome"] == "aborted"
        print(f"full disk: {len(run.log)} rows, all readable; {run.meta['reason'][-60:]}")
        assert ticks.exists()
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        kills(Path(folder), given.kills, given.seed)
        full_disk(Path(folder))


if __name__ == "__main__":
    main()
