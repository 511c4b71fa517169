"""The tracker on real footage, against places that were read by eye from its raw frames."""

import csv

import numpy as np
import pytest

from tests.support import DATA
from tests.support.parts import FOOTAGE, needs
from vision.detection.appearance import Appearance
from vision.sources.sources import open_source
from vision.tracking.tracker import Tracker

LABELS = DATA / "balancing_1_labels.csv"
OFF_PX = 8.0


def labels() -> dict[int, tuple[float, float]]:
    """Index in the file -> (u, v) px."""
    with LABELS.open() as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        return {int(r["frame"]): (float(r["u_px"]), float(r["v_px"])) for r in rows}


def longest(flags) -> int:
    """Length of the longest run of true flags."""
    best = run = 0
    for flag in flags:
        run = run + 1 if flag else 0
        best = max(best, run)
    return best


@needs("footage")
@pytest.mark.slow
@pytest.mark.parametrize("colour", [None, "green"])
def test_real_footage_is_followed_to_its_end(colour):
    tracker = Tracker(appearance=Appearance.of_colour(colour) if colour else None)
    with open_source(FOOTAGE) as source:
        tracks = {frame.index: tracker.step(frame) for frame in source}
    first = next(k for k, t in enumerate(tracks.values()) if t.state == "track")
    states = [t.state for t in tracks.values()][first:]
    # It rests for the first 70 frames: without a colour there is nothing to tell it by until then.
    assert first <= (75 if colour is None else 1)
    assert states.count("track") > 0.98 * len(states)
    assert longest(s not in ("track", "coast") for s in states) <= 2
    off = []
    for index, place in labels().items():
        track = tracks[index]
        if track.state == "track":
            off.append(float(np.hypot(track.u_px - place[0], track.v_px - place[1])))
    assert len(off) > 170
    assert float(np.median(off)) < 2.0
    assert sum(o > OFF_PX for o in off) <= 0.005 * len(off)
    assert longest(o > OFF_PX for o in off) == 0
