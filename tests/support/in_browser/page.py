"""A page of the dashboard in a real browser, and what a person does and sees on it."""

import re
from contextlib import suppress
from pathlib import Path

from playwright.sync_api import Browser, Error, Locator, Page, TimeoutError, expect

from tests.support.in_browser.program import PATIENCE_S, pixels, sees_table
from tests.support.waiting import wait_for

TABS = ("Run", "Calibrate", "Results", "Gap", "Replay")
STILL_S = 10.0  # so long what is drawn may take to hold still
# Buttons, tabs, labels and inputs in view that reach out of the window, whose words do not fit, or
# that lie over one another; what merely contains the other does not count.
CUT_OFF = """() => {
  const wrong = [], seen = [], words = new Range();
  const looked = "button, .mantine-Button-label, [role=tab], label, input, p, td, h4";
  for (const one of document.querySelectorAll(looked)) {
    const box = one.getBoundingClientRect(), style = getComputedStyle(one);
    if (box.width < 2 || box.height < 2 || style.visibility == "hidden" || style.opacity == 0)
      continue;
    if (one.closest("[role=alert]")) continue;  // words that slide in and out
    if (one.tagName == "BUTTON" && one.tabIndex < 0) continue;  // the little steps of a number
    const what = (one.innerText || one.value || one.tagName).slice(0, 40);
    if (box.left < -1 || box.right > innerWidth + 1) wrong.push("outside: " + what);
    words.selectNodeContents(one);  // alone: a phone's tab draws a rule that is wider than its row
    const wide = Math.ceil(words.getBoundingClientRect().width);
    if (one.tagName != "INPUT" && wide > one.clientWidth + 2 && one.clientWidth)
      wrong.push("does not fit: " + what);
    for (const [other, its, name] of seen) {
      const across = Math.min(box.right, its.right) - Math.max(box.left, its.left);
      const down = Math.min(box.bottom, its.bottom) - Math.max(box.top, its.top);
      if (across > 3 && down > 3 && !other.contains(one) && !one.contains(other))
        wrong.push("overlap: " + what + " / " + name);
    }
    seen.push([one, box, what]);
  }
  return wrong;
}"""


def nothing_cut_off(page: Page) -> None:
    """Once the page has laid itself out: that takes a picture or two."""
    wrong = ["never looked"]
    for _ in range(20):
        wrong = page.evaluate(CUT_OFF)
        if not wrong:
            return
        page.wait_for_timeout(500)
    raise AssertionError("\n".join(wrong))


class Hand:
    """One tab of the browser. sharp: with every pixel, as a person's screen; else a quarter."""

    def __init__(
        self, browser: Browser, link: str, artefacts: Path, *, sharp: bool = False
    ) -> None:
        context = browser.new_context(
            viewport={"width": 1280, "height": 800}, device_scale_factor=1 if sharp else 0.5
        )
        context.set_default_timeout(1e3 * PATIENCE_S)
        self.page: Page = context.new_page()
        self._artefacts, self._drawn = artefacts, True
        answer = self.page.goto(link)
        assert answer is not None
        assert answer.status == 200
        self.connected()
        if not sharp:
            self.tab("Camera")  # five live curves are too much for a processor that draws, too

    def reload(self) -> None:
        self.page.reload()
        self.connected()
        self.tab("Camera")

    def connected(self, text: str = "not the emergency stop") -> None:
        """Look at the page until it says so: it tries to connect again only when looked at."""
        words = self.page.get_by_text(text).first

        def there() -> bool:
            with suppress(Error):  # it may be loading anew
                self.page.bring_to_front()
                self.page.evaluate("window.dispatchEvent(new Event('focus'))")
                return words.is_visible()
            return False

        wait_for("the page", there, PATIENCE_S, every_s=1.0)

    def see(self, text: str | re.Pattern, patience_s: float = PATIENCE_S) -> None:
        """Wait until the text can be seen."""
        expect(self.page.get_by_text(text).filter(visible=True).first).to_be_visible(
            timeout=1e3 * patience_s
        )

    def tab(self, name: str) -> None:
        self._click(self.page.get_by_role("tab", name=name, exact=True))

    def press(self, name: str | re.Pattern) -> None:
        self._click(self.page.get_by_role("button", name=name, exact=True))

    def choose(self, what: str, option: str | re.Pattern) -> None:
        """Pick an option of a list that drops down."""
        self._click(self.page.get_by_role("combobox", name=what))
        self._click(self.page.get_by_role("option", name=option).first)

    def tick(self, what: str) -> None:
        self._click(self.page.get_by_role("checkbox", name=what))

    def _click(self, what: Locator) -> None:
        """Click what is there, once it holds still. Chromium without a graphics card draws some
        pages too seldom to see that anything does: there, click where it is.
        """
        self.page.bring_to_front()
        expect(what).to_be_visible(timeout=1e3 * PATIENCE_S)
        if self._drawn:
            with suppress(TimeoutError):
                what.click(timeout=1e3 * STILL_S)
                return
        self._drawn = False
        what.click(force=True)

    def download(self, button: str) -> tuple[str, bytes]:
        """Name and content of what a button sends."""
        with self.page.expect_download() as coming:
            self.press(button)
        return coming.value.suggested_filename, Path(coming.value.path()).read_bytes()

    def shot(self, name: str) -> None:
        self.page.bring_to_front()  # pages behind are drawn seldom
        warning = self.page.get_by_role("alert").filter(has_text="Software WebGL")
        if warning.first.is_visible():  # that there is no graphics card
            warning.get_by_role("button").first.click()
            warning.first.wait_for(state="hidden")  # it fades out
        self.page.screenshot(path=str(self._artefacts / f"{name}.png"))

    def view(self):
        """The 3-D view as BGR."""
        return pixels(self.page.locator("canvas").first.screenshot())

    def table_in_view(self, ball_px: int, plate_px: int) -> None:
        """Wait until the 3-D view shows more than so many pixels of ball and plate."""

        def seen() -> bool:
            spread, ball, plate = sees_table(self.view())
            return spread > 15 and ball > ball_px and plate > plate_px

        wait_for("ball and plate in the 3-D view", seen, PATIENCE_S, every_s=0.2)

    def nothing_cut_off(self) -> None:
        nothing_cut_off(self.page)

    def close(self) -> None:
        self.page.context.close()
