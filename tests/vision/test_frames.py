"""A track without a ball has no position."""

import math
from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from vision.frames import Frame, Track


@pytest.mark.parametrize("state", ["search", "lost"])
def test_track_without_ball_holds_no_number(state):
    track = Track(state)
    numbers = (track.u_px, track.v_px, track.sigma_px, track.radius_px)
    assert all(math.isnan(x) for x in numbers)


def test_frame_is_frozen():
    frame = Frame(np.zeros((2, 3, 3), np.uint8), 0.5, 7)
    with pytest.raises(FrozenInstanceError):
        frame.index = 8  # pyright: ignore[reportAttributeAccessIssue]
