"""Which rig a command works on: a file, a shipped table by its name, or the default."""

from pathlib import Path

import pytest

from experiments.runs.assemble import load_rig
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
