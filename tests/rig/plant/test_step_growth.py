"""A drive that the integration step cannot follow is refused; what leaves all bounds is named."""

import re
from dataclasses import replace
from math import inf

import numpy as np
import pytest

from rig.parameters import Drive, Rig
from rig.plant import plant_record
from rig.rigfile import read_rig
from rig.simulation.simulator import DivergedError, SimulatedTable
from tests.support import ROOT

TICKS = 400


def diverges(rig: Rig) -> bool:
    """Whether motors that are turned to and fro leave all bounds."""
    table = SimulatedTable(rig, np.random.default_rng(0))
    try:
        for tick in range(TICKS):
            table.read()
            table.drive((2.0 * np.sin(tick / 20), 1.0))
    except DivergedError:
        return True
    return False


@pytest.mark.parametrize(
    ("key", "sound", "wild"),
    [
        ("gear_stiffness_nm_rad", 1.2e4, 2.5e4),
        ("joint_stiffness_nm_rad", 1.0e4, 1.3e4),
        ("joint_damping_nm_s", 0.4, 3.0),
        ("plate_inertia_kg_m2", 4e-6, 1e-12),
    ],
)
def test_a_drive_is_refused_if_and_only_if_its_simulation_diverges(monkeypatch, key, sound, wild):
    rigs = [replace(Rig(), drive=replace(Drive(), **{key: value})) for value in (sound, wild)]
    assert plant_record.step_growth(plant_record.pack(rigs[0])) <= 1.0 + 1e-9
    assert not diverges(rigs[0])
    with pytest.raises(ValueError, match="cannot be simulated in steps"):
        plant_record.pack(rigs[1])
    monkeypatch.setattr(plant_record, "GROWTH_MARGIN", inf)
    assert diverges(rigs[1])


@pytest.mark.parametrize("key", ["plate_inertia_kg_m2", "gear_stiffness_nm_rad"])
def test_a_drive_beyond_the_range_of_numbers_is_refused_by_the_same_line(key: str):
    value = 5e-324 if key.startswith("plate") else 1e308
    with pytest.raises(ValueError, match=re.escape(f"{key} = {value:g}")):
        plant_record.pack(replace(Rig(), drive=replace(Drive(), **{key: value})))


def test_the_shipped_rigs_can_be_simulated():
    for name in ("default", "hobby-two-servos", "bus-servos", "three-arms"):
        plant_record.pack(read_rig(ROOT / f"experiments/rigs/{name}.toml"))
