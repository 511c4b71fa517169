"""What else could explain the effect: the rivals of the backlash model."""

from math import inf, nan

import pytest

from experiments.paper import alternative_explanations
from experiments.paper.alternatives_report import _with_interval
from experiments.runs.assemble import load_rig
from tests.support import ROOT


@pytest.mark.parametrize(("name", "most"), [("default", 4.5), ("three-arms", 1.28 * 4.5 / 3.45)])
def test_the_retuned_pid_is_sought_around_the_tables_own_gains(name, most, monkeypatch):
    """Gains of one table are no gains of another: three arms answer six times as strongly."""
    tried = []

    def rows(wanted):
        tried.extend(group[0].kind.gains.proportional_rad_m for group in wanted)
        return [[{"servo_activity": 1.0, "settled_error": 1.0}] for _ in wanted]

    monkeypatch.setattr(alternative_explanations, "_rows", rows)
    rig = load_rig(ROOT / "experiments" / "rigs" / f"{name}.toml")
    alternative_explanations.retuned(rig, 1)
    assert max(tried) == pytest.approx(most)
    assert min(tried) == pytest.approx(most * 2.5 / 4.5)


@pytest.mark.parametrize(
    ("value", "low", "high", "n", "said"),
    [
        (nan, -inf, inf, 0, "no value, n = 0"),
        (2.0, -inf, inf, 1, "2.000, n = 1"),
        (2.0, 1.0, 3.0, 2, "2.000 [1.000, 3.000], n = 2"),
    ],
)
def test_what_no_run_has_is_no_number(value, low, high, n, said):
    """It stood in the report as "nan [-inf, inf], n = 0"."""
    found = {"value": value, "low": low, "high": high, "n": n}
    assert _with_interval(found, "settled_error") == said
