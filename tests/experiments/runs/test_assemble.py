"""Which rig a command works on: a file, a shipped table by its name, or the default."""

from pathlib import Path

import numpy as np
import pytest

from experiments.runs.assemble import MAX_TILT_RAD, load_rig, virtual_renderer
from rig.plant.ball import plate_rotation
from rig.rigfile import read_rig
from tests.support import ROOT

SHIPPED = sorted((ROOT / "experiments/rigs").glob("*.toml"))


@pytest.mark.parametrize("file", SHIPPED, ids=lambda file: file.stem)
def test_a_shipped_table_is_found_by_its_name(file: Path):
    assert load_rig(Path(file.stem)) == read_rig(file)


def test_a_file_of_that_name_comes_first(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("three-arms").write_bytes((ROOT / "experiments/rigs/bus-servos.toml").read_bytes())
    assert load_rig(Path("three-arms")) == load_rig(Path("bus-servos"))


def test_what_is_missing_is_told_with_what_there_is():
    with pytest.raises(FileNotFoundError, match=r"no\.toml not found; shipped: bus-servos, d"):
        load_rig(Path("no.toml"))


@pytest.mark.parametrize("name", ["default", "hobby-two-servos", "bus-servos", "three-arms"])
def test_the_virtual_camera_sees_all_markers_of_a_table_level_and_tilted(name: str):
    made = virtual_renderer(load_rig(Path(name)), np.random.default_rng(1))
    corners = made.scene.layout.corners_m.reshape(-1, 2)
    size = made.view.camera.width_px, made.view.camera.height_px
    most = np.sin(MAX_TILT_RAD)
    for sines in ((0.0, 0.0), (most, 0.0), (-most, 0.0), (0.0, most), (0.0, -most)):
        view = made.view.tilted(plate_rotation(sines))
        uv = view.pixel_from_plate(np.column_stack((corners, np.zeros(len(corners)))))
        assert (uv > 3).all()
        assert (uv < np.array(size) - 4).all()
