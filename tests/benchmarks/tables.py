"""Measure, and write what was measured into the page `tests/benchmarks/README.md`.

    python tests/benchmarks/tables.py                 # what there is, and how long it takes
    python tests/benchmarks/tables.py --only speed    # measure it, write its table

each after `uv run --group dev`.

Each table stands between two markers of the page. Under its head (command, commit, machine) goes
what the command printed: tables as they are, other lines as text. Nothing is typed by hand.
"""

import argparse
import os
import platform
import re
import subprocess
import sys
from dataclasses import dataclass
from datetime import date
from pathlib import Path

HERE = Path(__file__).parent
PAGE = HERE / "README.md"


@dataclass(frozen=True)
class Measurement:
    """A command, its program as a path in this folder, and about how many minutes it takes."""

    command: str
    minutes: float


MEASUREMENTS = {
    "speed": Measurement("plant/speed.py", 12),
    "agreement": Measurement("plant/agreement.py --out out/benchmarks/agreement.png", 6),
    "backlash-observers": Measurement("control/play_estimates.py", 2),
    "backlash-calibration": Measurement(
        "calibration/play_calibration.py --rigs 200 --out out/benchmarks/play_calibration.jsonl", 15
    ),
    "regime": Measurement("control/regime.py", 1),
    "geometry": Measurement("vision/geometry.py", 8),
    "seeing-in-the-loop": Measurement("vision/frames.py", 3),
    "ball-in-pixels": Measurement("vision/seeing.py --out out/benchmarks/seeing", 15),
    "random-scenes": Measurement("vision/seeing_random.py", 3),
    "hard-cases": Measurement("vision/cases.py --frames 300", 20),
    "strangers": Measurement("vision/strangers.py --quick --seeds 900 908", 10),
    "fault-campaign": Measurement("hardware/fault_campaign.py --faults 1000 --seed 1", 12),
    "pulse-fault-campaign": Measurement(
        "hardware/fault_campaign.py --faults 330 --seed 1 --board pulses", 10
    ),
    "homing-faults": Measurement("hardware/homing_faults.py --faults 110 --seed 1", 14),
    "firmware-mutants": Measurement("hardware/firmware_mutants.py", 15),
    "kill-9": Measurement("records/kill_nine.py", 11),
    "jitter": Measurement("hardware/loop_jitter.py --seconds 10", 3),
    "camera-run": Measurement("hardware/camera_run.py 3", 3),
    "worlds": Measurement(
        "gap/worlds.py --out out/benchmarks/worlds --seeds 1 --first-seed 1900 --jobs 2", 10
    ),
    "page-load": Measurement("dashboard/dashboard_load.py --pairs 8 --seconds 12 --minutes 30", 40),
    "page-speed": Measurement("dashboard/page_speed.py --rounds 3", 5),
    "stopping": Measurement("hardware/stopping.py --tries 6", 8),
    "position-help": Measurement(
        "control/position_help.py --picture .github/pictures/position.png", 20
    ),
    "next-experiment": Measurement("gap/next_experiments.py --draws 3 --seed 7", 15),
}


def machine() -> str:
    """Cores, processor and Python of this machine."""
    return f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"


def commit() -> str:
    """Short name of the commit, with a plus where the tree is changed."""
    words = ["git", "describe", "--always", "--dirty=+", "--exclude=*"]
    return subprocess.run(
        words, cwd=HERE, capture_output=True, text=True, check=True
    ).stdout.strip()


def as_markdown(printed: str) -> str:
    """Table lines as they are, runs of other lines fenced as text."""
    blocks = re.findall(r"(?:^\|.*\n?)+|(?:^(?!\|).*\n?)+", printed.strip() + "\n", flags=re.M)
    fenced = [
        block.strip() if block.startswith("|") else f"```text\n{block.strip()}\n```"
        for block in blocks
        if block.strip()
    ]
    return "\n\n".join(fenced)


def written(page: str, name: str, text: str) -> str:
    """The page with `text` between the markers of `name`. ValueError: it has none."""
    begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    if begin not in page or end not in page:
        raise ValueError(
            f"{PAGE.name} has no markers {begin} and {end}: write them where it belongs"
        )
    before, rest = page.split(begin, 1)
    return f"{before}{begin}\n{text}\n{end}{rest.split(end, 1)[1]}"


def measure(name: str) -> str:
    """Run a measurement; its head and what it printed. CalledProcessError: it failed."""
    command = MEASUREMENTS[name].command
    script, *arguments = command.split()
    (HERE.parents[1] / "out/benchmarks").mkdir(parents=True, exist_ok=True)
    process = subprocess.run(
        [sys.executable, str(HERE / script), *arguments],
        cwd=HERE.parents[1],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    head = f"`{command}`; {date.today()}, commit {commit()}, {machine()}"
    return f"{head}\n\n{as_markdown(process.stdout)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--only", action="append", choices=tuple(MEASUREMENTS), default=[])
    chosen = parser.parse_args().only
    if not chosen:
        for name, measurement in MEASUREMENTS.items():
            print(f"{name:22s} {measurement.minutes:5.1f} min  {measurement.command}")
    for name in chosen:
        text = measure(name)
        page = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(written(page, name, text), encoding="utf-8")
        print(f"{name}: written to {PAGE.relative_to(HERE.parents[1])}")


if __name__ == "__main__":
    main()
