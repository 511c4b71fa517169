"""Copies of this process in which a lab's own code is tried."""

import sys
import time

import cv2
import numpy as np
import pytest

from rig.foreign_trial import Tells, in_copy

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="no copy of the program there")


@pytest.mark.parametrize("threads", [1, 3])
def test_pictures_are_worked_on_in_a_copy_of_a_program_that_did_so_on_several_threads(threads: int):
    """OpenCV's own threads are not copied: a copy that waits for them hangs."""
    image = np.random.default_rng(0).integers(0, 255, (2000, 2000, 3), np.uint8)

    def blurred() -> int:
        return int(cv2.filter2D(image, -1, np.full((9, 9), 1 / 81)).sum())

    def work(tells: Tells) -> int:
        tells.begins("it", 60.0)
        cv2.setNumThreads(threads)
        return blurred()

    before = cv2.getNumThreads()
    cv2.setNumThreads(4)
    try:
        here = blurred()
        time.sleep(0.3)  # they wait for work
        assert in_copy(work) == here
        assert cv2.getNumThreads() == 4
        assert blurred() == here
    finally:
        cv2.setNumThreads(before)
