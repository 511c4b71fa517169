"""Tables whose servos take an angle, by hand in a real browser: each shipped file, every tab."""

import os
import re
from pathlib import Path

import pytest

from tests.support import ROOT
from tests.support.in_browser.page import Hand
from tests.support.in_browser.program import FLAGS, PATIENCE_S, Program, sees_table
from tests.support.parts import PARTS
from tests.support.waiting import wait_for

TABS = ("Run", "Calibrate", "Results", "Gap", "Replay")


@pytest.fixture
def chromium():
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=PARTS["chromium"].find(), args=FLAGS)
        yield browser
        browser.close()


@pytest.mark.slow
@pytest.mark.timeout(1800)  # chosen: a loaded machine takes ten times as long as a quiet one
@pytest.mark.parametrize("name", ["hobby-two-servos", "bus-servos", "three-arms"])
def test_a_table_is_balanced_run_and_calibrated_in_the_page(chromium, name, tmp_path: Path):
    artefacts = Path(os.environ.get("RIG_ARTEFACTS", tmp_path / "shots"))
    artefacts.mkdir(parents=True, exist_ok=True)
    program = Program(tmp_path, rig=ROOT / "experiments" / "rigs" / f"{name}.toml")
    try:
        page = Hand(chromium, program.link, artefacts, sharp=True)
        page.see("Balancing")
        page.see("ball in sight")

        def seen() -> bool:
            spread, ball, plate = sees_table(page.view())
            return spread > 15 and ball > 40 and plate > 2000

        wait_for("ball and plate in the 3-D view", seen, PATIENCE_S, every_s=0.2)
        for tab in TABS:
            page.tab(tab)
            page.shot(f"{name}-{tab.lower()}")
            page.nothing_cut_off()
        if name != "three-arms":  # a minute of processor time there, on a quiet machine
            page.tab("Calibrate")
            page.press(re.compile("^servo: lag"))
            page.see(re.compile("✓ servo"))
            page.shot(f"{name}-servo")
        assert (tmp_path / "program.log").read_text().count("Traceback") == 0
    finally:
        program.kill()
