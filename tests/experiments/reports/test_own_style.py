"""Figures look alike, whatever style a user has for figures of their own, which it stays for."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support import ROOT

DRAWS = """
import importlib, matplotlib, sys
matplotlib.rcParams["lines.linewidth"] = 7.0  # as in a notebook's first cell
own, backend = dict(matplotlib.rcParams), matplotlib.get_backend(auto_select=False)
for name in ("reports.figures", "gap.figures", "compare.figures", "calibrate.pictures"):
    importlib.import_module(f"experiments.{name}")
import numpy as np
from experiments.reports.figures import ball_of_run, save
from pathlib import Path
from rig.log import Log
t = np.arange(60) / 60
log = Log.from_columns({"t_s": t, "ball_x_m": 0 * t, "ball_y_m": 0 * t, "phase": 2 + 0 * t})
print(save(ball_of_run(log, "red"), Path(sys.argv[1]), "ball", "simulated"))
assert dict(matplotlib.rcParams) == own
assert matplotlib.get_backend(auto_select=False) == backend
assert "matplotlib.pyplot" not in sys.modules or not sys.modules["matplotlib.pyplot"].get_fignums()
"""


@pytest.fixture
def drawn(tmp_path: Path):
    def draw(style: str) -> bytes:
        """A figure (PNG) as it is drawn where the user's matplotlibrc says this."""
        folder = tmp_path / str(len(style))
        folder.mkdir()
        (folder / "matplotlibrc").write_text(style)
        done = subprocess.run(
            [sys.executable, "-c", DRAWS, str(folder)],
            cwd=folder,
            env={k: v for k, v in os.environ.items() if k != "MPLBACKEND"}
            | {"PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return Path(done.stdout.strip()).read_bytes()

    return draw


def test_a_users_style_changes_no_figure_and_stays_for_figures_of_theirs(drawn):
    plain = drawn("")
    assert plain == drawn("text.usetex: True\naxes.labelsize: 500\nfont.size: 3\n")


def test_every_function_that_makes_a_figure_draws_it_in_our_style():
    made = 0
    for file in (ROOT / "experiments").rglob("*.py"):
        for one in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if not isinstance(one, ast.FunctionDef) or one.name == "subplots":
                continue
            calls = [ast.unparse(c.func) for c in ast.walk(one) if isinstance(c, ast.Call)]
            if "subplots" in calls:
                made += 1
                assert "our_style()" in map(ast.unparse, one.decorator_list), (file, one.name)
    assert made > 20


SAYS = """
from experiments.cli.error_words import error_words
try:
    import matplotlib.figure
except UnicodeDecodeError as error:
    print(error_words(error))
"""


def test_a_style_that_is_no_text_is_named_in_one_line(tmp_path: Path):
    """It was a byte at a place, of no file."""
    (tmp_path / "matplotlibrc").write_bytes(b"font.size: 12  # caf\xe9\n")
    done = subprocess.run(
        [sys.executable, "-c", SAYS],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    (said,) = done.stdout.splitlines()
    assert said.startswith(f"{tmp_path}/matplotlibrc, matplotlib's own settings, is no UTF-8 text")


def test_the_doctor_says_that_no_figure_can_be_drawn(tmp_path: Path):
    (tmp_path / "matplotlibrc").write_bytes(b"font.size: 12  # caf\xe9\n")
    asks = "from experiments.cli.application import app; app(['doctor'])"
    done = subprocess.run(
        [sys.executable, "-c", asks],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0
    (said,) = [line for line in done.stdout.splitlines() if "figures:" in line]
    assert f"{tmp_path}/matplotlibrc, matplotlib's own settings, is no UTF-8 text" in said
