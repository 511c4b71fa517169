"""The whole study by hand in a real browser. Skipped, loudly, where there is none.

One test: its steps share the program and the pages, and each needs what the one before it left.
RIG_ARTEFACTS names a folder in which screenshots are kept; RIG_BROWSER_PATIENCE_S (default 120)
is how long a slow machine may take for a step.
"""

import json
import os
import re
import warnings
from pathlib import Path

import pytest
from browser import CHROMIUM, FLAGS, PATIENCE_S, Program, pixels, sees_table, wait_for

sync_api = pytest.importorskip(
    "playwright.sync_api", reason="NO BROWSER TESTS: playwright is missing"
)
SIZES = ((1280, 800), (1920, 1080))


@pytest.fixture
def chromium():
    if not Path(CHROMIUM).is_file():
        warnings.warn(pytest.PytestWarning(f"no {CHROMIUM}"), stacklevel=1)
        pytest.skip(f"NO BROWSER TESTS: {CHROMIUM} is missing")
    with sync_api.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


class Page:
    """A page of the dashboard, and what a person does on it."""

    def __init__(self, browser, link: str, artefacts: Path) -> None:
        context = browser.new_context(viewport={"width": 1280, "height": 800})
        context.set_default_timeout(1e3 * PATIENCE_S)
        self.page, self._artefacts = context.new_page(), artefacts
        self.open(link)

    def open(self, link: str) -> None:
        answer = self.page.goto(link)
        assert answer.status == 200
        self.see("not the emergency stop")

    def see(self, text: str | re.Pattern) -> None:
        """Wait until the text can be seen."""
        self.page.get_by_text(text).first.wait_for()

    def tab(self, name: str) -> None:
        self.page.get_by_role("tab", name=name, exact=True).click()

    def press(self, name: str) -> None:
        self.page.get_by_role("button", name=name, exact=True).click()

    def shot(self, name: str) -> None:
        self.page.screenshot(path=str(self._artefacts / f"{name}.png"))

    def view(self):
        return pixels(self.page.locator("canvas").first.screenshot())

    def nothing_cut_off(self) -> None:
        """No button, tab or input of the panels reaches out of the window to the side."""
        wide = self.page.evaluate("window.innerWidth")
        for role in ("button", "tab"):
            for box in (one.bounding_box() for one in self.page.get_by_role(role).all()):
                assert box is None or (box["x"] >= -1 and box["x"] + box["width"] <= wide + 1), box

    def close(self) -> None:
        self.page.context.close()


def test_the_whole_study_in_a_browser(chromium, tmp_path: Path):
    artefacts = Path(os.environ.get("RIG_ARTEFACTS", tmp_path / "shots"))
    artefacts.mkdir(parents=True, exist_ok=True)
    out = tmp_path / "out"
    out.mkdir()
    program = Program(out)
    try:
        first = Page(chromium, program.link, artefacts)
        ball_and_plate(first)
        calibrate_begins(first)
        both_arms(first, out)
        verdicts(first)
        gap_begins(first)
        second = take_over_and_stop(chromium, first, program, artefacts, out)
        gap_named(second)
        looks(second)
        kill_and_restart(second, program, out)
    finally:
        program.kill()


def ball_and_plate(page: Page) -> None:
    """The ball is balanced when the page opens, and one sees it."""
    page.see("Balancing")
    page.see("sees the ball")

    def seen() -> bool:
        spread, ball, plate = sees_table(page.view())
        return spread > 15 and ball > 200 and plate > 5000

    wait_for("ball and plate in the 3-D view", seen)
    page.see("You hold the controls")
    page.page.keyboard.down("Shift")
    page.page.mouse.click(600, 420)  # on the plate
    page.page.keyboard.up("Shift")
    page.see("target (")  # among the events
    page.press("right")
    page.see("pushed by command")
    page.shot("run-idle")


def calibrate_begins(page: Page) -> None:
    """The servos of the virtual table: begun here, while the runs go on."""
    page.tab("Calibrate")
    page.press("Servo")
    page.see(re.compile("[▶✓] servo"))


def both_arms(page: Page, out: Path) -> None:
    """The free release with and without the model, reloaded in the middle; Fig. 10 appears."""
    page.tab("Run")
    page.page.get_by_role("combobox", name="Virtual time").click()
    page.page.get_by_role("option", name="4 x").click()
    page.press("Start")
    page.see("run 1 of 2")
    page.see("left")
    page.see("run 2 of 2")
    page.page.reload()  # the run goes on; the reloaded page gets its controls back
    page.see("You hold the controls")
    page.see("run 2 of 2")
    page.shot("run-on")
    page.tab("Results")
    page.see("Fig. 10")
    page.see("free-release")
    runs = sorted((out / "runs").glob("*-free-release-*"))
    outcomes = [json.loads((run / "run.json").read_text())["outcome"] for run in runs]
    assert outcomes == ["completed", "completed"]
    page.shot("results")


def verdicts(page: Page) -> None:
    page.tab("Calibrate")
    page.see("servo: accepted")
    page.see("breaks away at")
    page.shot("calibrate")


def gap_begins(page: Page) -> None:
    page.tab("Gap")
    page.press("Demo: find a hidden play")
    page.see(re.compile("[▶✓] 1 locate"))


def take_over_and_stop(chromium, first: Page, program: Program, artefacts: Path, out: Path):
    """A second page watches, may stop, and takes over; the first one's tab closes for nothing."""
    second = Page(chromium, program.link, artefacts)
    second.see("You are watching")
    second.tab("Run")
    second.press("Start")
    second.see("you are watching: press")
    second.press("Take over the controls")
    second.see("You hold the controls")
    first.see("You are watching")
    second.tab("Run")
    second.press("Start")
    second.see("run 1 of 2")
    first.press("STOP (everybody may)")
    second.see("Stopped, 0 V")
    first.close()
    second.press("Balance again")
    second.see("Balancing")
    stopped = sorted((out / "runs").glob("*-free-release-*"))[2]
    assert json.loads((stopped / "run.json").read_text())["outcome"] == "aborted"
    return second


def gap_named(page: Page) -> None:
    """The demo's hidden play is named, with its size; both models are played side by side."""
    page.tab("Gap")
    page.see("named:")
    page.see("joint_backlash")
    page.press("Before and after, side by side")
    page.shot("gap")
    page.tab("Replay")
    page.see("recorded, before, after")
    page.shot("replay")
    page.press("Back to the live table")


def looks(page: Page) -> None:
    """Nothing is cut off, in either size, light and dark; pictures are kept."""
    page.tab("Run")
    for theme in ("light", "dark"):
        for width, height in SIZES:
            page.page.set_viewport_size({"width": width, "height": height})
            page.page.wait_for_timeout(700)
            page.nothing_cut_off()
            page.shot(f"run-{theme}-{width}")
        page.press("Light / dark")


def kill_and_restart(page: Page, program: Program, out: Path) -> None:
    """A killed server leaves no loop behind; started again, the open page finds it."""
    program.kill()
    again = Program(out, port=program.port)
    try:
        assert again.link == program.link
        page.page.bring_to_front()
        page.page.evaluate("window.dispatchEvent(new Event('focus'))")
        page.see("You hold the controls")
        page.see("sees the ball")
        page.tab("Results")
        page.see("free-release")
        assert again.end() == 0
    finally:
        again.kill()
