"""The events of the tab Run: those of one run below its name."""

from experiments.dashboard.tabs.run import events_by_run


def test_rows_of_a_run_stand_below_its_name_the_newest_run_first():
    events = [
        ("run 1 of 2", "0 s: placed"),
        ("run 1 of 2", "3 s: released"),
        ("run 2 of 2", "0 s: placed"),
        ("no run", "<b>"),
    ]
    assert events_by_run(events).split("  \n") == [
        "*Events*",
        "**no run**",
        "&#60;b&#62;",
        "**run 2 of 2**",
        "0 s&#58; placed",
        "**run 1 of 2**",
        "3 s&#58; released",
        "0 s&#58; placed",
    ]
    assert events_by_run([]) == "*Events*"
