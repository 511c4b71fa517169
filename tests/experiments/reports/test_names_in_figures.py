"""Names of runs in figures are shown as they are, whatever they would mean as mathematics."""

from pathlib import Path

import matplotlib.pyplot as plt
import pytest

from experiments.reports.figures import save


@pytest.mark.parametrize("name", ["$\\frac{$", "5 $ or $x^$", "a_b^{c"])
def test_no_name_breaks_a_figure(tmp_path: Path, name: str):
    figure, axes = plt.subplots()
    axes.set_title(name)
    axes.plot([0, 1], label=name)
    axes.legend()
    assert name in Path(save(figure, tmp_path, "x", "simulated")).with_suffix(".svg").read_text()
