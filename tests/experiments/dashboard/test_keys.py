"""The page's keys and the names of its fields, in a real browser."""

import numpy as np
import pytest

from experiments.dashboard.tabs.header import with_mouse
from experiments.dashboard.tabs.run import KEYS
from tests.support.shell_alone import opened
from tests.support.waiting import wait_for

# Buttons in view that the Tab key reaches and that say nothing to who cannot see them.
NAMELESS = """() => [...document.querySelectorAll("button")].filter(one => one.tabIndex >= 0
  && one.checkVisibility() && !(one.innerText.trim() || one.ariaLabel || one.title))
  .map(one => one.outerHTML.slice(0, 400))"""


@pytest.mark.slow
def test_an_arrow_is_a_commands_after_a_click_on_a_tab_and_turns_no_view(chromium, program):
    gui, pressed = program.server.gui, []
    panel = gui.add_panel()
    for name in ("Curves", "Swing"):
        with panel.add_tab(name):
            gui.add_markdown(f"what is in {name}")
    panel.dock_left()
    gui.add_command("A frame on", hotkey="arrowright").on_trigger(pressed.append)
    page = opened(chromium, program)
    page.get_by_text("what stays").wait_for(timeout=120e3)
    (client,) = program.server.get_clients().values()
    looks = np.array(client.camera.wxyz)
    for count, name in enumerate(("Swing", "Curves"), 1):
        page.get_by_role("tab", name=name, exact=True).click()
        page.get_by_text(f"what is in {name}").wait_for()
        page.keyboard.press("ArrowRight", delay=300)
        wait_for("the command", lambda n=count: len(pressed) == n, 10.0)
    page.wait_for_timeout(500)
    assert np.allclose(client.camera.wxyz, looks)
    assert page.get_by_text("what is in Curves").is_visible()  # the tabs were not turned either
    page.context.close()


@pytest.mark.slow
def test_every_field_and_slider_has_the_name_that_stands_beside_it_and_icons_their_hints(
    chromium, program
):
    program.server.gui.add_text("Your guess", "", order=-1)
    program.server.gui.add_slider("Push", 0.0, 1.0, 0.1, 0.5, order=-1)
    page = opened(chromium, program)
    page.get_by_role("textbox", name="Your guess", exact=True).wait_for(timeout=120e3)
    page.get_by_role("slider", name="Push", exact=True).wait_for()
    page.get_by_role("textbox", name="Push", exact=True).wait_for()  # the slider's number
    page.get_by_role("textbox", name="P", exact=True).wait_for()  # viser's own name stays
    page.get_by_role("button", name="Configuration & diagnostics").wait_for()
    page.wait_for_timeout(3000)
    assert page.evaluate(NAMELESS) == []
    page.get_by_role("button", name="Configuration & diagnostics").click()  # its icon changes
    page.get_by_role("button", name="Return to GUI").wait_for()
    page.context.close()


@pytest.mark.slow
def test_names_go_along_with_words_that_change_and_are_no_close_of_another_button(
    chromium, program
):
    pressed = program.server.gui.add_button("", order=-1)
    slider = program.server.gui.add_slider("Time [s]", 0.0, 130.0, 0.02, 112.34, order=-1)
    page = opened(chromium, program, viewport={"width": 390, "height": 844})
    number = page.get_by_role("textbox", name="Time [s]", exact=True)
    number.wait_for(timeout=120e3)
    assert number.evaluate("one => one.scrollWidth <= one.clientWidth")  # all of it is seen
    page.wait_for_timeout(1500)
    slider.label, pressed.label = "Later [s]", "Next"
    page.get_by_role("textbox", name="Later [s]", exact=True).wait_for()
    page.get_by_role("button", name="Next", exact=True).wait_for(timeout=10e3)
    page.context.close()


@pytest.mark.slow
def test_a_screen_that_is_touched_is_told_of_no_key_and_no_click(chromium, program):
    program.server.gui.add_markdown(with_mouse(KEYS), order=-1)
    phone = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
    for settings, seen in (({}, True), (phone, False)):
        page = opened(chromium, program, **settings)
        page.get_by_text("what stays").wait_for(timeout=120e3)
        assert page.get_by_text("Keys:").is_visible() is seen
        page.context.close()
