"""What a column's name and unit say in the languages that labs write."""

import pytest

from experiments.importing.names import hint


@pytest.mark.parametrize(
    ("name", "role", "axis", "unit"),
    [
        ("Sollwinkel X [mrad]", "command", "x", "mrad"),
        ("Istwinkel Y [°]", "theta", "y", "deg"),
        ("Kugelposition Y [mm]", "ball", "y", "mm"),
        ("Tijd (s)", "time", None, "s"),
        ("Servo Y gewenst (graden)", "command", "y", "deg"),
        ("hoek_x_gemeten", "theta", "x", None),
        ("referencia_x_mm", "target", "x", "mm"),
        ("posx_mm", "ball", "x", "mm"),
        ("Comando motore 1 [gradi]", "command", "x", "deg"),
        ("Ángulo servo Y (grados)", "angle", "y", "deg"),
        ("raw_rotation", "angle", None, None),
    ],
)
def test_compounds_and_spelled_units(name: str, role: str, axis: str, unit: str):
    found = hint(name)
    assert (found.role, found.axis, found.unit) == (role, axis, unit)
