"""Tables of the page fit its panel whatever the numbers and names of the runs."""

from dataclasses import replace
from pathlib import Path

import pytest

from experiments.dashboard.server.untrusted_text import measured
from experiments.dashboard.session.tasks import LONGEST_WORDS, DrawnFigures, RunSummary
from experiments.dashboard.tabs.gap import beside_list
from experiments.dashboard.tabs.header import set_looks
from experiments.dashboard.tabs.results import card, table
from tests.support.in_browser.page import CUT_OFF, nothing_cut_off
from tests.support.shell_alone import ShellAlone, opened

SIZES = ((1024, 1400), (1280, 1400), (390, 1600))
FOLDER = Path("20251130T063720-squares_of_a_lab-without-1000")
LONG = RunSummary(
    FOLDER,
    "servo_squares_with_a_name_of_a_lab",
    "retuned_gains_and_smith_predictor",
    1000,
    "aborted",
    by_hand=("1012.3 s: push to the left, 0.15 m/s",),
    reason="stopped_by_a_watchdog_of_the_lab",
)
ORDINARY = RunSummary(
    Path("20251130T063720-free-release-with"), "free-release", "with", 1, "completed"
)
SIZE = "-123.46 [-1234.57, +1234.57] deg"


def words_with_extremes() -> list[str]:
    """Markdown of the page's tables with long names and large numbers."""
    unbroken = replace(LONG, protocol="w" * LONGEST_WORDS, folder=Path("runs_without_a_time"))
    cell = "123.45 cm (120.12 to 1234.56, 8 runs); 4 x ball not seen"
    rows = [["distance from the target, RMS", cell, cell, "1234.5 times smaller"]]
    truth = [f"| joint play, {axis} | {measured(SIZE)} | 1.5 deg | differs |" for axis in "xy"]
    found = f"| servo: breaks away at, down, x | {measured(SIZE.replace('deg', 'rad/(s V)'))} |"
    return [
        table([ORDINARY], {}),
        table([ORDINARY, LONG], {one.folder.name: (-123.45, 100.0) for one in (ORDINARY, LONG)}),
        table([unbroken], {unbroken.folder.name: (-123.45, 100.0)}),
        card(DrawnFigures([], [LONG], "1234.5 times nearer.", rows, (1000, 1000))),
        beside_list([["coulomb friction, level", "x", SIZE, SIZE, "-1234.56 deg", "differs"]]),
        "\n".join(["| play | found | true | |", "|---|---|---|---|", *truth]),
        "\n".join(["| quantity | found |", "|---|---|", found]),
    ]


@pytest.mark.slow
def test_tables_fit_the_panel_whatever_they_say(chromium, program: ShellAlone, artefacts: Path):
    gui = program.server.gui
    gui.reset()
    set_looks(program.server)
    for words in words_with_extremes():
        gui.add_markdown(words)
    page = opened(chromium, program)
    page.get_by_text("breaks away").wait_for(timeout=120e3)
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_timeout(500)
        page.screenshot(path=str(artefacts / f"extremes-{width}.png"))
        nothing_cut_off(page)
        for outcome in page.get_by_text("completed", exact=True).all():  # the word is whole
            assert outcome.evaluate("one => one.getClientRects().length") == 1
    page.context.close()


def test_words_that_do_not_fit_are_told_from_what_is_drawn_beside_them(chromium):
    page = chromium.new_page()
    page.set_content(
        "<style>button { display: block; position: relative; overflow: hidden; "
        "white-space: nowrap } .rule::after { content: ''; position: absolute; width: 200%; "
        "left: 100%; height: 1px }</style>"
        "<button class=rule>whole</button><button style='width: 40px'>cut off here</button>"
    )
    assert page.evaluate(CUT_OFF) == ["does not fit: cut off here"]
    page.close()
