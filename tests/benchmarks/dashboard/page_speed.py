"""How long the page lets a person wait: for the camera's first picture, and for the gap's demo.

`uv run python tests/benchmarks/dashboard/page_speed.py --rounds 3`
Four pages watch. The camera: from the tick to its first picture in the page, the process that sees
has still to start. The demo: in the page, beside the loop that balances its table, and by
`rig gap --demo` on the command line, in turn.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from tests.benchmarks.dashboard.dashboard_load import Pages, state
from tests.support.waiting import wait_for

MOST_S = 1200.0
PICTURE_GOAL_S, DEMO_GOAL = 5.0, 1.5


def first_picture_s(app) -> float:
    begun = time.monotonic()
    app.camera.set_wanted(True)
    wait_for("the first picture", lambda: "<img" in app.camera._picture.content, MOST_S)
    took = time.monotonic() - begun
    app.camera.set_wanted(False)
    return took


def demo_in_page_s(app) -> tuple[float, float]:
    """Seconds to the answer, and the longest for which the bar stood still."""
    begun = moved = time.monotonic()
    still_s, bar, before = 0.0, app.gap._bar.value, app.gap.answer
    app.gap.begin(None, None)
    while app.gap.answer is before:
        assert time.monotonic() < begun + MOST_S, app.gap._words.content
        assert not app.gap._words.content.startswith("**stopped**"), app.gap._words.content
        if app.gap._bar.value != bar:
            bar, moved = app.gap._bar.value, time.monotonic()
        still_s = max(still_s, time.monotonic() - moved)
        time.sleep(0.05)
    return time.monotonic() - begun, still_s


def demo_in_shell_s(out: Path) -> float:
    begun = time.monotonic()
    command = [sys.executable, "-m", "experiments.cli", "gap", "--demo", "--out", str(out)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.monotonic() - begun


def in_page(out: Path) -> tuple[float, float, float]:
    """Of a program that was just started: the first picture, the demo, how long its bar stood."""
    from experiments.dashboard.app import App
    from experiments.dashboard.server.server import open_server
    from experiments.runs.assemble import load_rig

    server, gate = open_server("127.0.0.1", 0, "benchmark-token-" + "x" * 20)
    app = App(server, load_rig(None), out)
    try:
        state(app, "balancing")
        with Pages(gate, True):
            return (first_picture_s(app), *demo_in_page_s(app))
    finally:
        app.close()
        server.stop()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    rounds = parser.parse_args().rounds
    rows = []
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as out:
            picture, page, still = in_page(Path(out))
            shell = demo_in_shell_s(Path(out) / "shell")
        rows.append((picture, page, shell, page / shell, still))
    low, middle, high = np.percentile(rows, [0, 50, 100], axis=0)
    said = [f"{b:.2g} ({a:.2g} to {c:.2g})" for a, b, c in zip(low, middle, high, strict=True)]
    print("| measure | median (all) | goal |\n|---|---|---|")
    print(f"| camera, from the tick to the first picture, s | {said[0]} | {PICTURE_GOAL_S:g} |")
    print(f"| demo of the gap in the page, s | {said[1]} | - |")
    print(f"| the same on the command line, s | {said[2]} | - |")
    print(f"| ratio | {said[3]} | {DEMO_GOAL:g} |")
    print(f"| longest time for which its bar stood still, s | {said[4]} | - |")
    print(f"\n{rounds} rounds.")


if __name__ == "__main__":
    main()
