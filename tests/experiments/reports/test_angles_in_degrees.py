"""Angles are shown in degrees, in every figure and every table."""

import ast

from tests.support import ROOT


def test_no_label_of_a_figure_or_a_table_is_in_radians():
    looked = 0
    for file in (ROOT / "experiments").rglob("*.py"):
        if "export" in file.parts:  # words for other programs, in SI units
            continue
        tree = ast.parse(file.read_text(encoding="utf-8"))
        documented = [n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.ClassDef)]
        told = {ast.get_docstring(n, clean=False) for n in (tree, *documented)}
        for one in ast.walk(tree):
            if isinstance(one, ast.Constant) and isinstance(one.value, str):
                looked += 1
                assert one.value in told or "[rad]" not in one.value, (file, one.value)
    assert looked > 1000
