"""The bar above the page in a real browser: a program that dies, is slow, or is not heard."""

import re

import pytest

from tests.support.shell_alone import CONTRAST, ShellAlone, opened
from tests.support.waiting import wait_for


@pytest.mark.slow
def test_a_page_that_is_just_being_opened_has_lost_nothing(chromium, program):
    page = chromium.new_context().new_page()
    page.route("**/alive", lambda route: route.abort())
    page.goto(program.link)
    state = page.locator("#rig-state")
    state.wait_for()
    page.wait_for_timeout(2500)  # two unanswered questions
    assert state.inner_text() == "Connecting ..."
    page.get_by_text(re.compile(r"Connection lost \d+ s ago")).wait_for(timeout=20e3)
    assert int(re.findall(r"\d+", state.inner_text())[0]) >= 9  # since it was opened
    page.context.close()


@pytest.mark.slow
def test_a_program_that_died_is_said_and_found_again_by_itself(chromium):
    program = ShellAlone()
    page = opened(chromium, program)
    page.get_by_text("what stays").wait_for(timeout=120e3)
    port = program.gate.port
    program.server.stop()
    bar = page.locator("#rig-state")
    wait_for("the bar", lambda: "Connection lost" in bar.inner_text(), 20.0)
    assert "The motors may still have power: use the switch" in bar.inner_text()
    assert page.locator("#rig-bar").evaluate(CONTRAST) >= 4.5
    assert not page.get_by_text("for 12 s").is_visible()
    assert page.get_by_text("what stays").is_visible()
    assert page.locator("#rig-again").is_visible()
    wait_for("seconds", lambda: re.search(r"lost ([5-9]|\d\d) s ago", bar.inner_text()), 30.0)
    again = ShellAlone(port)
    again.state = "balancing"
    try:
        page.get_by_text("Balancing", exact=True).wait_for(timeout=60e3)
        page.get_by_text("for 12 s").wait_for(timeout=120e3)  # viser's own part is back, too
    finally:
        again.server.stop()
    page.context.close()


@pytest.mark.slow
def test_a_program_that_was_slow_to_answer_is_told_and_the_page_stays_as_it_is(chromium, program):
    page = opened(chromium, program)
    page.evaluate("window.kept = 1")
    page.route("**/alive", lambda route: None)  # no answer, as of a machine that stands still
    page.get_by_text("Connection lost").wait_for(timeout=20e3)
    page.unroute("**/alive")
    page.locator("#rig-state", has_text="Run is on").wait_for(timeout=20e3)
    assert page.evaluate("window.kept") == 1  # not loaded anew: tabs and fields stay
    page.context.close()


@pytest.mark.slow
def test_a_page_that_nobody_saw_comes_back_without_an_alarm_unless_nobody_answers(
    chromium, program
):
    page = opened(chromium, program)
    page.evaluate("""() => {
      Object.defineProperty(document, "hidden", { value: false, writable: true });
      window.show = (seen) => {
        document.hidden = !seen;
        document.dispatchEvent(new Event("visibilitychange", { bubbles: true }));
      }; }""")
    state = page.locator("#rig-state")
    page.evaluate("show(false)")
    page.route("**/alive", lambda route: None)  # held up by the browser
    page.wait_for_timeout(8000)
    assert state.inner_text() == "Run is on"
    page.evaluate("show(true)")
    page.wait_for_timeout(1500)
    assert state.inner_text() == "Run is on"
    page.get_by_text(re.compile(r"Connection lost \d+ s ago")).wait_for(timeout=20e3)
    page.context.close()
