"""Tables whose servos take an angle, by hand in a real browser: each shipped file, every tab."""

import re
from pathlib import Path

import pytest

from tests.support import ROOT
from tests.support.in_browser.page import TABS, Hand
from tests.support.in_browser.program import Program


@pytest.mark.slow
@pytest.mark.timeout(1800)  # chosen: a loaded machine takes ten times as long as a quiet one
@pytest.mark.parametrize("name", ["hobby-two-servos", "bus-servos", "three-arms"])
def test_a_table_is_balanced_run_and_calibrated_in_the_page(
    chromium, name, artefacts: Path, tmp_path: Path
):
    program = Program(tmp_path, rig=ROOT / "experiments" / "rigs" / f"{name}.toml")
    try:
        page = Hand(chromium, program.link, artefacts, sharp=True)
        page.see("Balancing")
        page.see("ball in sight")

        page.table_in_view(40, 2000)
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
