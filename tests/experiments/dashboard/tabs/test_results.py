"""What the tab Results says of the runs behind its numbers."""

from experiments.dashboard.session.tasks import DrawnFigures
from experiments.dashboard.tabs.results import card


def test_the_settling_time_is_defined_where_it_is_told():
    told = DrawnFigures([], [], table=[["settling time", "8.1 s", "2.3 s", "3.5 times smaller"]])
    assert "within 1.2 times the largest distance there, at least 2 mm" in card(told)
    assert "settled when" not in card(DrawnFigures([], []))
