"""Planted faults and good sets, several seeds each: is every fault named, does every good set pass?

`python tests/benchmarks/calibration/calibration_faults.py [seeds]`; about 15 s a seed.
"""

import argparse
import sys
from time import process_time

import cv2

from calibration.camera.lens import calibrate_images
from calibration.camera.sheet import Sheet
from tests.support.planted_pictures import FAULTS, good_set, pictures, verdict

GOOD, RENDERED = 20, 2


def main() -> None:
    """Print one row a fault and one for the good sets of either kind."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("seeds", type=int, nargs="?", default=3)
    seeds, start = parser.parse_args().seeds, process_time()
    cv2.setNumThreads(1)
    print(f"| planted fault | named | refused | warned | passed | what was said ({seeds} seeds) |")
    print("|---|---|---|---|---|---|")
    for fault in FAULTS:
        found = [verdict(fault, seed) for seed in range(seeds)]
        named = sum(fault.name in said for _, said in found)
        counts = [sum(outcome == word for outcome, _ in found) for word in
                  ("refused", "warned", "passed")]  # fmt: skip
        said = found[0][1]
        said = said if len(said) < 90 else said[:90] + "..."
        print(f"| {fault.title} | {named}/{seeds} | {' | '.join(map(str, counts))} | {said} |")
        sys.stdout.flush()
    _good("good sets, random cameras", [lambda s=s: good_set(s) for s in range(GOOD * seeds)])
    sets = [
        lambda s=s: calibrate_images(pictures(s, Sheet(), 24), Sheet()) for s in range(RENDERED)
    ]
    _good("good sets, rendered pictures", sets)
    print(f"\n{process_time() - start:.0f} s CPU")


def _good(title: str, sets: list) -> None:
    outcomes = []
    for make in sets:
        try:
            outcomes.append("warned" if make().warnings else "passed")
        except ValueError as error:
            outcomes.append(f"refused: {error}")
    counts = {word: sum(o.startswith(word) for o in outcomes) for word in
              ("refused", "warned", "passed")}  # fmt: skip
    odd = next((o for o in outcomes if o != "passed"), "")
    row = " | ".join(str(count) for count in counts.values())
    print(f"| {title} ({len(sets)}) | - | {row} | {odd} |")


if __name__ == "__main__":
    main()
