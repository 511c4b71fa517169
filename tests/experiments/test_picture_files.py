"""Pictures are written over no link that leads elsewhere."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from experiments.picture_files import write_figure, write_image

IMAGE = np.zeros((4, 4, 3), np.uint8)
WRITERS = {
    "figure": lambda path: write_figure(Figure(), path),
    "image": lambda path: write_image(IMAGE, path),
}


@pytest.mark.parametrize("kind", WRITERS)
def test_a_link_in_its_place_is_replaced_and_what_it_leads_to_stays(tmp_path: Path, kind: str):
    notes, path = tmp_path / "notes.txt", tmp_path / "ball.png"
    notes.write_text("my notes")
    path.symlink_to(notes)
    assert WRITERS[kind](path) == path
    assert notes.read_text() == "my notes"
    assert not path.is_symlink()
    assert path.read_bytes().startswith(b"\x89PNG")
