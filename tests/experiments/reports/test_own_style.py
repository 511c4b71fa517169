"""Figures look alike, whatever style a user has for figures of their own."""

import os
import subprocess
import sys
from pathlib import Path

from tests.support import ROOT


def test_a_matplotlibrc_of_the_users_changes_no_figure(tmp_path: Path):
    (tmp_path / "matplotlibrc").write_text("text.usetex: True\naxes.labelsize: 500\n")
    code = (
        "from experiments.reports.figures import plt\n"
        "print(plt.rcParams['text.usetex'], plt.rcParams['axes.labelsize'], plt.get_backend())"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.lower().split() == ["false", "medium", "agg"], done.stderr
