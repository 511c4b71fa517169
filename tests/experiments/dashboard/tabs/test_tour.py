"""The five steps of the study: which is next, which are done."""

from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import pytest

from experiments.dashboard.session.tasks import RunSummary
from experiments.dashboard.tabs.tour import STEPS, Tour, both_completed, tour_words


def marks(*done: bool) -> str:
    return "".join(line[0] for line in tour_words(done).split("\n\n"))


def test_the_first_step_that_is_not_done_is_next():
    assert marks(False, False, False, False, False) == "▶○○○○"
    assert marks(True, False, True, False, False) == "✓▶✓○○"
    assert marks(True, True, True, True, True).startswith("✓✓✓✓✓")
    assert "The study is done" in tour_words([True] * 5)
    assert "The study is done" not in tour_words([True] * 4 + [False])


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


def test_only_a_change_is_sent_to_the_pages():
    sent, done = [], [False] * len(STEPS)

    class Words:
        def __setattr__(self, name: str, value: str) -> None:
            sent.append(value)

    class Folder(nullcontext):
        def __init__(self, label: str) -> None:
            super().__init__()
            self.label = label

    gui = SimpleNamespace(
        add_folder=lambda label, **k: Folder(label), add_markdown=lambda text: Words()
    )
    tour = Tour(SimpleNamespace(gui=gui), lambda: done)  # pyright: ignore[reportArgumentType]
    tour.draw()
    tour.draw()
    assert sent == [tour_words(done)]
    assert tour._folder.label.endswith("next 1 Run")
    done[0] = True
    tour.draw()
    assert len(sent) == 2
    assert tour._folder.label.endswith("next 2 Results")
    done[1:] = [True] * 4
    tour.draw()
    assert tour._folder.label.endswith("done")
