"""The five steps of the study: which is next, which are done."""

from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import pytest

from experiments.dashboard.server.controls import ControlLock
from experiments.dashboard.session.tasks import RunSummary
from experiments.dashboard.tabs.tour import (
    ENDED_BY_WORD,
    STEPS,
    Tour,
    both_completed,
    next_words,
    tour_words,
)


def marks(*done: bool) -> str:
    return "".join(line[0] for line in tour_words(done).split("\n\n"))


def test_the_first_step_that_is_not_done_is_next():
    assert marks(False, False, False, False, False) == "▶○○○○"
    assert marks(True, False, True, False, False) == "✓▶✓○○"
    assert marks(True, True, True, True, True).startswith("✓✓✓✓✓")
    assert "The study is done" in next_words([True] * 5)
    assert "Next: **5, tab Gap**" in next_words([True] * 4 + [False])


def test_the_step_above_the_tabs_says_which_are_done_and_stands_there_once():
    """Who has calibrated before sees why the guide goes on with another step."""
    done = [True, False, True, True, False]
    said = next_words(done).replace("\u00a0", " ")
    assert "(✓ 1 ▶ 2 ✓ 3 ✓ 4 ○ 5)" in said
    assert STEPS[1][1] in said
    assert STEPS[1][1] not in tour_words(done)
    assert STEPS[4][1] in tour_words(done)


def run(method: str, *, seed: int = 1, outcome: str = "completed") -> RunSummary:
    return RunSummary(Path(method), "free-release", method, seed, outcome)


@pytest.mark.parametrize(
    ("rows", "both"),
    [
        ([], False),
        ([run("with")], False),
        ([run("with"), run("without")], True),
        ([run("with"), run("without", outcome="aborted")], False),
        ([run("with"), run("without", seed=2)], False),
        ([run("sham"), run("without"), run("with")], True),
    ],
)
def test_runs_are_a_pair_when_both_methods_were_completed_with_one_seed(rows, both):
    assert both_completed(rows) is both


@pytest.fixture
def tour():
    """A tour, what was sent to the pages, which steps the program knows to be done, and which of
    step, all steps and button a page shows: 1 holds the controls, 2 watches.
    """
    sent, done, told = [], [False] * len(STEPS), {}

    class Words:
        def __setattr__(self, name: str, value: str) -> None:
            sent.append(value)

    gui = SimpleNamespace(
        add_folder=lambda label, **k: nullcontext(),
        add_markdown=lambda text, **k: Words(),
        add_button=lambda label, **k: SimpleNamespace(label=label, **k),
    )
    controls = SimpleNamespace(button=lambda *what, **k: None, lock=ControlLock().joined(1))
    pages = SimpleNamespace(
        clients={1: None, 2: None},
        tell=lambda page, handle, visible: told.update({(page, id(handle)): visible}),
    )
    guide = Tour(SimpleNamespace(gui=gui), controls, pages, lambda: done)  # pyright: ignore[reportArgumentType]
    guide.add_steps()

    def shows(page: int) -> list[bool]:
        return [told[page, id(one)] for one in (guide._next, guide._folder, guide._next_step)]

    return guide, sent, done, shows


def test_only_a_change_is_sent_to_the_pages(tour):
    guide, sent, done, _ = tour
    guide.draw()
    guide.draw()
    assert sent == [tour_words(done), next_words(done)]
    assert "Next: **1, tab Run**" in sent[1]
    done[0] = True
    guide.draw()
    assert len(sent) == 4
    assert "Next: **2, tab Results**" in sent[3]


def test_what_is_read_or_watched_is_ticked_when_somebody_says_so_or_went_on(tour):
    """The question of a step stays while its answer is on the screen."""
    guide, sent, done, shows = tour
    done[:2] = [True, True]
    guide.draw()
    assert (shows(1), guide._next_step.label) == ([True] * 3, ENDED_BY_WORD[1])
    assert not any(shows(2))  # it watches, and may press none of what the step names
    assert "Next: **2, tab Results**" in sent[-1]
    guide.end_step()
    guide.draw()
    assert shows(1) == [True, True, False]
    assert "Next: **3, tab Replay**" in sent[-1]
    done[2] = True  # a replay begins
    guide.draw()
    assert (shows(1), guide._next_step.label) == ([True] * 3, ENDED_BY_WORD[2])
    assert "Next: **3, tab Replay**" in sent[-1]
    guide.end_step()
    guide.draw()
    assert "Next: **4, tab Calibrate**" in sent[-1]
    assert shows(1) == [True, True, False]


def test_who_goes_on_by_himself_presses_no_button(tour):
    guide, sent, done, shows = tour
    done[:] = [True] * 5
    done[4] = False
    guide.draw()
    assert "Next: **5, tab Gap**" in sent[-1]
    assert shows(1) == [True, True, False]
