"""What else could explain the effect: the rivals of the backlash model."""

import pytest

from experiments.paper import alternative_explanations
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
