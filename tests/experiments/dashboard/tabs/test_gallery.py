"""Pictures that a folder holds: shown, or refused at once."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from experiments.dashboard.session.tasks import CaptionedPicture
from experiments.dashboard.tabs.gallery import WIDEST_PX, pixels


def test_a_picture_is_shown_as_rgb_and_not_wider_than_a_panel(tmp_path: Path):
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), np.full((100, 2 * WIDEST_PX, 3), (255, 0, 0), np.uint8))
    found = pixels(CaptionedPicture(path, "a"))
    assert found.shape == (50, WIDEST_PX, 3)
    assert found[0, 0].tolist() == [0, 0, 255]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes with a name")
def test_what_is_no_picture_is_refused_and_a_pipe_not_waited_for(tmp_path: Path):
    pipe, text, empty = (tmp_path / name for name in ("pipe.png", "text.png", "empty.png"))
    os.mkfifo(pipe)
    text.write_text("no picture")
    empty.touch()
    for path in (pipe, text, empty):
        with pytest.raises(OSError, match="not readable as a picture"):
            pixels(CaptionedPicture(path, "a"))


def test_a_picture_that_would_fill_the_memory_is_refused_by_its_head(tmp_path: Path):
    path = tmp_path / "big.png"
    cv2.imwrite(str(path), np.zeros((12_000, 12_000), np.uint8))  # a few kB, 432 MB as colours
    with pytest.raises(OSError, match="not readable as a picture: it has more than"):
        pixels(CaptionedPicture(path, "a"))
