"""Words of the page are read in both looks: 4.5:1 from what is behind them, as WCAG 2 asks."""

from pathlib import Path

import pytest

from experiments.dashboard.tabs.calibrate import COLOURS
from tests.support.in_browser.contrast import faint_words
from tests.support.in_browser.page import TABS, Hand
from tests.support.in_browser.program import Program
from tests.support.shell_alone import ShellAlone, opened

LOOKS = ("light", "dark")


@pytest.mark.slow
@pytest.mark.realtime
@pytest.mark.timeout(900)  # chosen: a loaded machine takes ten times as long as a quiet one
def test_all_words_of_all_tabs_are_read(chromium, artefacts: Path, tmp_path: Path):
    program = Program(tmp_path)
    try:
        hand = Hand(chromium, program.link, artefacts)
        hand.see("ball in sight")
        for looks in LOOKS:
            for name in ("Curves", "Swing", "Camera", "Legend", *TABS):
                hand.tab(name)
                hand.page.wait_for_timeout(300)
                assert faint_words(hand.page) == [], f"{name}, {looks}"
            hand.press("Dark" if looks == "light" else "Light")
        hand.page.goto(f"{hand.page.url.partition('?')[0]}view")
        hand.page.get_by_text("cm from the target").wait_for()
        assert faint_words(hand.page) == []
        hand.close()
    finally:
        program.kill()


@pytest.mark.slow
@pytest.mark.parametrize("looks", LOOKS)
def test_a_button_of_any_colour_is_read_and_a_field_that_cannot_be_used(
    chromium, program: ShellAlone, looks: str
):
    gui = program.server.gui
    for colour in {*COLOURS.values(), "green", "gray"}:
        gui.add_button(f"a button, {colour}", color=colour)
        gui.add_button(f"that cannot be used, {colour}", color=colour, disabled=True)
    gui.add_slider("a slider", 0.0, 1.0, 0.1, 0.5, disabled=True)
    gui.add_dropdown("a list", ("one", "two"), disabled=True)
    gui.add_button_group("a group", ("left", "right"))
    page = opened(chromium, program, color_scheme=looks)
    page.get_by_text("that cannot be used").first.wait_for(timeout=120e3)
    page.wait_for_timeout(300)  # colours change by and by
    assert faint_words(page) == []
    page.context.close()
