"""Make the pictures of the pages anew in .github/pictures: of the dashboard, and of the study.

    rig reproduce --out out/study
    python tests/benchmarks/dashboard/pictures.py --study out/study

each after `uv run --group dev`. Needs Chromium; look at what was made.
"""

import argparse
import io
import tempfile
import time
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, sync_playwright

from tests.support import ROOT
from tests.support.in_browser.page import Hand
from tests.support.in_browser.program import FLAGS, Program
from tests.support.parts import PARTS

PICTURES = ROOT / ".github" / "pictures"
REPORT_PX = {"width": 1120, "height": 2000}  # as wide as the report's text
INTO_RUN_S = 9.0  # the second run is on, and its ball has settled


def keep(picture: bytes, name: str) -> None:
    """Write a PNG of 256 colours, which keep those of few pixels: a tooth of the play."""
    few = Image.Quantize.MAXCOVERAGE
    image = Image.open(io.BytesIO(picture)).convert("RGB").quantize(256, few)
    image.save(PICTURES / f"{name}.png", optimize=True)
    print(f"{name}.png")


def of_dashboard(browser: Browser, folder: Path) -> None:
    """Both runs of the free release, and the demo of the gap."""
    program = Program(folder)
    try:
        page = Hand(browser, program.link, folder, sharp=True)
        page.see("ball in sight")
        page.press("▶ Start")
        page.see("run 2 of 2")
        page.see("Run is on")
        time.sleep(INTO_RUN_S)
        page.shot("run")
        keep((folder / "run.png").read_bytes(), "dashboard_run")
        page.see("Both runs are done")
        page.tab("Gap")
        page.press("Demo: find hidden play")
        page.see("Missing: play in the joints", 600.0)
        page.shot("gap")
        keep((folder / "gap.png").read_bytes(), "dashboard_gap")
    finally:
        program.end()


def of_study(browser: Browser, study: Path) -> None:
    """The report's beginning, Fig. 10 and the map of play; study: folder of `rig reproduce`."""
    page = browser.new_page(viewport=REPORT_PX)  # pyright: ignore[reportArgumentType]
    page.goto((study / "report.html").absolute().as_uri())
    keep(page.screenshot(), "report")
    for name, figure in (("fig10", "fig10"), ("map", "grid_error")):
        keep((study / f"{figure}.png").read_bytes(), name)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--study", type=Path, help="folder of `rig reproduce`")
    study = parser.parse_args().study
    with sync_playwright() as play, tempfile.TemporaryDirectory() as folder:
        browser = play.chromium.launch(executable_path=PARTS["chromium"].find(), args=FLAGS)
        if study is not None:
            of_study(browser, study)
        of_dashboard(browser, Path(folder))


if __name__ == "__main__":
    main()
